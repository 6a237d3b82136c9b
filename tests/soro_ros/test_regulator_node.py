"""The driver node against emulated valves: commands of any kind on real topics, real frames below."""

import signal
import time

import numpy as np
import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from rcl_interfaces.srv import SetParameters
from rclpy.duration import Duration
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from soro_core.errors import SoroError
from soro_core.safety import Limiter, Limits
from soro_ros.conversion import messages, qos
from soro_ros.host import middleware
from soro_ros.host.services import Call
from soro_ros.topics.chambers import ChamberInterface
from tests.patience import LIMIT_S
from tests.refused import refused_keys
from tests.soro_ros.bench import NAMES, PERIOD_S, Bench
from tests.soro_ros.direct import receive
from tests.soro_ros.running import wait_until


@pytest.fixture
def bench(domain, tmp_path):
    """In lockstep, with the limits as they are shipped."""
    it = Bench(tmp_path, lockstep=True)
    yield it
    assert set(it.close()) <= {0, -9}  # -9: killed by the test


@pytest.fixture
def real_time_bench(alone, domain, tmp_path):
    """In real time, as long as a late command may be."""
    it = Bench(tmp_path, lockstep=False)
    yield it
    assert set(it.close()) <= {0, -9}


@pytest.mark.process
def test_a_command_arrives_and_silence_vents_and_reset_needs_a_zero_command(bench):
    bench.send([40e3, 20e3, 0.0], 0.8)
    assert bench.true_pressure() == pytest.approx([40e3, 20e3, 0.0], abs=1.5e3)
    bench.pause(0.095)
    assert not bench.failed()
    bench.pause(PERIOD_S)  # the last command is 0.105 s old
    assert bench.fault().startswith("command lost")
    bench.wait_empty()
    bench.send([30e3] * 3, 0.3)
    assert bench.true_pressure().max() < 2e3  # latched
    with pytest.raises(SoroError, match="regulator/reset"):
        bench.supervisor.call("regulator/reset")
    works_again(bench)


@pytest.mark.process
def test_a_lower_limit_acts_at_once_on_the_true_pressures_and_vents_nothing(bench):
    bench.send([60e3, 60e3, 0.0], 0.8)
    assert bench.true_pressure()[0] > 55e3
    for name, value, taken in (("limits.maximum_pa", 20000, True), ("platform", "veab_tcp", False)):
        wanted = [rclpy.Parameter(name, value=value).to_parameter_msg()]
        request = SetParameters.Request(parameters=wanted)
        call = Call(bench.node, SetParameters, "regulator/set_parameters", request)
        bench.until(call.done, "an answer")
        (result,) = call.response.results
        assert result.successful is taken, result.reason
        call.close()
    assert "next configure" in result.reason
    bench.send([60e3, 60e3, 0.0], 0.8)
    assert bench.true_pressure() == pytest.approx([20e3, 20e3, 0.0], abs=1.5e3)
    assert not bench.failed()


@pytest.mark.process
def test_a_stream_of_bad_commands_never_reaches_a_valve_and_vents(bench):
    for bad, age_s, kind, refused in (
        ([float("nan"), 0, 0], 0.0, "not finite", 40),
        ([float("inf"), 0, 0], 0.0, "not finite", 80),
        ([95e3, 0, 0], 0.0, "out of range", 40),
        ([-1e3, 0, 0], 0.0, "out of range", 80),
        ([20e3, 0, 0], 1.0, "stale", 40),
    ):
        bench.send([30e3] * 3, 0.5)
        assert bench.true_pressure() == pytest.approx([30e3] * 3, abs=1.5e3), bad
        bench.send(bad, 0.2, age_s)
        assert bench.fault().startswith("command lost"), bad
        bench.wait_empty()
        bench.wait_rejected(kind, refused)
        bench.reset()
        bench.until(lambda: not bench.failed(), "an open latch")


@pytest.mark.process
def test_refusals_are_a_warning_while_they_last(bench):
    bench.send([30e3] * 3, 0.3)
    bench.send([95e3, 0, 0], 0.02)
    for message in ("commands refused", "active"):
        bench.until(lambda said=message: bench.supervisor.status["regulator"].message == said, message)
        bench.send([30e3] * 3, 0.1)
    assert bench.rejected("out of range") == 4


