"""The driver on an emulated board, in lockstep: every way in which a board can fail, and the way back."""

import errno
from dataclasses import replace

import numpy as np
import pytest
from board_bench import QUIET, BoardBench, board_platform, itv
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core.errors import HardwareError
from soro_hardware.board import frames, messages, texts
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.emulation.faults.fault_types import read_injection
from soro_hardware.port import FAULT_CODES
from tests.refused import fails
from tests.soro_hardware.line_link import LineLink

MS = 1_000_000


@pytest.fixture
def bench():
    """Three valves at 20, 40 and 60 kPa."""
    bench = BoardBench(board_platform())
    bench.driver.configure()
    assert bench.run(100, 20e3, 40e3, 60e3).faults == ()
    return bench


def codes(result, latched=True):
    return {fault.code for fault in result.faults if fault.latched is latched}


def vented(bench):
    """Whether every DAC asks for 0 Pa."""
    return {dac.code for dac in bench.devices.dacs} == {2048}


def recovers(bench):
    """Only the start-up brings it back."""
    assert bench.run(3, 20e3).faults != ()
    assert vented(bench)
    bench.driver.configure()
    assert bench.run(100, 20e3, 40e3, 60e3).faults == ()
    assert not vented(bench)
    return True


def test_what_reaches_the_dacs(bench):
    assert [dac.code for dac in bench.devices.dacs] == [2458, 2867, 3277, 2048]


def test_watchdog(bench):
    bench.devices.tick(bench.devices.now_ns + 101 * MS)
    result = bench.exchange(20e3)
    assert codes(result) == {"watchdog_vented"}
    assert texts.CAUSES[messages.Cause.WATCHDOG][1] in result.faults[0].message
    assert vented(bench)
    assert recovers(bench)


def test_configured_board_waits_for_any_time(bench):
    bench.driver.configure()
    bench.devices.tick(bench.devices.now_ns + 10_000 * MS)
    assert bench.run(100, 20e3).faults == ()


def test_chip_that_does_not_answer_once_is_tolerated(bench):
    bench.devices.buses[1].broken[0x60] = errno.ENXIO
    assert bench.run(2, 20e3).faults == ()
    bench.devices.buses[1].broken.clear()
    assert bench.run(10, 20e3).faults == ()


@pytest.mark.parametrize(("bus", "address", "text"), [(1, 0x61, "port 1: DAC"), (3, 0x48, "port 2: ADC")])
@pytest.mark.parametrize("number", [errno.ENXIO, errno.ETIMEDOUT])
def test_chip_that_does_not_answer_trips(bench, bus, address, text, number):
    bench.devices.buses[bus].broken[address] = number
    result = bench.run(4, 20e3)
    assert codes(result) == {"device_error"}
    assert text in result.faults[0].message
    others = [d.code for n, d in enumerate(bench.devices.dacs) if (bus, address) != (1, 0x61) or n != 1]
    assert set(others) == {2048}, "those that can are vented"
    with fails(HardwareError, text, device="board", step="start-up", code="refused"):
        bench.driver.configure()
    bench.devices.buses[bus].broken.clear()
    assert recovers_after_failure(bench)


def recovers_after_failure(bench):
    bench.driver.configure()
    return bench.run(100, 20e3).faults == ()


def test_a_transfer_that_fails_is_tried_once_more_in_the_same_cycle(bench):
    bus, failed = bench.devices.buses[1], []

    def every_other(transfer):
        def tried(address, *rest):
            if address not in failed:
                failed.append(address)
                raise OSError(errno.ENXIO, "ENXIO")
            failed.remove(address)
            return transfer(address, *rest)

        return tried

    bus.read, bus.write = every_other(bus.read), every_other(bus.write)
    result = bench.run(10, 20e3, 40e3, 60e3)
    assert result.faults == ()
    assert result.fresh.all()


def test_reading_of_a_silent_converter_is_not_fresh(bench):
    bench.devices.buses[1].broken[0x49] = errno.ENXIO
    result = bench.exchange(20e3, 40e3, 60e3)
    assert result.fresh.tolist() == [True, False, True]
    assert result.pressure_pa[1] == pytest.approx(40e3, abs=1e3), "the newest there is"


