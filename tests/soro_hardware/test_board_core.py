"""Decisions of the board in virtual time, and what reaches the DACs for any sequence of frames."""

import struct

import numpy as np
import pytest
from board_bench import BOARD, VEAB_SCALE, board_platform, file_of, itv
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.errors import ConfigError
from soro_hardware import load_platform
from soro_hardware.board import frames, messages
from soro_hardware.board.config import Scale
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.board.messages import Cause, PortFlag, Refusal
from soro_hardware.board.pi import core
from soro_hardware.board.pi.ports import ConverterPair
from soro_hardware.emulation.board.board import EmulatedBoard
from tests.refused import fails

MS = 1_000_000
RULES = core.Rules(ports=4, minimum_pa=0, maximum_pa=90_000, watchdog_ns=100 * MS, tolerated_errors=3)
GOOD = (0, 0, 0, 0)
HALF = (50_000,) * 4


NUMBER = 77


def take(state, kind, payload=b"", sequence=1, now_ns=0, number=NUMBER):
    """One frame: the state, and why it was refused."""
    frame = BoardFrame(kind, sequence, payload, number)
    state, why, _ = core.receive(RULES, state, frame, now_ns, NUMBER)
    return state, why


def greeted():
    return take(core.initial_state(RULES), FrameType.HELLO, messages.pack_hello(4))[0]


def armed(now_ns=0):
    return take(greeted(), FrameType.SET, messages.pack_set(HALF), now_ns=now_ns)[0]


def test_a_set_point_arms_the_watchdog():
    state = greeted()
    assert core.watch(RULES, state, 10**12).cause is Cause.NONE, "a configured board may wait any time"
    state = armed(now_ns=7)
    assert (state.setpoint_pa, state.fed_ns) == (HALF, 7)


def test_watchdog_to_the_nanosecond():
    state = armed()
    assert core.watch(RULES, state, 100 * MS - 1) == state
    tripped = core.watch(RULES, state, 100 * MS)
    assert (tripped.setpoint_pa, tripped.cause) == (GOOD, Cause.WATCHDOG)


def test_only_a_good_set_feeds_the_watchdog():
    state = armed()
    for kind, payload, sequence in [
        (FrameType.SET, messages.pack_set(HALF), 1),  # again the same
        (FrameType.SET, messages.pack_set(HALF), 0x80000001),  # older
        (FrameType.SET, messages.pack_set((0, 0, 0, 90_001)), 2),
        (FrameType.SET, messages.pack_set((0, 0, 0, -1)), 3),
        (FrameType.WELCOME, b"", 4),
    ]:
        state, why = take(state, kind, payload, sequence, 90 * MS)
        assert why is not None
        assert state.fed_ns == 0
        assert state.setpoint_pa == HALF
    assert state.refused == 5
    assert core.watch(RULES, state, 100 * MS).cause is Cause.WATCHDOG


@pytest.mark.parametrize("value", [90_001, -1, 2**31 - 1, -(2**31)])
def test_a_set_point_out_of_range_is_refused_whole(value):
    state, why, port = core.receive(
        RULES, greeted(), BoardFrame(FrameType.SET, 1, messages.pack_set((5, 6, value, 7)), NUMBER), 0, 1
    )
    assert (why, port, state.setpoint_pa) == (Refusal.RANGE, 2, GOOD)


def test_sequence_numbers_wrap():
    state = greeted()
    for sequence in (0x7FFFFFFF, 0xFFFFFFFE, 0xFFFFFFFF, 0, 5):
        state, why = take(state, FrameType.SET, messages.pack_set(HALF), sequence)
        assert why is None, sequence


def test_nothing_without_hello():
    for kind in (FrameType.SET, FrameType.RESET, FrameType.BYE):
        state, why = take(core.initial_state(RULES), kind, messages.pack_set(HALF))
        assert why is Refusal.NO_HELLO
        assert state.setpoint_pa == GOOD
    assert take(core.initial_state(RULES), FrameType.HELLO, messages.pack_hello(3))[1] is Refusal.PORTS


@pytest.mark.parametrize("number", [0, NUMBER - 1, NUMBER + 2**32])
def test_nothing_without_the_number_of_the_welcome(number):
    for kind in (FrameType.SET, FrameType.RESET, FrameType.BYE):
        state, why = take(greeted(), kind, messages.pack_set(HALF), number=number)
        assert (why, state.setpoint_pa, state.refused) == (Refusal.NUMBER, GOOD, 1)
        assert core.parts(why)