@pytest.mark.parametrize(("lockstep", "taken"), [(False, 1), (True, 20)])
def test_of_commands_that_waited_the_newest_counts_in_real_time_and_each_in_lockstep(domain, lockstep, taken):
    """As at the start, when the node does not listen yet."""
    middleware.init()
    try:
        node = Node("holder")
        stamps: list[int] = []
        chambers = ChamberInterface(
            node,
            Limiter(Limits(), NAMES),
            time.monotonic_ns,
            lambda: node.get_clock().now().nanoseconds,
            lambda: stamps.append(chambers.seen_ns),
            lockstep=lockstep,
        )
        command = node.create_publisher(JointState, "chambers/command", qos.loop(lockstep))
        wait_until(lambda: command.get_subscription_count() == 1, "discovery")
        executor = EventsExecutor()
        executor.add_node(node)
        for stamp_ns in range(1, 21):
            command.publish(messages.chambers(NAMES, np.zeros(3), stamp_ns))
        assert command.wait_for_all_acked(Duration(seconds=LIMIT_S))
        wait_until(lambda: executor.spin_once(timeout_sec=0.02) or stamps[-1:] == [20], "the last command")
        assert stamps == list(range(1, 21))[-taken:]
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_of_a_flood_without_stamps_a_cycle_looks_at_the_newest_only(domain):
    middleware.init()
    try:
        node, limiter = Node("holder"), Limiter(Limits(), NAMES)
        ChamberInterface(node, limiter, time.monotonic_ns, lambda: node.get_clock().now().nanoseconds)
        flood = node.create_publisher(Float64MultiArray, "chambers/commands", qos.RELIABLE)
        wait_until(lambda: flood.get_subscription_count() == 1, "discovery")
        executor = EventsExecutor()
        executor.add_node(node)
        for _ in range(50):
            flood.publish(Float64MultiArray(data=[80e3, 80e3, float("nan")]))
        assert flood.wait_for_all_acked(Duration(seconds=LIMIT_S))
        wait_until(lambda: executor.spin_once(timeout_sec=0.02) or limiter.state.rejected, "the flood")
        for _ in range(20):
            executor.spin_once(timeout_sec=0.01)
        assert limiter.state.rejected == {"not finite": 1}
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_a_command_without_a_stamp_is_as_old_as_the_last_cycle(domain):
    """A message that has waited does not show when it was made."""
    middleware.init()
    try:
        node, now = Node("holder"), [10**9]
        limiter = Limiter(Limits(), NAMES)
        ChamberInterface(node, limiter, lambda: now[0], lambda: now[0])
        command = Float64MultiArray(data=[1e3, 2e3, 3e3])
        unnumbered = {"publication_sequence_number": None}
        limiter.slew(now[0])
        limiter.judge(np.zeros(3), True, now[0])
        now[0] += 1_000_000
        for _ in range(3):  # faster than the cycles
            receive(node, "chambers/commands", command, unnumbered)
        assert limiter.state.rejected == {}
        now[0] += 99_000_000  # a person presses ~/reset, and the devices take their time
        receive(node, "chambers/commands", command, unnumbered)
        assert limiter.state.rejected == {}
        now[0] += 1_000_000
        receive(node, "chambers/commands", command, unnumbered)
        assert limiter.state.rejected == {"stale": 1}
        limiter.slew(now[0])
        limiter.judge(np.zeros(3), True, now[0])
        assert "command lost" in limiter.cause
        node.destroy_node()
    finally:
        rclpy.shutdown()


@pytest.mark.process
def test_vent_service_and_a_second_source(bench):
    bench.send([30e3] * 3, 0.5)
    for _ in range(20):
        bench.array.publish(Float64MultiArray(data=[80e3, 80e3, 80e3]))
        bench.send([30e3] * 3, 0.03)
    assert bench.true_pressure().max() < 35e3
    bench.wait_rejected("second source", 15)
    bench.supervisor.call("regulator/vent", LIMIT_S)
    assert bench.fault() == "vent requested"
    bench.wait_empty()


@pytest.mark.process
def test_a_second_controller_on_the_same_topic_is_refused(bench):
    bench.send([30e3] * 3, 0.5)
    for _ in range(20):
        bench.publish([80e3] * 3, name="/bench/forgotten")
        bench.send([30e3] * 3, 0.02)
        assert bench.true_pressure().max() < 35e3
    bench.wait_rejected("second source", 20)
    bench.supervisor.call("regulator/vent", LIMIT_S)
    assert bench.fault() == "vent requested"


def refused_with_pressure(bench) -> None:
    """The latch stays while 30 kPa are commanded, whatever for."""
    bench.send([30e3] * 3, 0.3)
    with pytest.raises(SoroError, match="regulator/reset"):
        bench.supervisor.call("regulator/reset", LIMIT_S)
    assert bench.true_pressure().max() < 2e3


