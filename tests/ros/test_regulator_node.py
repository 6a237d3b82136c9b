"""The driver node against emulated valves: commands of any kind on real topics, real frames below."""

import subprocess
import sys
import time

import numpy as np
import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.duration import Duration
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from soro_core.errors import HardwareError, SoroError
from soro_core.hardware.plant_link import PlantLinkClient
from soro_core.safety import Limiter, Limits
from soro_ros import messages, middleware, qos
from soro_ros.chambers import ChamberInterface
from soro_ros.diagnostics import ERROR
from soro_ros.supervisor import Supervisor
from tests.ros.running import SORO, end, patient_platform, wait_until

NAMES = ("link0/chamber0", "link0/chamber1", "link0/chamber2")


class Bench:
    """Emulated valves, a regulator node, and a person who publishes commands at 100 Hz."""

    def __init__(self, folder) -> None:
        self.processes: list[subprocess.Popen[str]] = []
        try:
            self._open(folder)
        except BaseException:
            self.end_processes()
            rclpy.try_shutdown()
            raise

    def _open(self, folder) -> None:
        platform = patient_platform(folder)
        device, self._link_path = folder / "valves.pty", folder / "plant.sock"
        self._emulate = [*SORO, "emulate", platform]
        self._emulate += ["--device-link", device, "--plant-link", self._link_path]
        self.start_valves()
        self.supervisor = Supervisor("bench")
        node = [sys.executable, "-m", "soro_ros.nodes.regulator", "--ros-args", "-r", "__ns:=/bench"]
        # A loaded test machine may stall the test's own publisher: what is tested is not its punctuality.
        settings = {"device": device, "platform": platform}
        settings |= {"limits.command_age_s": 0.5, "limits.reading_age_s": 0.5}
        parameters = [part for key, value in settings.items() for part in ("-p", f"{key}:={value}")]
        self._regulate = [*node, *parameters]
        self.regulator = self._start(self._regulate)
        self.node = Node("person", namespace="bench")
        self.command = self.node.create_publisher(JointState, "chambers/command", qos.RELIABLE)
        self.array = self.node.create_publisher(Float64MultiArray, "chambers/commands", qos.RELIABLE)
        self.supervisor._executor.add_node(self.node)
        self.supervisor.wait(
            "regulator", lambda: self.supervisor.active("regulator"), lambda: None, limit_s=30
        )
        wait_until(lambda: self._spun() and self.command.get_subscription_count() >= 1, 30, "discovery")

    def start_regulator(self) -> None:
        """Start the node anew, in place of one that has ended."""
        self.regulator = self._start(self._regulate)
        pid = str(self.regulator.pid)  # what is heard may still be of the one before
        wait_until(
            lambda: self._spun() and self.supervisor.values("regulator").get("pid") == pid, 30, "its process"
        )
        wait_until(lambda: self._spun() and self.supervisor.active("regulator"), 30, "regulator")
        wait_until(lambda: self._spun() and self.command.get_subscription_count() == 1, 30, "discovery")

    def change(self, *transitions: int) -> None:
        """Take the node through its lifecycle while 30 kPa are commanded all the time."""
        client = self.node.create_client(ChangeState, "regulator/change_state")
        for number in transitions:
            request = ChangeState.Request(transition=Transition(id=number))
            wait_until(client.service_is_ready, 20, "service")
            answer = client.call_async(request)
            wait_until(lambda a=answer: self.send([30e3] * 3, 0.02) or a.done(), 20, "transition")
            assert answer.result().success
        self.node.destroy_client(client)

    def _start(self, command: list[object]) -> subprocess.Popen[str]:
        arguments = [str(part) for part in command]
        process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.processes.append(process)
        return process

    def start_valves(self) -> None:
        """Start the emulated valves, and read their true pressures."""
        self.valves = self._start(self._emulate)
        wait_until(self._connected, 20, "emulated valves")

    def _connected(self) -> bool:
        try:
            self.link = PlantLinkClient(self._link_path)
        except HardwareError:
            return False
        return True

    def _spun(self) -> bool:
        self.supervisor.spin(0.02)
        return True

    def send(self, pressure_pa, seconds: float, age_s: float = 0.0) -> None:
        """Publish one command over and over."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            stamp_ns = self.node.get_clock().now().nanoseconds - round(age_s * 1e9)
            self.command.publish(messages.chambers(NAMES, np.array(pressure_pa, dtype=float), stamp_ns))
            self.supervisor.spin(0.01)

    def true_pressure(self) -> np.ndarray:
        self.link.latest()  # what has piled up while nobody read
        time.sleep(0.01)
        return self.link.latest().pressures

    def fault(self) -> str:
        """Message of the regulator once it reports an error."""
        wait_until(lambda: self._spun() and self._failed(), 10, "a fault")
        return self.supervisor.status["regulator"].message

    def _failed(self) -> bool:
        return "regulator" in self.supervisor.status and self.supervisor.status["regulator"].level == ERROR

    def rejected(self, kind: str) -> int:
        """Commands of a kind that the regulator says it refused; diagnostics come once a second."""
        return int(self.supervisor.values("regulator").get(f"rejected {kind}", 0))

    def wait_rejected(self, kind: str, least: int) -> None:
        wait_until(lambda: self._spun() and self.rejected(kind) >= least, 10, f"{least} refusals: {kind}")

    def close(self) -> list[int]:
        self.node.destroy_node()
        self.supervisor.__exit__()
        self.link.close()
        return [process.returncode for process in self.end_processes()]

    def end_processes(self) -> list[subprocess.Popen[str]]:
        """End the regulator first, then its valves."""
        for process in reversed(self.processes):
            if not process.stdout.closed:
                end(process)
        return self.processes


@pytest.fixture
def bench(domain, tmp_path):
    it = Bench(tmp_path)
    yield it
    assert set(it.close()) <= {0, -9}  # -9: killed by the test


@pytest.mark.timeout(120)
def test_a_command_arrives_and_silence_vents_and_reset_needs_a_zero_command(bench):
    bench.send([40e3, 20e3, 0.0], 1.2)
    assert bench.true_pressure() == pytest.approx([40e3, 20e3, 0.0], abs=1.5e3)
    assert bench.fault().startswith("vented: command lost")
    wait_until(lambda: bench.true_pressure().max() < 2e3, 5, "vent")
    bench.send([30e3] * 3, 0.3)
    assert bench.true_pressure().max() < 2e3  # latched
    with pytest.raises(SoroError, match="still asks for pressure"):
        bench.supervisor.call("regulator/reset")
    bench.send([0.0] * 3, 0.3)
    assert bench.supervisor.call("regulator/reset") == "reset"
    bench.send([30e3] * 3, 1.0)
    assert bench.true_pressure() == pytest.approx([30e3] * 3, abs=1.5e3)


@pytest.mark.timeout(120)
@pytest.mark.parametrize(
    ("bad", "age_s", "kind"),
    [
        ([float("nan"), 0, 0], 0.0, "not finite"),
        ([float("inf"), 0, 0], 0.0, "not finite"),
        ([95e3, 0, 0], 0.0, "out of range"),
        ([-1e3, 0, 0], 0.0, "out of range"),
        ([20e3, 0, 0], 1.0, "stale"),
    ],
)
def test_a_stream_of_bad_commands_never_reaches_a_valve_and_vents(bench, bad, age_s, kind):
    bench.send([30e3] * 3, 1.0)
    bench.send(bad, 1.0, age_s)
    assert bench.fault().startswith("vented: command lost")
    wait_until(lambda: bench.true_pressure().max() < 2e3, 5, "vent")
    bench.wait_rejected(kind, 10)


@pytest.mark.timeout(120)
def test_refusals_are_a_warning_while_they_last(bench):
    bench.send([30e3] * 3, 0.3)
    bench.send([95e3, 0, 0], 0.2)
    until = time.monotonic() + 4.0
    seen = set()
    while time.monotonic() < until:
        bench.send([30e3] * 3, 0.1)
        seen.add(bench.supervisor.status["regulator"].message)
    assert seen == {"active", "commands refused"}
    assert bench.supervisor.status["regulator"].message == "active"
    assert bench.rejected("out of range") >= 1  # only the newest of those that waited is looked at


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
        wait_until(lambda: command.get_subscription_count() == 1, 20, "discovery")
        executor = EventsExecutor()
        executor.add_node(node)
        for stamp_ns in range(1, 21):
            command.publish(messages.chambers(NAMES, np.zeros(3), stamp_ns))
        time.sleep(0.3)
        for _ in range(30):
            executor.spin_once(timeout_sec=0.05)
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
        wait_until(lambda: flood.get_subscription_count() == 1, 20, "discovery")
        executor = EventsExecutor()
        executor.add_node(node)
        for _ in range(50):
            flood.publish(Float64MultiArray(data=[80e3, 80e3, float("nan")]))
        assert flood.wait_for_all_acked(Duration(seconds=10.0))
        for _ in range(60):
            executor.spin_once(timeout_sec=0.02)
        assert limiter.state.rejected == {"not finite": 1}
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_a_command_without_a_stamp_is_as_old_as_the_last_cycle(domain):
    """What has waited while the node was held up says nothing of when it was made."""
    middleware.init()
    try:
        node, now = Node("holder"), [10**9]
        limiter = Limiter(Limits(), NAMES)
        chambers = ChamberInterface(node, limiter, lambda: now[0], lambda: now[0])
        command = Float64MultiArray(data=[1e3, 2e3, 3e3])
        limiter.judge(np.zeros(3), True, now[0])
        now[0] += 1_000_000
        for _ in range(3):  # faster than the cycles
            chambers._on_array(command)
        assert limiter.state.rejected == {}
        now[0] += 99_000_000  # a person presses ~/reset, and the devices take their time
        chambers._on_array(command)
        assert limiter.state.rejected == {}
        now[0] += 1_000_000
        chambers._on_array(command)
        assert limiter.state.rejected == {"stale": 1}
        limiter.judge(np.zeros(3), True, now[0])
        assert "command lost" in limiter.cause
        node.destroy_node()
    finally:
        rclpy.shutdown()


@pytest.mark.timeout(120)
def test_vent_service_and_a_second_source(bench):
    bench.send([30e3] * 3, 0.5)
    for _ in range(20):
        bench.array.publish(Float64MultiArray(data=[80e3, 80e3, 80e3]))
        bench.send([30e3] * 3, 0.03)
    assert bench.true_pressure().max() < 35e3
    assert bench.supervisor.call("regulator/vent") == "vented until ~/reset"
    assert bench.fault() == "vented: vent requested"
    bench.wait_rejected("second source", 15)
    wait_until(lambda: bench.true_pressure().max() < 2e3, 5, "vent")


@pytest.mark.timeout(120)
def test_a_second_controller_on_the_same_topic_is_refused(bench):
    bench.send([30e3] * 3, 0.5)
    until = time.monotonic() + 20.0
    while bench.rejected("second source") < 15:  # the node takes the newest alone: some are never seen
        assert time.monotonic() < until
        rogue = messages.chambers(NAMES, np.full(3, 80e3), bench.node.get_clock().now().nanoseconds)
        rogue.header.frame_id = "/bench/forgotten"
        bench.command.publish(rogue)
        bench.supervisor.spin(0.01)
        bench.send([30e3] * 3, 0.02)
        assert bench.true_pressure().max() < 35e3
    assert bench.supervisor.call("regulator/vent") == "vented until ~/reset"
    assert bench.fault() == "vented: vent requested"


@pytest.mark.timeout(120)
def test_the_latch_outlasts_the_lifecycle(bench):
    bench.send([30e3] * 3, 0.5)
    bench.supervisor.call("regulator/vent")
    round_trip = (
        Transition.TRANSITION_DEACTIVATE,
        Transition.TRANSITION_CLEANUP,
        Transition.TRANSITION_CONFIGURE,
        Transition.TRANSITION_ACTIVATE,
    )
    bench.change(*round_trip)
    bench.send([30e3] * 3, 0.5)
    assert bench.true_pressure().max() < 2e3
    assert bench.fault() == "vented: vent requested"
    with pytest.raises(SoroError, match="still asks for pressure"):
        bench.supervisor.call("regulator/reset")
    bench.send([0.0] * 3, 0.3)
    assert bench.supervisor.call("regulator/reset") == "reset"
    bench.send([30e3] * 3, 0.7)
    assert bench.true_pressure().min() > 20e3


@pytest.mark.timeout(120)
def test_a_latch_outlasts_its_process_and_a_driver_that_was_killed_leaves_one(bench):
    """Whatever starts it again, and with a source that never stops: no pressure before a reset."""
    bench.send([30e3] * 3, 0.5)
    bench.regulator.kill()
    killed = bench.regulator.pid
    for cause in (
        f"vented: the last driver, process {killed}, ended without venting",
        "vented: vent requested",
    ):
        bench.regulator.communicate()
        wait_until(lambda: bench.true_pressure().max() < 2e3, 5, "vent")
        bench.start_regulator()
        bench.send([30e3] * 3, 0.5)
        assert bench.fault() == cause
        assert bench.true_pressure().max() < 2e3
        bench.send([0.0] * 3, 0.3)
        assert bench.supervisor.call("regulator/reset") == "reset"
        bench.send([30e3] * 3, 0.7)
        assert bench.true_pressure().min() > 20e3
        bench.supervisor.call("regulator/vent")
        bench.send([30e3] * 3, 0.3)
        bench.regulator.terminate()
    bench.regulator.communicate()
    bench.start_regulator()
    bench.send([0.0] * 3, 0.3)
    bench.supervisor.call("regulator/reset")
    bench.send([0.0] * 3, 0.1)
    bench.regulator.terminate()  # in order, with the latch open
    out, err = bench.regulator.communicate()
    assert "vented" not in out + err[err.rindex("vent requested") :][len("vent requested") :]
    bench.start_regulator()
    bench.send([30e3] * 3, 0.7)
    assert bench.true_pressure().min() > 20e3, bench.supervisor.status["regulator"].message


@pytest.mark.timeout(120)
def test_dead_valves_are_a_named_fault_and_come_back_by_reset_only(bench):
    bench.send([30e3] * 3, 0.5)
    bench.valves.kill()
    bench.valves.communicate()
    assert bench.fault().startswith("vented: ")
    bench.send([0.0] * 3, 0.3)
    with pytest.raises(SoroError, match=r"valves\.pty"):
        bench.supervisor.call("regulator/reset")
    bench.link.close()
    bench.start_valves()
    bench.send([30e3] * 3, 0.5)
    assert bench.true_pressure().max() < 2e3
    bench.send([0.0] * 3, 0.3)
    assert bench.supervisor.call("regulator/reset") == "reset"
    bench.send([30e3] * 3, 1.0)
    assert bench.true_pressure() == pytest.approx([30e3] * 3, abs=1.5e3)


def test_without_a_device_the_node_says_what_to_do(domain):
    command = [sys.executable, "-m", "soro_ros.nodes.regulator"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "device: got ''; allowed: the path or address of the devices" in done.stderr


def test_rclpy_context_is_left_clean():
    assert not rclpy.ok()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    EventsExecutor()
    rclpy.shutdown()