TRIPS = {
    "watchdog": (lambda s: core.watch(RULES, s, 10**9), Cause.WATCHDOG),
    "host gone": (core.host_gone, Cause.HOST_GONE),
    "reset chip": (
        lambda s: core.judge(RULES, s, [PortFlag.CHIP_RESET] + [PortFlag(0)] * 3),
        Cause.CHIP_RESET,
    ),
    "stopped": (lambda s: core.latch(s, Cause.STOPPING), Cause.STOPPING),
    "self-test": (lambda s: core.tested(core.vent(s), False), Cause.SELF_TEST),
}


@pytest.mark.parametrize(("trip", "cause"), TRIPS.values(), ids=TRIPS.keys())
def test_latched_until_reset(trip, cause):
    state = trip(armed())
    assert (state.cause, state.setpoint_pa) == (cause, GOOD)
    state, _ = take(state, FrameType.HELLO, messages.pack_hello(4))
    state, why = take(state, FrameType.SET, messages.pack_set(HALF), 5)
    assert (why, state.setpoint_pa, state.cause) == (None, GOOD, cause), "the answer names the cause"
    state, _ = take(state, FrameType.RESET, sequence=6)
    assert (state.cause, state.setpoint_pa) == (cause, GOOD), "not before the self-test"
    assert core.tested(state, False).cause is Cause.SELF_TEST
    state = core.tested(state, True)
    state, _ = take(state, FrameType.SET, messages.pack_set(HALF), 7)
    assert (state.cause, state.setpoint_pa) == (Cause.NONE, HALF)


def test_the_first_cause_stays():
    state = core.latch(core.watch(RULES, armed(), 10**9), Cause.STOPPING)
    assert state.cause is Cause.WATCHDOG


def test_a_chip_may_fail_for_less_than_three_cycles():
    bad = [PortFlag.DAC_ERROR, *[PortFlag(0)] * 3]
    state = core.judge(RULES, core.judge(RULES, armed(), bad), bad)
    assert core.judge(RULES, state, [PortFlag(0)] * 4).failed == (0,) * 4
    assert core.judge(RULES, state, bad).cause is Cause.DEVICE_ERROR


def test_bye_and_an_unarmed_host_that_leaves_latch_nothing():
    state, _ = take(armed(), FrameType.BYE)
    assert (state.setpoint_pa, state.cause, state.greeted, state.fed_ns) == (GOOD, Cause.NONE, False, None)
    assert core.host_gone(greeted()).cause is Cause.NONE


# -- what reaches the DACs -------------------------------------------------------------------------

PLATFORM = board_platform()
SETTINGS = settings(derandomize=True, deadline=None, max_examples=60)
VALUES = st.integers(-(2**31), 2**31 - 1) | st.integers(-10, 90_010)


@SETTINGS
@given(
    st.lists(
        st.tuples(st.sampled_from(list(FrameType)), st.lists(VALUES, min_size=4, max_size=4)), max_size=30
    )
)
def test_codes_are_within_range_for_any_frames(sequence):
    devices = EmulatedBoard(PLATFORM, lockstep=True)
    devices.board.draw = lambda: NUMBER
    port = ConverterPair(PLATFORM, 0, devices.buses[1])
    lowest, highest = port.code(0.0), port.code(90e3)
    for dac in devices.dacs:
        dac.log.clear()
    devices.line.feed(frames.encode(BoardFrame(FrameType.HELLO, 0, messages.pack_hello(4))))
    for number, (kind, values) in enumerate(sequence):
        length = messages.lengths(4)[kind]
        payload = (messages.pack_set(values) * 8)[:length].ljust(length, b"\0")
        devices.line.feed(frames.encode(BoardFrame(kind, number + 1, payload, NUMBER)))
    # The self-test writes one count beside 0 Pa, as its only other value.
    codes = {code for dac in devices.dacs for _, code in dac.log} - {lowest + 1}
    assert all(lowest <= code <= highest for code in codes)


@SETTINGS
@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_code_is_within_range_for_any_number(value):
    port = ConverterPair(PLATFORM, 0, EmulatedBoard(PLATFORM, lockstep=True).buses[1])
    code = port.code(value)
    assert port.code(0.0) <= code <= port.code(90e3)
    if np.isnan(value):
        assert code == port.safe_code
    elif 0.0 <= value <= 90e3:
        assert abs(port.applied_pa(code) - value) <= PLATFORM.resolution_pa(0) / 2 + 1e-6


@SETTINGS
@given(st.binary(max_size=400))
def test_no_bytes_end_the_board(data):
    devices = EmulatedBoard(PLATFORM, lockstep=True)
    devices.line.feed(data)
    assert not any(devices.board.state.setpoint_pa)


# -- scales ----------------------------------------------------------------------------------------

BENT = Scale.model_validate(
    {"output": [[0.0, -2e3], [1.0, 0.0], [4.0, 200e3], [10.0, 500e3]], "input": [[1.0, 0.0], [5.0, 500e3]]}
)


