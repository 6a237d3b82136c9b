"""The motion terminal: exact bytes, every way in which it can fail, and the way back."""

import struct
import time

import numpy as np
import pytest
from board_bench import RecordingLink, lines
from hardware_bench import transcript, wait_for
from hypothesis import given
from hypothesis import strategies as st
from vtem_bench import VtemBench, vtem_platform

from soro_core.errors import ConfigError, HardwareError
from soro_hardware import supervisor
from soro_hardware.emulation.faults.fault_types import Injection
from soro_hardware.vtem import registers
from soro_hardware.vtem.driver import VtemRegulator
from soro_hardware.vtem.modbus import ModbusDecoder, write_request
from soro_hardware.vtem.registers import RegisterLayout, SlotState, SlotStatus, command
from tests.refused import fails

ONE = {
    "valves": [{"chamber": "link0/chamber0", "slot": 1, "valve": 0}],
    "emulation": {"boot_s": 0.0, "app_start_s": 0.005},
    "regulator": {"reading_noise_pa": 0.0},
}

SLOT = "link0/chamber0, link0/chamber1 (slot 0)"


@pytest.fixture
def bench():
    """Three valves at 20, 40 and 60 kPa."""
    bench = VtemBench(vtem_platform())
    bench.driver.configure()
    assert bench.run(100, 20e3, 40e3, 60e3).faults == ()
    return bench


def latched(result):
    return {(fault.code, fault.source) for fault in result.faults if fault.latched}


def counts(driver):
    """What has come and was no answer to the request of its cycle."""
    found = driver.statistics
    return found.frames_garbled + found.frames_late + found.frames_refused


def recovers(bench):
    """Zeros and nothing else until the start-up; then it follows again."""
    assert not bench.run(3, 20e3).sent_pa.any()
    bench.driver.configure()
    assert bench.run(100, 20e3, 40e3, 60e3).faults == ()
    np.testing.assert_allclose(bench.devices.pressure_pa, [20e3, 40e3, 60e3], atol=600.0)
    return True


# -- words -----------------------------------------------------------------------------------------


def recorded(name):
    """Lines of a transcript, byte by byte."""
    return [f"{line[0]} {bytes.fromhex(line[1:]).hex(' ').upper()}" for line in transcript(name)]


def test_start_up_cycle_fault_and_recovery():
    one = VtemBench(vtem_platform(**ONE))
    one.driver.configure()
    one.run(2, 3e3)
    one.devices.slots[1].fail(True)
    assert latched(one.run(2, 3e3)) == {("device_error", "link0/chamber0 (slot 1)")}
    one.devices.slots[1].fail(False)
    one.driver.configure()
    one.run(1, 3e3)
    assert lines(one.link.take_log()) == recorded("vtem")


def test_vent_and_shutdown():
    one = VtemBench(vtem_platform(**ONE))
    one.driver.configure()
    one.run(2, 3e3)
    one.link.take_log()
    one.driver.vent()
    one.driver.close()
    assert lines(one.link.take_log()) == recorded("vtem_shutdown")


def test_a_cycle_by_one_message():
    one = VtemBench(vtem_platform(**ONE, registers={"one_transaction": True}))
    one.driver.configure()
    one.link.take_log()
    one.run(1, 3e3)
    assert lines(one.link.take_log()) == recorded("vtem_one_message")


def test_words_of_a_block():
    layout = RegisterLayout(((1, 1), (3, 0), (3, 1)))
    assert (layout.offset, layout.size, layout.slots) == (3, 9, (1, 3))
    assert [layout.control(slot) for slot in layout.slots] == [1, 3]
    # Of the range -4.97 to 90.07 kPa whole mbar are left, and the slot in between rests.
    words = layout.outputs([-4.97e3, 90.07e3, 33.3e3], -4.97e3, 90.07e3)
    assert words == [0x43, 0, 0x10000 - 49, 61, 0, 0, 0xC3, 900, 333]
    assert layout.setpoints(words) == [-4.9e3, 90e3, 33.3e3]


@given(st.floats(-90e3, 700e3))
def test_pressures_as_words(pressure_pa):
    word = registers.word_of(pressure_pa)
    assert 0 <= word <= 0xFFFF
    assert registers.pressure_of(word) == pytest.approx(pressure_pa, abs=50.0 + 1e-6)


