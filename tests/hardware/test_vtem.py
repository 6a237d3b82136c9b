"""The motion terminal: exact bytes, every way in which it can fail, and the way back."""

import time

import numpy as np
import pytest
from board_bench import RecordingLink, lines
from hardware_bench import transcript, wait_for
from hypothesis import given
from hypothesis import strategies as st
from vtem_bench import VtemBench, vtem_platform

from soro_core.errors import ConfigError, HardwareError
from soro_core.hardware.emulation.faults import Injection
from soro_core.hardware.vtem import registers
from soro_core.hardware.vtem.driver import VtemRegulator
from soro_core.hardware.vtem.modbus import Frames, write_request
from soro_core.hardware.vtem.registers import Layout, State, Status, command

ONE = {
    "valves": [{"chamber": "link0/chamber0", "slot": 1, "valve": 0}],
    "emulation": {"boot_s": 0.0, "app_start_s": 0.005, "regulator": {"reading_noise_pa": 0.0}},
}


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
    layout = Layout(((1, 1), (3, 0), (3, 1)))
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
    assert Status.of(0xAB83) == Status(3, State.RUNNING)
    assert Status.of(0x7D).is_idle
    assert not Status.of(0xC3).regulates, "app 3, but a failure"
    assert {Status.of(word).word for word in range(256)} == set(range(256))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            {"valves": [{"chamber": f"link0/chamber{n}", "slot": 0, "valve": 0} for n in (0, 1)]},
            "slot 0 twice",
        ),
        ({"valves": [{"chamber": "link0/chamber0", "slot": 8, "valve": 0}]}, "slot"),
        ({"range": {"minimum_pa": -95e3}}, "motion app 03"),
        ({"registers": {"outputs": 65530}}, "outputs"),
    ],
)
def test_platform_files_that_cannot_work(change, text):
    with pytest.raises(ConfigError, match=text):
        vtem_platform(**change)


def test_a_cycle_leaves_time_to_the_loop_at_any_rate():
    platform = vtem_platform(cycle_budget_s=0.008)
    assert [platform.at_rate(hz).budget_s for hz in (50.0, 200.0)] == pytest.approx([0.008, 0.004])


# -- frames ----------------------------------------------------------------------------------------


def test_any_split_of_the_stream():
    stream = b"".join(write_request(40003, [n, 2, 3], 255, n) for n in range(1, 5))
    for step in range(1, len(stream)):
        frames = Frames()
        found = [f for at in range(0, len(stream), step) for f in frames.feed(stream[at : at + step])]
        assert [frame.transaction for frame in found] == [1, 2, 3, 4]
        assert frames.garbled == 0


@pytest.mark.parametrize(("place", "value"), [(2, 1), (4, 1), (5, 0), (5, 1)])
def test_a_damaged_header_is_counted_and_the_next_frame_is_as_good_as_ever(place, value):
    frames, good = Frames(), write_request(40003, [1, 2, 3], 255, 9)
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
    assert latched(bench.run(1, 20e3)) == {("device_error", "link0/chamber0, link0/chamber1 (slot 0)")}
    with pytest.raises(HardwareError, match=r"slot 0\): does not get ready within 2 s: app 61, failure"):
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
    bench.devices._registers = bench.devices._registers.model_copy(update={"outputs": 40100})
    result = bench.run(1, 20e3)
    function = 23 if one_transaction else 16
    assert latched(result) == {("command_rejected", "terminal")}
    assert f"exception 2 (illegal data address) to function {function}" in result.faults[0].message
    assert bench.driver.statistics.frames_refused == 1


def test_wrong_registers_are_named_at_the_start():
    bench = VtemBench(vtem_platform())
    bench.devices._registers = bench.devices._registers.model_copy(update={"inputs": 45400})
    with pytest.raises(HardwareError, match=r"start-up: motion terminal: exception 2 .*registers right"):
        bench.driver.configure()


def test_whatever_runs_is_ended_and_pressure_is_taken_out_before(bench):
    """Of a driver that has gone without a word, and of another program."""
    first, _, third, *_ = bench.devices.slots
    third.outputs[0] = command(5)
    bench.devices.tick(bench.devices.now_ns)
    wait_for(lambda: bench.devices.tick(bench.devices.now_ns + 5_000_000) or third.status.app == 5)
    link = RecordingLink(bench.devices.line)
    second = VtemRegulator(vtem_platform(), link, time.monotonic, lockstep=True)
    second.configure()
    ended = {data[8:10].hex() for _, data in link.take_log() if data[7] == 6 and data[10:] == b"\x00\x3d"}
    assert ended == {"9c43", "9c49"}
    assert 0.0 < max(first._kept_pa) < 5e3, "at the end of its app"
    assert bench.devices.pressure_pa.max() < 5e3
    assert second.exchange(np.full(3, 20e3), 0).faults == ()


def test_chambers_that_do_not_empty_keep_their_app_at_0_pa(bench):
    """A valve whose app is ended might keep the pressure; at 0 Pa it exhausts when it can again."""
    bench.devices.faults.add(Injection(fault="vent_blocked", chamber="link0/chamber1"))
    with pytest.raises(HardwareError, match=r"slot 0\): 39\.\d kPa after 2 s of set point 0"):
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
    bench.driver._supervisor = Watcher()
    bench.run(1, 20e3)
    bench.run(1, 0.0)
    bench.run(1, 0.0)
    bench.driver._supervisor = None
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
        def watches(self, pressed):
            return True

        def dismiss(self, vented):
            told.append(vented)

    bench.run(100, 40e3 if pressed else 0.0)
    if fault == "link":
        bench.devices.line.hang_up = bench.devices.line.refuses = True
    elif fault:
        bench.devices.faults.add(Injection(fault=fault, chamber="link0/chamber1"))
    bench.driver._supervisor = Watcher()
    bench.driver.close()
    assert told == [is_empty]