@SETTINGS
@given(st.floats(-2e3, 500e3))
def test_scale_and_back(pressure_pa):
    assert BENT.asked_pa(BENT.to_volts(pressure_pa)) == pytest.approx(pressure_pa, abs=1e-6)
    assert BENT.read_pa(BENT.sensor_volts(pressure_pa)) == pytest.approx(pressure_pa, abs=1e-6)


def test_scale_of_a_table_with_a_corner():
    assert [BENT.to_volts(p) for p in (-9e9, -1e3, 0.0, 100e3, 200e3, 350e3, 9e9)] == [
        0.0, 0.5, 1.0, 2.5, 4.0, 7.0, 10.0
    ]  # fmt: skip
    assert BENT.read_pa(0.5) == pytest.approx(-62.5e3), "a broken wire shows as a pressure that cannot be"


def test_a_regulator_of_0_to_10_volts_with_a_monitor_of_1_to_5():
    """As an SMC ITV2050: vented is code 0, and the factory's power-up value is half of the range."""
    devices = EmulatedBoard(itv(), lockstep=True)
    report = devices.board.ports.self_test()[0]
    assert report.error == ""
    assert report.pressure_pa == pytest.approx(0.0, abs=1500.0)
    assert "450.0 kPa after power-up" in report.warning
    assert devices.board.ports.ports[0].safe_code == 0
    assert devices.board.ports.ports[0].code(450e3) == 2048
    assert devices.board.ports.ports[0].code(9e9) == devices.board.ports.ports[0].code(500e3)


BAD = {
    "falling": ({"output": [[0.0, 0.0], [10.0, -5.0]]}, ("scales.veab.output", "rise")),
    "flat": ({"output": [[0.0, -1.0], [5.0, 1.0], [10.0, 1.0]]}, ("scales.veab.output", "rise")),
    "volts": ({"input": [[-1.0, 0.0], [10.0, 1.0]]}, ("scales.veab.input", "0 to 10")),
    "no vent": ({"output": [[0.0, 5e3], [10.0, 900e3]]}, ("scales.veab.output", "0 Pa")),
    "one point": ({"output": [[0.0, 0.0]]}, ("scales.veab.output", "at least 2")),
}


@pytest.mark.parametrize(("change", "found"), BAD.values(), ids=BAD.keys())
def test_bad_scale(change, found, tmp_path):
    path = file_of(tmp_path, BOARD, scales={"veab": {**VEAB_SCALE, **change}})
    with fails(ConfigError, *found[1:], key=found[0]):
        load_platform(path)


BAD_BOARDS = {
    "watchdog beyond its bound": ({"board": {"watchdog_s": 0.6}}, ("board.watchdog_s", "0.6")),
    "watchdog of two cycles": ({"board": {"watchdog_s": 0.01}}, ("", "board.watchdog_s:", "three")),
    "port that is not there": (
        {"valves": [{"chamber": "link0/chamber0", "port": 4}]},
        ("", "valves:", "0", "3"),
    ),
    "chip twice": (
        {"ports": [BOARD["ports"][0]] * 2 + BOARD["ports"][:1]},
        ("", "ports:", "0x60", "1"),
    ),
    "no such scale": (
        {"ports": [{**port, "scale": "itv"} for port in BOARD["ports"]]},
        ("", "ports[0].scale:"),
    ),
    "range beyond the regulator": (
        {"range": {"maximum_pa": 150e3}, "rating": {"maximum_pa": 200e3}},
        ("", "range:", "veab"),
    ),
    "slow converter": ({"board": {"adc_rate_sps": 250}}, ("", "board.adc_rate_sps:", "1.5", "cycle_hz")),
    "unknown rate": ({"board": {"adc_rate_sps": 500}}, ("board.adc_rate_sps", "128", "250", "490")),
    "sensor beyond the converter": ({"board": {"adc_divider": 2.0}}, ("", "scales.veab.input:", "4.096")),
    "host by name": ({"board": {"hosts": ["raspberrypi"]}}, ("board.hosts", "192")),
    "host within its network": ({"board": {"hosts": ["192.168.4.3/24"]}}, ("board.hosts", "192")),
    "address": ({"ports": [{**BOARD["ports"][0], "dac": 0x50}]}, ("ports[0].dac", "80")),
}


@pytest.mark.parametrize(("change", "found"), BAD_BOARDS.values(), ids=BAD_BOARDS.keys())
def test_bad_platform(change, found, tmp_path):
    with fails(ConfigError, *found[1:], key=found[0]):
        load_platform(file_of(tmp_path, BOARD, **change))


def test_set_points_are_32_bits():
    assert struct.calcsize("<4i") == messages.lengths(4)[FrameType.SET]
