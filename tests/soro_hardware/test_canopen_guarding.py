"""Node guarding in place of heartbeats, and nodes whose controllers have been off the bus."""

import pytest
from hardware_bench import Bench, codes, driver, emulator, platform, platform_file, single, transcript

from soro_hardware.canopen import frames
from soro_hardware.canopen.device import describe
from soro_hardware.canopen.frames import NmtState
from soro_hardware.transport.frame import Frame
from tests.refused import refused

GUARDED = {"canopen": {"mapping": {"guarding": True}}}
QUIET = {"regulator": {"reading_noise_pa": 0.0}}
ASKED = frames.guard(1)


@pytest.fixture
def bench():
    bench = Bench(platform(**GUARDED))
    bench.driver.configure()
    return bench


def answers(bench, *also):
    """What the node answers to one question."""
    bench.bus.frames.clear()
    for frame in (*also, ASKED):
        bench.send(frame)
    found = [frame for frame in bench.bus.frames if frame.can_id == 0x701]
    bench.bus.frames.clear()
    return found


# -- a guarded node --------------------------------------------------------------------------------


def test_start_up_cycle_and_loss():
    bench = Bench(single(**GUARDED, **QUIET))
    bench.driver.configure()
    log = bench.bus.take_log()
    told = transcript("guarding_start_up")
    begin = log.index(told[0])
    assert log[begin : begin + len(told)] == told
    told = transcript("guarding_armed")
    assert log[-len(told) :] == told
    assert not any(" 16 10 01 " in line for line in log), "no heartbeat to consume"
    bench.run(12, 20e3)
    told = transcript("guarding")
    log = bench.bus.take_log()
    assert [line for line in log if line[2:5] in ("701", "77F")] == told
    bench.driver.close()
    assert "> 601 [8] 2F 0D 10 00 00 00 00 00" in bench.bus.take_log(), "the host falls silent on purpose"
    assert not bench.world.nodes[0].valve.state.is_fault


def test_answers_toggle_and_tell_the_state():
    bench = Bench(single())
    assert answers(bench) == [frames.guarded(1, NmtState.PRE_OPERATIONAL, 0)]
    assert answers(bench) == [Frame(0x701, b"\xff")]
    assert answers(bench, frames.nmt(frames.NmtCommand.START, 1)) == [Frame(0x701, b"\x05")]
    assert answers(bench, frames.nmt(frames.NmtCommand.STOP, 1)) == [Frame(0x701, b"\x84")]
    bench.world.nodes[0].reset(bench.world.now_ns)
    assert answers(bench) == [Frame(0x701, b"\x00"), Frame(0x701, b"\x7f")], "a reset begins with toggle 0"


def test_a_node_with_heartbeats_is_not_guarded_too():
    bench = Bench(single())
    bench.driver.configure()
    assert answers(bench) == []
    bench.run(20, 20e3)
    assert not any("R1" in line for line in bench.bus.take_log())


def test_healthy_arm_is_asked_in_turn_and_never_trips(bench):
    bench.bus.take_log()
    for _ in range(40):
        assert bench.run(10, 50e3).faults == ()
    log = bench.bus.take_log()
    cycles = "\n".join(log).split("> 080 [0]")
    asked = [sum(f"> 70{node} [1] R1" in cycle for cycle in cycles) for node in (1, 2, 3)]
    assert all(78 <= count <= 81 for count in asked), "every 25 ms of 2 s"
    assert max(cycle.count("R1") for cycle in cycles) == 1
    for _ in range(60):  # longer than the life time
        bench.driver.vent()
    assert bench.run(20, 50e3).faults == ()


def test_a_node_that_does_not_answer_is_named(bench):
    """Within its life time, whatever else still comes from it."""
    bench.run(20, 50e3)
    bench.bus.swallow = {0x702}
    results = [bench.run(1, 50e3) for _ in range(30)]
    cycles = next(n for n, result in enumerate(results, start=1) if result.faults)
    result = results[-1]
    assert 15 <= cycles <= 26, "25 to 125 ms"
    assert codes(result) == {("guard_lost", "link0/chamber1 (node 2)")}
    assert result.faults[0].message == "no answer to node guarding for 100 ms"
    assert result.faults[0].latched
    bench.bus.swallow = set()
    result = bench.run(20, 50e3)
    assert codes(result) == {("guard_lost", "link0/chamber1 (node 2)")}, "until the start-up"
    assert not result.sent_pa.any()
    bench.driver.configure()
    assert bench.run(20, 50e3).faults == ()


def test_the_same_answer_twice_is_none(bench):
    """A toggle that stands still is a device that repeats itself."""
    bench.run(20, 50e3)
    bench.bus.swallow = {0x702}
    bench.bus.take_log()
    for _ in range(40):
        result = bench.run(1, 50e3)
        if any(entry.startswith("< 702") for entry in bench.bus.take_log()):
            bench.bus.inject(frames.guarded(2, NmtState.OPERATIONAL, 0))
    assert ("guard_lost", "link0/chamber1 (node 2)") in codes(result)
    assert bench.driver.statistics.frames_garbled > 3