@pytest.mark.parametrize("call", ["vent", "exchange"])
def test_a_connection_lost_in_any_call_is_latched(bench, call):
    bench.devices.line.hang_up = True
    if call == "vent":
        bench.driver.vent()
    result = bench.run(3, 60e3)
    assert "link_lost" in codes(result)
    assert not result.sent_pa.any()


@pytest.mark.timeout(120)
@pytest.mark.parametrize("call", ["vent", "exchange"])
def test_a_board_that_never_stops_sending_is_given_up(bench, monkeypatch, call):
    """It vents by itself when its host has gone; to read on for ever would leave it to its watchdog."""
    with monkeypatch.context() as flood:
        flood.setattr(LineLink, "receive", lambda link, timeout_s: b"x" * 65536)
        bench.driver.vent() if call == "vent" else bench.exchange(20e3)
    result = bench.exchange(20e3)
    assert codes(result) >= {"link_lost"}
    assert "without a pause" in result.fault_text
    assert bench.devices.board.state.cause


def test_brownout_of_one_port(bench):
    bench.devices.brownout(2)
    result = bench.run(5, 20e3)  # one port is checked in each cycle
    assert codes(result) == {"rebooted"}
    assert vented(bench)
    assert recovers(bench)


def test_the_cycle_that_finds_a_fault_vents(bench):
    """The host may be silent from then on."""
    bench.devices.brownout(0)
    board = bench.devices.board
    while not board.state.cause:
        assert not vented(bench)
        board.poll(board.next_event_ns)
    assert vented(bench)


def test_server_restarted(bench):
    bench.devices.power_cycle()
    seen = set()
    for _ in range(5):
        seen |= codes(bench.exchange(20e3))
    assert seen == {"link_lost", "rebooted"}
    assert recovers(bench)


def test_server_stopped(bench):
    bench.devices.line.put(bench.devices.board.stop(bench.devices.now_ns))
    assert "left_operational" in codes(bench.exchange(20e3))
    assert vented(bench)


def test_connection_lost_and_back_shows_pressures_but_asks_for_none(bench):
    bench.devices.line.hang_up = True
    assert codes(bench.exchange(60e3)) == {"link_lost"}
    assert vented(bench), "at once, not after the watchdog's time"
    for _ in range(100):
        bench.exchange(60e3)
    result = bench.exchange(60e3)
    assert result.fresh.all()
    assert np.abs(result.pressure_pa).max() < 1e3
    assert recovers(bench)


def test_nobody_listens(bench):
    bench.devices.line.refuses = bench.devices.line.hang_up = True
    result = bench.run(5, 20e3)
    assert codes(result) == {"link_lost"}
    assert codes(result, latched=False) == {"stale_reading"}
    assert not result.fresh.any()
    assert bench.driver.statistics.frames_sent == bench.driver.statistics.frames_received
    with fails(HardwareError, code="open"):
        bench.driver.configure()


def test_silent_board(bench):
    bench.devices.line.to_host = lambda chunk: b""
    seen = set()
    for _ in range(25):
        result = bench.exchange(20e3)
        seen |= {fault.code for fault in result.faults}
    assert seen == {"stale_reading", "heartbeat_lost"}
    assert bench.driver.statistics.frames_lost >= 20


def test_lost_answers_are_counted_and_tolerated(bench):
    bench.devices.line.to_host = lambda chunk: b""
    assert bench.run(2, 20e3).faults == ()
    bench.devices.line.to_host = lambda chunk: chunk
    assert bench.run(2, 20e3).faults == ()
    assert bench.driver.statistics.frames_lost == 2


def test_garbled_answers_are_counted_and_tolerated(bench):
    bench.devices.line.to_host = lambda chunk: chunk[:-1] + bytes([chunk[-1] ^ 1])
    assert bench.run(2, 20e3).faults == ()
    bench.devices.line.to_host = lambda chunk: chunk
    assert bench.run(2, 20e3).faults == ()
    assert bench.driver.statistics.frames_garbled == 2


def test_garbled_set_points_are_counted_by_the_board_and_not_obeyed(bench):
    bench.devices.line.to_devices = lambda chunk: chunk[:12] + b"\xff" + chunk[13:]
    before = [dac.code for dac in bench.devices.dacs]
    bench.run(2, 0.0)
    assert [dac.code for dac in bench.devices.dacs] == before
    assert bench.devices.board.garbled == 2


