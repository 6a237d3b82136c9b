"""The CANopen driver in lockstep: every fault is named, vents, latches, and is cleared by start-up only."""

import can
import numpy as np
import pytest
from hardware_bench import Bench, codes, platform, set_points

from soro_hardware.canopen import frames
from soro_hardware.canopen.cia408 import ValveState
from soro_hardware.canopen.frames import NmtCommand
from soro_hardware.transport.frame import Frame


def vents_and_latches(bench, code, source, cycles=3):
    """The fault is named, zeros go out from the next cycle on, and stay until the start-up has run again."""
    for _ in range(cycles):
        result = bench.exchange(20e3, 40e3, 60e3)
        if (code, source) in codes(result):
            break
    assert (code, source) in codes(result)
    assert all(fault.latched for fault in result.faults if fault.code == code)
    for _ in range(200):
        result = bench.exchange(20e3, 40e3, 60e3)
        assert not result.sent_pa.any()
        assert (code, source) in codes(result)
    assert bench.world.pressure_pa.max() < 500.0
    bench.driver.configure()
    assert bench.run(100, 20e3, 40e3, 60e3).faults == ()
    np.testing.assert_allclose(bench.world.pressure_pa, [20e3, 40e3, 60e3], atol=600.0)


NODE_2 = "link0/chamber1 (node 2)"


@pytest.mark.parametrize("end", [ValveState.FAULT_HOLD, ValveState.FAULT_DISABLED, ValveState.FAULT_INIT])
def test_emergency(arm, end):
    arm.world.nodes[1].fault(0x2320, 1, end)
    vents_and_latches(arm, "emergency", NODE_2)
    assert arm.driver.statistics.emergencies == 1


def test_a_fault_that_came_between_two_cycles_is_answered_by_zeros_in_the_next(arm):
    arm.run(20, 50e3)
    arm.bus.take_log()
    arm.bus.inject(Frame(0x702, b"\x00"))
    assert not arm.exchange(50e3).sent_pa.any()
    assert {pressure for _, _, pressure in set_points(arm.bus.take_log())} == {0}


def test_rebooted_node(arm):
    arm.world.nodes[1].reset(arm.world.now_ns)
    vents_and_latches(arm, "rebooted", NODE_2)


def test_node_that_falls_out_of_active_without_a_word(arm):
    arm.world.nodes[1].valve.state = ValveState.FAULT_DISABLED
    vents_and_latches(arm, "not_active", NODE_2)


def test_fault_reaction_is_not_active(arm):
    """0111 has all bits of ACTIVE but R."""
    valve = arm.world.nodes[1].valve
    valve.fault(ValveState.FAULT_HOLD)
    assert ("not_active", NODE_2) in codes(arm.exchange(20e3))
    assert valve.state is ValveState.FAULT_REACTION


def test_node_that_never_becomes_active():
    bench = Bench(platform(canopen={"activation_timeout_s": 0.1}))
    bench.driver.configure()
    bench.world.nodes[1].dictionary.on_write[0x6040, 0] = lambda _: None
    assert bench.run(20, 20e3).faults == ()
    result = bench.run(3, 20e3)
    assert codes(result) == {("not_active", NODE_2)}
    assert "stays in hold" in result.faults[0].message


def test_late_answers_to_a_vent_are_no_fall_from_active(arm):
    """Of a busy host they arrive as if they answered the next cycles: ACTIVE of its first zeros, then HOLD."""
    arm.run(20, 50e3)
    arm.driver._bus.drain = int  # does nothing: the answers come just after it
    arm.driver.vent()
    arm.driver.vent()
    assert arm.run(4, 0.0).faults == ()


def test_node_that_leaves_operational(arm):
    arm.send(frames.nmt(NmtCommand.PRE_OPERATIONAL, 2))
    vents_and_latches(arm, "left_operational", NODE_2, cycles=8)


def test_silent_node(arm):
    """A node whose frames no longer come: stale after 3 cycles, lost after 100 ms."""
    arm.bus.swallow = {0x182, 0x702}
    found = {}
    for cycle in range(40):
        for fault in arm.exchange(20e3, 40e3, 60e3).faults:
            found.setdefault(fault.code, cycle)
            assert fault.source == NODE_2
    assert found["stale_reading"] == 2
    assert 19 <= found["heartbeat_lost"] <= 25
    assert arm.driver.statistics.frames_lost == 40


def test_one_lost_reading_is_tolerated(arm):
    arm.bus.swallow = {0x182}
    result = arm.exchange(20e3, 40e3, 60e3)
    assert result.faults == ()
    assert result.fresh.tolist() == [True, False, True]
    assert result.pressure_pa[1] == pytest.approx(39.5e3, abs=600.0), "the last one stays"
    arm.bus.swallow = set()
    assert arm.exchange(20e3, 40e3, 60e3).fresh.all()
    assert arm.driver.statistics.frames_lost == 1


def test_late_reading_is_no_fresh_one(arm):
    arm.bus.swallow = {0x182}
    arm.exchange(20e3, 40e3, 60e3)
    arm.bus.inject(Frame(0x182, b"\x0f\x01\x10\x27"))
    result = arm.exchange(20e3, 40e3, 60e3)
    assert not result.fresh[1]
    assert result.pressure_pa[1] == 100e3
    assert arm.driver.statistics.frames_late == 1


def test_all_clear_of_an_emergency_is_no_fault(arm):
    arm.bus.inject(frames.emergency(2, 0, 0))
    assert arm.exchange(20e3).faults == ()


GARBAGE = [
    Frame(0x182, b"\x0f"),
    Frame(0x182, b""),
    Frame(0x702, b""),
    Frame(0x702, b"\x05\x05"),
    Frame(0x082, b"\x30\x81"),
    Frame(0x702, b"\x00", extended=True),
    Frame(0x082, b"\x30\x81" + bytes(6), extended=True),
    Frame(0x702, b"", remote=True, length=1),
    Frame(0x182, b"", remote=True, length=4),
    Frame(0x7E5, bytes(8)),
    Frame(0x185, bytes(4)),
    Frame(0x705, b"\x00"),
    Frame(0x582, bytes(8)),
]


@pytest.mark.parametrize("frame", GARBAGE, ids=str)
def test_malformed_and_foreign_frames_change_nothing(arm, frame):
    arm.bus.inject(frame)
    result = arm.exchange(20e3, 40e3, 60e3)
    assert result.faults == ()
    assert result.fresh.all()


def test_random_frames(arm):
    """Any frames from the bus: nothing raises, and what is sent stays in range."""
    noise = np.random.default_rng(9)
    for _ in range(2000):
        for _ in range(noise.integers(4)):
            data = noise.bytes(int(noise.integers(9)))
            arm.bus.inject(Frame(int(noise.integers(0x800)), data))
        arm.exchange(20e3, 40e3, 60e3)
    assert all(0 <= counts <= 9000 for _, _, counts in set_points(arm.bus.take_log()))


def test_bus_off_stops_everything_until_reset(arm, monkeypatch):
    monkeypatch.setattr(type(arm.bus), "state", property(lambda self: can.BusState.ERROR))
    result = arm.exchange(20e3, 40e3, 60e3)
    assert codes(result) == {("bus_off", "bus")}
    arm.driver.vent()
    assert not result.fresh.any()
    assert arm.bus.take_log() == [], "nothing is sent to a bus that is off"
    monkeypatch.undo()
    assert codes(arm.exchange(20e3)) == {("bus_off", "bus")}
    arm.driver.configure()
    assert arm.run(5, 20e3).faults == ()
