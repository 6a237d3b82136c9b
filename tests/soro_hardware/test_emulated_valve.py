"""Emulated nodes by themselves: the valve, watchdogs, faults, boot."""

import pytest
from hardware_bench import HOST_HEARTBEAT, emergencies, single, ticks

from soro_hardware.canopen import frames, sdo_frames
from soro_hardware.canopen.cia408 import ValveState
from soro_hardware.canopen.frames import NmtCommand, NmtState
from soro_hardware.emulation.canopen.world import World
from soro_hardware.transport.frame import Frame

S = ValveState

DEMANDS = dict.fromkeys(S) | {S.ACTIVE: 50e3, S.HOLD: 3e3, S.FAULT_HOLD: 3e3}


@pytest.mark.parametrize(("state", "demand"), list(DEMANDS.items()))
def test_what_the_valve_does_in_each_state(powered, state, demand):
    """It follows 6380 in ACTIVE, 6394 in HOLD and FAULT_HOLD, and vents otherwise; None is venting."""
    powered.sdo("2B 94 63 01 2C 01 00 00")
    powered.sdo("2B 80 63 01 88 13 00 00")
    valve = powered.world.nodes[0].valve
    valve.state = state
    assert valve.demand_pa() == demand
    answer = powered.sdo("40 41 60 00 00 00 00 00")
    assert int(answer.split()[4], 16) & 0xF == state.bits


def test_reading_is_one_for_each_time(running):
    readings = {running.sdo("40 81 63 01 00 00 00 00") for _ in range(10)}
    assert len(readings) == 1
    ticks(running, 1, HOST_HEARTBEAT)
    later = {running.sdo("40 81 63 01 00 00 00 00")}
    ticks(running, 1, HOST_HEARTBEAT)
    assert len(readings | later | {running.sdo("40 81 63 01 00 00 00 00")}) > 1


def test_hysteresis_keeps_an_active_valve_off_zero_but_not_a_venting_one(running):
    for _ in range(200):
        running.exchange(0.0)
    assert running.world.pressure_pa[0] == pytest.approx(450.0, abs=1.0)
    running.world.nodes[0].fault(0x8302, 1, S.FAULT_DISABLED)
    ticks(running, 200)
    assert running.world.pressure_pa[0] < 1.0


def test_heartbeat_consumer_starts_with_the_first_heartbeat(powered):
    powered.sdo("23 16 10 01 64 00 7F 00")
    assert emergencies(ticks(powered, 100)) == []
    powered.send(frames.heartbeat(126, NmtState.OPERATIONAL))  # of another node
    assert emergencies(ticks(powered, 100)) == []
    powered.send(HOST_HEARTBEAT)
    assert emergencies(ticks(powered, 19)) == []
    assert emergencies(ticks(powered, 1)) == ["8130"]
    assert emergencies(ticks(powered, 100)) == [], "reported once"


def test_heartbeat_consumer_starts_again_with_the_next_heartbeat(running):
    running.sdo("2F 29 10 01 01 00 00 00")  # it stays operational
    ticks(running, 60)
    running.send(Frame(0x201, b"\x08\x00\x00\x00"))
    assert emergencies(ticks(running, 5)) == ["0000"]
    assert emergencies(ticks(running, 100, Frame(0x201, bytes(4)))) == []
    running.send(HOST_HEARTBEAT)
    assert emergencies(ticks(running, 21, Frame(0x201, bytes(4)))) == ["8130"]


def test_silent_host_vents(running):
    sent = ticks(running, 100, Frame(0x201, bytes((7, 0)) + (5000).to_bytes(2, "little")))
    assert emergencies(sent) == ["8130"]
    assert running.world.nodes[0].valve.state is S.FAULT_DISABLED
    assert running.world.pressure_pa[0] < 100.0


def test_missing_set_points_vent(running):
    sent = ticks(running, 8, HOST_HEARTBEAT)
    assert emergencies(sent) == []
    sent = ticks(running, 100, HOST_HEARTBEAT)
    assert emergencies(sent) == ["8250"]
    assert running.world.nodes[0].valve.state is S.FAULT_DISABLED
    assert running.world.pressure_pa[0] < 100.0


@pytest.mark.parametrize(
    ("behaviour", "state"),
    [(0, NmtState.PRE_OPERATIONAL), (1, NmtState.OPERATIONAL), (2, NmtState.STOPPED)],
)
def test_error_behaviour(running, behaviour, state):
    running.sdo(f"2F 29 10 01 0{behaviour} 00 00 00")
    ticks(running, 60)
    assert running.world.nodes[0].state is state
    assert running.world.nodes[0].valve.state is S.FAULT_DISABLED


def test_fault_passes_through_its_reaction(running):
    node = running.world.nodes[0]
    node.fault(0x2320, 1, S.FAULT_INIT)
    node.fault(0x3120, 1, S.FAULT_HOLD)  # a second one while the first lasts changes nothing
    nibbles = [f.data[0] & 0xF for f in ticks(running, 4, HOST_HEARTBEAT) if f.can_id == 0x181]
    assert nibbles == [0b0111, 0b0111, 0b0000, 0b0000]
    assert node.dictionary.values[0x1001, 0] == 1


def test_all_clear_follows_a_reset_edge(running):
    running.world.nodes[0].fault(0x2320, 1, S.FAULT_INIT)
    ticks(running, 4, HOST_HEARTBEAT)
    sent = ticks(running, 1, HOST_HEARTBEAT, Frame(0x201, b"\x08\x00\x00\x00"))
    assert emergencies(sent) == ["0000"]
    assert running.world.nodes[0].valve.state is S.INIT
    assert running.world.nodes[0].dictionary.values[0x1001, 0] == 0


def test_heartbeats_are_on_their_grid(powered):
    powered.sdo("2B 17 10 00 19 00 00 00")
    powered.send(frames.nmt(NmtCommand.START, 0))
    sent = [str(f) for f in ticks(powered, 200) if f.can_id == 0x701]
    assert sent == ["701 [1] 05"] * 40


@pytest.mark.parametrize(
    ("command", "setpoint"), [(NmtCommand.RESET_NODE, 0), (NmtCommand.RESET_COMMUNICATION, 5000)]
)
def test_reset_boots_and_forgets(running, command, setpoint):
    running.bus.frames.clear()
    running.send(frames.nmt(command, 1))
    assert [str(f) for f in running.bus.frames] == ["701 [1] 00"]
    node = running.world.nodes[0]
    assert node.state is NmtState.PRE_OPERATIONAL
    assert node.valve.state is S.INIT
    assert node.dictionary.values[0x1017, 0] == 0
    assert node.dictionary.values[0x6380, 1] == setpoint, "the application keeps its values"
    assert emergencies(ticks(running, 60)) == []
    assert running.world.pressure_pa[0] < 200.0


def test_boot_takes_its_time_in_real_time():
    heard = []
    world = World(single(emulation={"boot_delay_s": 0.1}), heard.append, lockstep=False)
    for time_ms in range(0, 99, 3):
        world.run(time_ms * 1_000_000)
    world.send(world.host, sdo_frames.sdo_read(1, 0x1000, 0))
    assert heard == []
    world.run(110_000_000)
    assert [str(f) for f in heard] == ["701 [1] 00"]