def works_again(bench) -> None:
    """After a reset the chambers have the pressure that is commanded."""
    bench.reset()

    def reached() -> bool:
        bench.send([30e3] * 3, 0.1)
        return abs(bench.true_pressure() - 30e3).max() < 1.5e3

    wait_until(reached, "the pressure", every_s=0.0)


@pytest.mark.process
@pytest.mark.real_time
def test_the_latch_outlasts_the_lifecycle(real_time_bench):
    bench = real_time_bench
    bench.send([30e3] * 3, 0.5)
    bench.supervisor.call("regulator/vent", LIMIT_S)
    for transition, state in (
        (Transition.TRANSITION_DEACTIVATE, "inactive"),
        (Transition.TRANSITION_CLEANUP, "unconfigured"),
        (Transition.TRANSITION_CONFIGURE, "inactive"),
        (Transition.TRANSITION_ACTIVATE, "active"),
    ):
        bench.change(transition, state)
    bench.wait_empty()
    assert bench.fault() == "vent requested"
    refused_with_pressure(bench)
    works_again(bench)


@pytest.mark.process
@pytest.mark.real_time
def test_a_driver_that_was_shut_down_is_safe_and_serves_no_request(real_time_bench):
    bench = real_time_bench
    bench.send([30e3] * 3, 0.3)
    bench.change(Transition.TRANSITION_ACTIVE_SHUTDOWN, "finalized")
    bench.wait_empty()
    for name in ("vent", "reset"):
        with pytest.raises(SoroError, match=f"regulator/{name}"):
            bench.supervisor.call(f"regulator/{name}", 0.5)
    bench.send([30e3] * 3, 0.3)
    assert bench.true_pressure().max() < 2e3
    assert bench.regulator.poll() is None
    assert bench.supervisor.status["regulator"].message == "finalized"


@pytest.mark.process
@pytest.mark.real_time
def test_a_latch_outlasts_its_process_and_a_driver_that_was_killed_leaves_one(real_time_bench):
    """Whatever starts it again, and with a source that never stops: no pressure before a reset."""
    bench = real_time_bench
    bench.send([30e3] * 3, 0.5)
    bench.regulator.kill()
    killed = bench.regulator.pid
    for named in (str(killed), "vent requested"):
        bench.regulator.communicate()
        bench.wait_empty()
        bench.start_regulator()
        assert named in bench.fault()
        refused_with_pressure(bench)
        works_again(bench)
        bench.supervisor.call("regulator/vent", LIMIT_S)
        bench.until(bench.failed, "the vent")
        bench.regulator.terminate()
    bench.regulator.communicate()
    bench.start_regulator()
    bench.reset()
    bench.regulator.terminate()  # in order, with the latch open
    bench.regulator.communicate()
    bench.start_regulator()
    bench.until(lambda: bench.supervisor.values("regulator").get("cause") == "", "an open latch")

    def pressed() -> bool:
        bench.send([30e3] * 3, 0.1)
        return bench.true_pressure().min() > 20e3

    wait_until(pressed, "pressure without a reset")


@pytest.mark.process
@pytest.mark.real_time
def test_dead_valves_are_a_named_fault_and_come_back_by_reset_only(real_time_bench):
    bench = real_time_bench
    bench.send([30e3] * 3, 0.5)
    bench.valves.kill()
    bench.valves.communicate()
    bench.until(bench.failed, "a fault")
    bench.send([0.0] * 3, 0.3)
    with pytest.raises(SoroError, match=r"valves\.pty"):
        bench.supervisor.call("regulator/reset", LIMIT_S)
    bench.link.close()
    bench.start_valves()
    bench.send([30e3] * 3, 0.5)
    assert bench.true_pressure().max() < 2e3
    works_again(bench)


@pytest.mark.process
@pytest.mark.real_time
def test_valves_that_lost_their_host_for_a_while_come_back_by_reset(real_time_bench):
    """By CANopen's default they leave OPERATIONAL, so no reading comes before the start-up."""
    bench = real_time_bench
    bench.send([30e3] * 3, 0.5)
    bench.regulator.send_signal(signal.SIGSTOP)
    wait_until(lambda: bench.true_pressure().max() < 20e3, "the valves' own vent")
    bench.regulator.send_signal(signal.SIGCONT)
    bench.until(bench.failed, "a fault")
    works_again(bench)


@pytest.mark.process
def test_without_a_device_the_node_gives_advice(node_main):
    ended = node_main("regulator")
    assert ended.status == 2
    assert set(refused_keys(ended.err)) == {"device"}
    assert "soro emulate" in ended.err
    assert "Traceback" not in ended.err


def test_rclpy_context_is_left_clean():
    assert not rclpy.ok()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    EventsExecutor()
    rclpy.shutdown()