def test_status_words():
    assert SlotStatus.of(0xAB83) == SlotStatus(3, SlotState.RUNNING)
    assert SlotStatus.of(0x7D).is_idle
    assert not SlotStatus.of(0xC3).regulates, "app 3, but a failure"
    assert {SlotStatus.of(word).word for word in range(256)} == set(range(256))


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (
            {"valves": [{"chamber": f"link0/chamber{n}", "slot": 0, "valve": 0} for n in (0, 1)]},
            ("", "valves:", "slot 0", "twice"),
        ),
        ({"valves": [{"chamber": "link0/chamber0", "slot": 8, "valve": 0}]}, ("valves[0].slot",)),
        ({"range": {"minimum_pa": -95e3}}, ("", "range:", "03")),
        ({"registers": {"outputs": 65530}}, ("registers.outputs",)),
    ],
)
def test_platform_files_that_cannot_work(change, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        vtem_platform(**change)


def test_a_cycle_leaves_time_to_the_loop_at_any_rate():
    platform = vtem_platform(cycle_budget_s=0.008)
    assert [platform.at_rate(hz).budget_s for hz in (50.0, 200.0)] == pytest.approx([0.008, 0.004])


# -- frames ----------------------------------------------------------------------------------------


def test_any_split_of_the_stream():
    stream = b"".join(write_request(40003, [n, 2, 3], 255, n) for n in range(1, 5))
    for step in range(1, len(stream)):
        frames = ModbusDecoder()
        found = [f for at in range(0, len(stream), step) for f in frames.feed(stream[at : at + step])]
        assert [frame.transaction for frame in found] == [1, 2, 3, 4]
        assert frames.garbled == 0


@pytest.mark.parametrize(("place", "value"), [(2, 1), (4, 1), (5, 0), (5, 1)])
def test_a_damaged_header_is_counted_and_the_next_frame_is_as_good_as_ever(place, value):
    frames, good = ModbusDecoder(), write_request(40003, [1, 2, 3], 255, 9)
    bad = good[:place] + bytes([value]) + good[place + 1 :]
    assert frames.feed(bad + good) == []
    assert frames.garbled == 1
    assert len(frames.feed(good)) == 1


def test_answers_that_are_none_are_waited_out(bench):
    """Of another unit, another length, another register, late, or refused as busy: lost, and counted."""
    driver, line = bench.driver, bench.devices.line
    for change in (
        lambda data: data[:6] + b"\x01" + data[7:],
        lambda data: data[:4] + b"\x00\x05" + data[6:-1] if len(data) == 12 else data,
        lambda data: data[:-1] + b"\x08" if len(data) == 12 else data,
        lambda data: bytes([data[0] ^ 0x40]) + data[1:],
        lambda data: data[:4] + b"\x00\x03\xff" + bytes([data[7] | 0x80, 6]),
        lambda data: data[:8] + bytes([data[8] - 1]) + data[9:] if data[7] == 3 else data,
        lambda data: data[:8] + bytes([data[8] + 1]) + data[9:] if data[7] == 3 else data,
    ):
        lost, counted = driver.statistics.frames_lost, counts(driver)
        line.to_host = change
        result = bench.run(1, 20e3, 40e3, 60e3)
        line.to_host = bytes
        assert not result.fresh.any()
        assert latched(result) == set()
        assert driver.statistics.frames_lost == lost + 1
        assert counts(driver) > counted
        assert bench.run(2, 20e3, 40e3, 60e3).fresh.all()


BAD_REQUESTS = {
    "byte count too large": "10 9C43 0003 08 00C3 012C 0000",
    "byte count odd": "10 9C43 0003 07 00C3 012C 0000",
    "byte count too small": "10 9C43 0003 04 00C3 012C 0000",
    "byte count 0": "10 9C43 0003 00 00C3 012C 0000",
    "registers missing": "10 9C43 0003 06 00C3 012C",
    "registers too many": "10 9C43 0003 06 00C3 012C 0000 0000",
    "nothing to write": "10 9C43 0000 00",
    "byte count of function 23": "17 B153 0003 9C43 0003 08 00C3 012C 0000",
    "odd byte count of function 23": "17 B153 0003 9C43 0003 07 00C3 012C 0000",
    "function 23 reads nothing": "17 B153 0000 9C43 0003 06 00C3 012C 0000",
    "function 23 reads too much": "17 B153 007E 9C43 0003 06 00C3 012C 0000",
    "reads nothing": "03 B153 0000",
    "reads too much": "03 B153 007E",
    "a reading with more behind it": "03 B153 0003 00",
    "one register with more behind it": "06 9C43 00C3 00",
}


@pytest.mark.parametrize("pdu", BAD_REQUESTS.values(), ids=BAD_REQUESTS.keys())
def test_a_request_whose_counts_do_not_agree_is_refused_and_writes_nothing(bench, pdu):
    """Exception 3, before addresses are looked at: as the standard's diagrams have it."""
    request = bytes.fromhex(pdu)
    before = [list(slot.outputs) for slot in bench.devices.slots]
    head = struct.pack(">HHHB", 7, 0, len(request) + 1, 255)
    bench.devices.line.output.clear()
    bench.devices.line.feed(head + request)
    assert bytes(bench.devices.line.output)[7:] == bytes([request[0] | 0x80, 3])
    assert [list(slot.outputs) for slot in bench.devices.slots] == before


# -- what a terminal can do ------------------------------------------------------------------------


def test_slots_that_feed_no_chamber_rest(bench):
    assert [slot.outputs[0] for slot in bench.devices.slots[:4]] == [command(3, 3), 61, command(3, 1), 0]


def test_an_app_that_has_ended_is_latched_by_slot(bench):
    bench.devices.end_app(2)
    result = bench.run(2, 20e3, 40e3, 60e3)
    assert latched(result) == {("left_operational", "link0/chamber2 (slot 2)")}
    assert "app 61, ready" in result.faults[0].message
    assert result.fresh.tolist() == [True, True, False]
    bench.run(100, 20e3)
    assert bench.devices.pressure_pa.max() < 500.0, "the app was asked for again, at 0 Pa"
    assert recovers(bench)


def test_a_failure_is_acknowledged_by_the_start_up_only(bench):
    bench.devices.faults.add(Injection(fault="brownout", chamber="link0/chamber1"))
    assert latched(bench.run(1, 20e3)) == {("device_error", SLOT)}
    with fails(
        HardwareError,
        "2 s",
        "app 61",
        device=SLOT,
        step="start-up",
        code="refused",
    ):
        bench.driver.configure()
    bench.devices.faults.clear()
    bench.driver.configure()
    assert bench.run(100, 20e3).faults == ()


def test_a_restart_is_told_from_a_lost_connection(bench):
    bench.devices.line.hang_up = True
    result = bench.run(3, 20e3)
    assert {code for code, _ in latched(result)} == {"link_lost"}
    assert result.fresh.all(), "connected again, and read"
    assert recovers(bench)
    bench.devices.reboot()
    assert {code for code, _ in latched(bench.run(3, 20e3))} == {"link_lost", "rebooted"}
    assert recovers(bench)


@pytest.mark.parametrize("one_transaction", [False, True])
def test_a_refused_request_is_latched_and_named(one_transaction):
    bench = VtemBench(vtem_platform(registers={"one_transaction": one_transaction}))
    bench.driver.configure()
    bench.devices.line.to_devices = lambda chunk: chunk.replace(b"\x9c\x43", b"\x9c\xa4")  # 40003, 40100
    result = bench.run(1, 20e3)
    function = 23 if one_transaction else 16
    assert latched(result) == {("command_rejected", "terminal")}
    assert f"exception 2 (illegal data address) to function {function}" in result.faults[0].message
    assert bench.driver.statistics.frames_refused == 1


def test_wrong_registers_are_named_at_the_start():
    bench = VtemBench(vtem_platform(), there=vtem_platform(registers={"inputs": 45400}))
    with fails(HardwareError, "exception 2", "registers", device="motion terminal", code="refused"):
        bench.driver.configure()


def test_whatever_runs_is_ended_and_pressure_is_taken_out_before(bench):
    """Of a driver that has gone without a word, and of another program."""
    first, _, third, *_ = bench.devices.slots
    third.outputs[0] = command(5)
    bench.devices.tick(bench.devices.now_ns)
    wait_for(lambda: bench.devices.tick(bench.devices.now_ns + 5_000_000) or third.status.app == 5)
    kept = []

    class Link(RecordingLink):
        def send(self, data):
            super().send(data)
            if first.status.state is SlotState.READY:  # the app has ended
                kept.append(max(first.demand_pa(0), first.demand_pa(1)))

    link = Link(bench.devices.line)
    second = VtemRegulator(vtem_platform(), link, time.monotonic, lockstep=True)
    second.configure()
    ended = {data[8:10].hex() for _, data in link.take_log() if data[7] == 6 and data[10:] == b"\x00\x3d"}
    assert ended == {"9c43", "9c49"}
    assert kept
    assert all(0.0 < pressure < 5e3 for pressure in kept), "at the end of its app"
    assert bench.devices.pressure_pa.max() < 5e3
    assert second.exchange(np.full(3, 20e3), 0).faults == ()


def test_chambers_that_do_not_empty_keep_their_app_at_0_pa(bench):
    """A valve whose app is ended might keep the pressure; at 0 Pa it exhausts when it can again."""
    bench.devices.faults.add(Injection(fault="vent_blocked", chamber="link0/chamber1"))
    with fails(
        HardwareError,
        "39.",
        "2 s",
        device=SLOT,
        step="start-up",
        code="pressure",
    ):
        bench.driver.configure()
    second = VtemBench(vtem_platform())
    second.driver.configure()
    second.run(100, 40e3)
    second.devices.faults.add(Injection(fault="vent_blocked", chamber="link0/chamber1"))
    second.driver.close()
    assert second.devices.pressure_pa[1] > 30e3
    assert all(second.devices.slots[n].status.regulates for n in (0, 2))
    assert second.devices.slots[0].outputs[1:] == [0, 0]
    assert bench.devices.slots[0].status.regulates
    assert bench.devices.slots[0].outputs[1:] == [0, 0]


def test_the_process_beside_it_knows_before_pressure_is_asked_for(bench):
    """Who hangs in the midst of the first exchange with pressure has hung with pressure."""
    told = []

    class Watcher:
        def watches(self, pressed):
            told.append((pressed, any(slot.outputs[1] for slot in bench.devices.slots)))
            return True

    bench.driver.vent()
    bench.run(1, 0.0)
    bench.driver.supervisor = Watcher()
    bench.run(1, 20e3)
    bench.run(1, 0.0)
    bench.run(1, 0.0)
    bench.driver.supervisor = None
    assert told == [(True, False), (True, True), (False, False)]


@pytest.mark.parametrize(
    ("pressed", "fault", "is_empty"),
    [
        (True, "", True),
        (True, "vent_blocked", False),
        (True, "link", False),
        (False, "link", True),
    ],
)
def test_the_process_beside_it_is_told_whether_the_arm_was_seen_empty(bench, pressed, fault, is_empty):
    """It ends at once only then; else it goes on trying."""
    told = []

    class Watcher:
        is_alive = True

        def watches(self, pressed):
            return True

        def dismiss(self, vented):
            told.append(vented)

    bench.run(100, 40e3 if pressed else 0.0)
    if fault == "link":
        bench.devices.line.hang_up = bench.devices.line.refuses = True
    elif fault:
        bench.devices.faults.add(Injection(fault=fault, chamber="link0/chamber1"))
    bench.driver.supervisor = Watcher()
    bench.driver.close()
    assert told == [is_empty]


@pytest.mark.parametrize("pressure_pa", [0.0, 1.9e3, 2.1e3, 30e3])
def test_the_second_process_asks_for_inputs_that_show_an_empty_arm(pressure_pa):
    bench = VtemBench(vtem_platform(regulator={"reading_noise_pa": 0.0, "hysteresis_pa": 0.0}))
    bench.driver.configure()
    bench.run(200, pressure_pa)
    zero, read = bench.driver.vent_plan().steps
    bench.devices.take(read["send"].encode("latin-1"))
    assert supervisor.confirms(read, bytes(bench.devices.line.output)) is (pressure_pa < 2e3)
    bench.devices.line.output.clear()
    bench.devices.take(zero["send"].encode("latin-1"))
    assert supervisor.confirms(zero, bytes(bench.devices.line.output))
    bench.devices.end_app(0)
    bench.devices.line.output.clear()
    bench.devices.take(read["send"].encode("latin-1"))
    assert not supervisor.confirms(read, bytes(bench.devices.line.output)), "a slot without its app"