def test_duplicated_and_reordered_set_points(bench):
    """An old or repeated SET changes nothing and feeds nothing."""
    sent = []
    bench.devices.line.to_devices = lambda chunk: sent.append(chunk) or chunk
    bench.exchange(20e3)
    bench.exchange(30e3)
    fed = bench.devices.board.state.fed_ns
    bench.devices.now_ns += 50 * MS
    for chunk in (sent[1], sent[0]):
        bench.devices.line.feed(chunk)
    assert bench.devices.board.state.fed_ns == fed
    assert bench.devices.board.state.setpoint_pa[0] == 30_000
    assert bench.exchange(20e3).faults == ()
    assert bench.driver.statistics.frames_refused == 2


def test_a_refused_set_point_is_named(bench):
    """Only a board with other limits does this."""
    bench.devices.board.rules = replace(bench.devices.board.rules, maximum_pa=10_000)
    result = bench.exchange(20e3)
    assert codes(result) == {"command_rejected"}
    assert "out of its range" in result.faults[0].message


def test_set_point_that_is_not_applied(bench):
    bench.devices.board.ports.ports[1].applied_pa = lambda code: 0.0
    result = bench.exchange(20e3, 40e3, 60e3)
    assert {(fault.code, fault.source) for fault in result.faults} == {("setpoint_ignored", "link0/chamber1")}
    assert bench.exchange(20e3).sent_pa.max() == 0.0


def test_rounding_beyond_the_range_does_not_leave_it(bench):
    assert bench.exchange(90e3 + 0.08, -0.08, 0.0).faults == ()
    wide = BoardBench(itv(range={"maximum_pa": 900e3}))
    wide.driver.configure()
    result = wide.run(2, 900e3 + 0.8, 0.0, 0.0)
    assert result.faults == ()
    assert result.sent_pa[0] == 900e3


def test_board_of_another_range():
    bench = BoardBench(board_platform())
    bench.driver.platform = board_platform(range={"maximum_pa": 80e3})
    with fails(HardwareError, "port 0", "(0, 90000)", "(0, 80000)", device="board", code="refused"):
        bench.driver.configure()


def test_board_of_another_size():
    bench = BoardBench(board_platform())
    bench.devices.line.to_devices = lambda chunk: (
        frames.encode(BoardFrame(FrameType.HELLO, 0, messages.pack_hello(3)))
        if chunk[3] == FrameType.HELLO
        else chunk
    )
    with fails(HardwareError, "ports", device="board", step="start-up", code="refused"):
        bench.driver.configure()


def test_board_that_does_not_answer():
    bench = BoardBench(board_platform(host={"start_timeout_s": 0.01}))
    bench.devices.line.to_host = lambda chunk: b""
    with fails(HardwareError, "HELLO", device="board", step="start-up", code="silent"):
        bench.driver.configure()


def test_open_circuit_of_a_sensor_is_named(bench):
    bench.devices.faults.add(
        read_injection("fault: sensor_open_circuit, chamber: link0/chamber0, reading_pa: 200e3")
    )
    result = bench.run(5, 20e3)
    assert result.pressure_pa[0] > 100e3
    assert result.faults == (), "the limiter trips on the reading"
    with fails(HardwareError, "port 0", "ADC", device="board", step="start-up", code="refused"):
        bench.driver.configure()


FLOATS = st.floats(allow_nan=True, allow_infinity=True) | st.floats(0.0, 90e3)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.lists(st.tuples(FLOATS, FLOATS, FLOATS), max_size=20), st.booleans())
def test_what_reaches_the_dacs_is_within_range_for_any_set_points(sequence, vents):
    bench = BoardBench(board_platform(**QUIET))
    bench.driver.configure()
    lowest, highest = 2048, 3891
    for dac in bench.devices.dacs:
        dac.log.clear()
    for setpoints in sequence:
        result = bench.exchange(*setpoints)
        assert {fault.code for fault in result.faults} <= set(FAULT_CODES)
        good = all(-0.1 <= value <= 90e3 + 0.1 for value in setpoints)  # rounding is let through
        assert good or not result.sent_pa.any()
        if vents:
            bench.driver.vent()
            assert vented(bench)
    assert all(lowest <= code <= highest for dac in bench.devices.dacs for _, code in dac.log)