def test_one_lost_answer_does_no_harm(bench):
    for cycle in range(200):
        bench.bus.swallow = {0x701, 0x702, 0x703} if cycle % 20 < 5 else set()
        assert bench.run(1, 50e3).faults == ()


def test_a_node_that_is_not_asked_vents():
    bench = Bench(single(**GUARDED))
    bench.driver.configure()
    bench.run(60, 50e3)
    bench.bus.drops_questions = True
    result = bench.run(30, 50e3)
    assert ("emergency", "link0/chamber0 (node 1)") in codes(result)
    assert "0x8130" in next(f.message for f in result.faults if f.code == "emergency")
    bench.run(60, 50e3)
    assert bench.world.pressure_pa[0] < 5e3


@pytest.mark.parametrize("state", [b"\x84", b"\xff"])
def test_a_state_that_is_not_operational_is_named(bench, state):
    bench.run(3, 50e3)
    bench.bus.inject(Frame(0x702, state))
    assert ("left_operational", "link0/chamber1 (node 2)") in codes(bench.run(1, 50e3))


@pytest.mark.process
def test_over_a_pseudo_terminal(tmp_path):
    with (
        emulator(tmp_path, "--lockstep", platform=platform_file(tmp_path, **GUARDED)) as served,
        driver(platform(**GUARDED), served.device) as regulator,
    ):
        for cycle in range(60):
            assert regulator.exchange([20e3] * 3, cycle * 5_000_000).faults == ()
        assert all(node.last_seen_ns > 250_000_000 for node in regulator.nodes)


def test_refused_where_it_cannot_be():
    with refused("", names=("canopen.mapping.guarding", "socketcand")):
        platform(**GUARDED, transport={"kind": "socketcand"})
    with refused("guarding", "100C:0"):
        describe(platform(canopen={"mapping": {"device": "cia408_4ch", "guarding": True}}).canopen.mapping)
    assert describe(platform(**GUARDED).canopen.mapping).has_watchdog


# -- back from bus-off -----------------------------------------------------------------------------


def off_and_back(bench, cycles):
    """The controller of node 2 is off the bus for some cycles; the results of these and of 20 more."""
    port = bench.world.hub.controllers[2]
    port.go_off()
    results = [bench.run(1, 50e3) for _ in range(cycles)]
    bench.bus.take_log()
    port.rejoin()
    return results + [bench.run(1, 50e3) for _ in range(20)]


@pytest.mark.parametrize("options", [{}, GUARDED], ids=["heartbeat", "guarding"])
def test_a_node_back_from_bus_off_stays_vented_until_the_start_up(options):
    bench = Bench(platform(**options, **QUIET))
    bench.world.nodes[1].dictionary.override(0x1029, 1, 1)  # it stays operational
    bench.driver.configure()
    bench.run(100, 50e3)
    results = off_and_back(bench, 2)
    log = [line for line in bench.bus.take_log() if line[2:4] not in ("70", "77")]
    told = transcript("bus_off")
    assert sorted(log[: len(told)]) == sorted(told), "the question comes before the host's first set point"
    assert options or log[: len(told)] == told
    assert results[1].faults == (), "two lost answers are none yet"
    result = results[-1]
    assert codes(result) == {("not_active", "link0/chamber1 (node 2)")}
    assert (
        result.faults[0].message == "fell from active to fault disabled after its controller was off the bus"
    )
    assert bench.driver.statistics.emergencies == 1
    result = bench.run(100, 50e3)
    assert not result.sent_pa.any()
    assert bench.world.pressure_pa.max() < 2e3
    bench.driver.configure()
    assert bench.run(100, 50e3).faults == ()


def test_what_was_lost_meanwhile_stays_lost():
    bench = Bench(platform(**QUIET))
    bench.driver.configure()
    bench.run(100, 50e3)
    found = codes(off_and_back(bench, 30)[-1])
    assert ("heartbeat_lost", "link0/chamber1 (node 2)") in found


def test_a_node_that_has_left_operational_says_why():
    bench = Bench(single())
    bench.driver.configure()
    bench.run(100, 50e3)
    port = bench.world.hub.controllers[1]
    port.go_off()
    bench.run(2, 50e3)
    port.rejoin()
    result = bench.run(20, 50e3)
    assert ("left_operational", "link0/chamber0 (node 1)") in codes(result)
    text = "; ".join(fault.message for fault in result.faults)
    assert "communication state 0x7F after its controller was off the bus" in text


def test_the_word_alone_is_no_fault_and_ends_none():
    """As of a device that has stayed operational and missed nothing."""
    bench = Bench(single())
    bench.driver.configure()
    bench.run(3, 50e3)
    back = frames.emergency(1, frames.EmcyCode.BUS_OFF_RECOVERED, 0x11)
    bench.bus.inject(back)
    assert bench.run(3, 50e3).faults == ()
    assert bench.driver.statistics.emergencies == 1
    bench.bus.inject(frames.emergency(1, frames.EmcyCode.GENERIC, 1))
    bench.bus.inject(back)
    bench.run(3, 50e3)
    assert codes(bench.run(3, 50e3)) == {("emergency", "link0/chamber0 (node 1)")}
