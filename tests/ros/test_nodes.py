"""Each node alone, without parameters, and the controller's reference topics."""

import subprocess
import sys
import time

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.duration import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soro_core.errors import HardwareError, SoroError
from soro_core.hardware.port import Exchange, Fault
from soro_core.scene import ControllerNodeConfig, EstimatorNodeConfig, RegulatorNodeConfig, load_scene
from soro_core.twin import TwinConfig
from soro_ros import lifecycle, messages, middleware, parameters, qos
from soro_ros import supervisor as supervisor_module
from soro_ros.diagnostics import Diagnostics
from soro_ros.nodes import regulator
from soro_ros.nodes.controller import ControllerNode
from soro_ros.supervisor import Supervisor
from tests.ros.running import SORO, end, wait_until

COORDINATES = ("link0/elongation", "link0/bending_x", "link0/bending_y")
CHAMBERS = ("link0/chamber0", "link0/chamber1", "link0/chamber2")


def start(name: str, *settings: str) -> subprocess.Popen[str]:
    options = [option for setting in settings for option in ("-p", setting)]
    command = [sys.executable, "-m", f"soro_ros.nodes.{name}", "--ros-args", "-r", "__ns:=/alone", *options]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.timeout(120)
@pytest.mark.parametrize("name", ["estimator", "controller", "twin"])
def test_a_node_without_parameters_configures_the_default_robot(domain, name):
    with Supervisor("alone") as supervisor:
        process = start(name)
        try:
            supervisor.wait(name, lambda: supervisor.active(name), lambda: None, 90)
        finally:
            status, _, err = end(process)
    assert status == 0, err


@pytest.mark.parametrize(
    ("name", "arguments", "says"),
    [
        ("controller", ["--ros-args", "--params-file", "/nope.yaml"], "/nope.yaml: got 'no such file'"),
        ("twin", ["--ros-args", "--params-file", "BROKEN"], "broken.yaml: got"),
        ("controller", ["-p", "x:=1"], "command line of controller: got '-p x:=1'; allowed: ROS arguments"),
        ("recorder", ["--ros-args", "--wrong"], "--wrong"),
        ("controller", ["--ros-args", "-p", "x"], "Couldn't parse parameter override rule: '-p x'"),
        ("controller", ["--ros-args", "-p", "robot:=silicone_rod"], "silicone_rod, which has no chambers"),
        ("twin", ["--ros-args", "-p", "refine:=0"], "refine: got 0; allowed"),
        ("twin", ["--ros-args", "-p", "plant_link:=/tmp/x.sock"], "plant_link: got '/tmp/x.sock'; allowed"),
        ("twin", ["--ros-args", "-p", "pressures:=valves"], "plant_link: got ''; allowed"),
    ],
)
def test_a_wrong_command_line_is_one_line_and_exit_status_2(domain, tmp_path, name, arguments, says):
    (tmp_path / "broken.yaml").write_text("a: [\n")
    given = [str(tmp_path / "broken.yaml") if part == "BROKEN" else part for part in arguments]
    command = [sys.executable, "-m", f"soro_ros.nodes.{name}", *given]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2, done.stderr
    assert says in done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    # What rcl and the logger of the node print beside it stands in brackets.
    assert sum(not line.startswith("[") for line in done.stderr.strip().splitlines()) <= 1, done.stderr


def test_a_node_explains_its_parameters():
    command = [sys.executable, "-m", "soro_ros.nodes.regulator", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "usage: soro_regulator [--ros-args" in done.stdout
    assert "device ['']: adapter or port" in done.stdout
    assert "limits.maximum_pa [90000.0]: highest set point" in done.stdout


def test_the_defaults_of_parameters_are_those_of_the_model():
    for config in (RegulatorNodeConfig(), EstimatorNodeConfig(), ControllerNodeConfig(), TwinConfig()):
        shown = {name: default for name, default, _ in parameters.described(type(config))}
        assert shown == parameters.overrides(config)


@pytest.mark.parametrize(("mode", "priority"), [("real_time", 20), ("lockstep", 0)])
def test_a_node_asks_for_its_priority_in_real_time_only(domain, mode, priority):
    middleware.init(["--ros-args", "-p", f"mode:={mode}"])
    try:
        node = ControllerNode()
        assert lifecycle._priority(node) == priority
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_priorities_are_the_higher_the_nearer_to_the_valves():
    scene = load_scene("track_circle")
    for nodes in (
        (RegulatorNodeConfig(), EstimatorNodeConfig(), ControllerNodeConfig(), TwinConfig()),
        (scene.regulator_node(), scene.estimator_node(), scene.controller_node(), scene.twin_node()),
    ):
        assert [node.priority for node in nodes] == [30, 20, 20, 10]


def change(supervisor: Supervisor, name: str, transition: int) -> bool:
    """Ask for a lifecycle transition."""
    client = supervisor._node.create_client(ChangeState, f"{name}/change_state")
    assert client.wait_for_service(timeout_sec=10)
    request = ChangeState.Request(transition=Transition(id=transition))
    future = client.call_async(request)
    deadline = time.monotonic() + 60
    while not future.done():
        supervisor.spin(0.02)
        assert time.monotonic() < deadline
    supervisor._node.destroy_client(client)
    return bool(future.result().success)


@pytest.mark.timeout(200)
@pytest.mark.parametrize("name", ["estimator", "controller", "twin", "regulator", "recorder"])
def test_a_node_lives_through_its_lifecycle_twice(domain, tmp_path, name):
    settings, valves = ["autostart:=false"], None
    if name == "regulator":
        device = tmp_path / "valves.pty"
        command = [*SORO, "emulate", "emulated_canopen", "--device-link", str(device)]
        valves = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        wait_until(device.exists, 20, "emulated valves")
        settings.append(f"device:={device}")
    if name == "recorder":
        settings.append(f"folder:={tmp_path / 'bag'}")
    with Supervisor("alone") as supervisor:
        process = start(name, *settings)
        try:
            supervisor.wait(name, lambda: name in supervisor.status, lambda: None, 30)
            supervisor.spin(1.5)  # two rounds of diagnostics before anything is configured
            assert process.poll() is None, process.communicate()
            steps = [Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE]
            if name != "recorder":  # a bag is written once
                steps += [Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE]
                steps += [Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP]
                steps += [Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE]
            for step in steps:
                assert change(supervisor, name, step), step
            supervisor.wait(name, lambda: supervisor.active(name), lambda: None, 20)
            services = dict(supervisor._node.get_service_names_and_types_by_node(name, "/alone"))
            assert len(services) == len(set(services))
            if name == "regulator":
                assert supervisor.call("regulator/vent") == "vented until ~/reset"
                assert supervisor.call("regulator/reset") == "reset"
        finally:
            status, _, err = end(process)
            if valves is not None:
                end(valves)
    assert status == 0, err


def test_the_controller_of_a_scene_asks_for_nothing_that_its_limits_refuse():
    scene = load_scene("track_circle", {"limits.maximum_pa": 20e3})
    assert scene.controller_node().control.pressures.maximum_pa == 20e3
    assert scene.controller.pressures.maximum_pa == 90e3
    wide = load_scene("track_circle", {"controller.pressures.maximum_pa": 40e3})
    assert wide.controller_node().control.pressures.maximum_pa == 40e3


class Unwilling:
    """Regulators whose start-up fails after something has been opened."""

    n_chambers, is_closed = 3, False

    def configure(self):
        raise HardwareError("valves: no answer")

    def vent(self):
        pass

    def close(self):
        self.is_closed = True


def test_a_start_up_that_fails_lets_go_of_what_it_has_opened(domain, monkeypatch):
    """Else a second try finds the port in use, by this very node."""
    made = []
    monkeypatch.setattr(regulator, "open_regulator", lambda *_, **__: made.append(Unwilling()) or made[-1])
    middleware.init(["--ros-args", "-p", "device:=x", "-p", "autostart:=false"])
    try:
        node = regulator.RegulatorNode()
        before = len(list(node.services))
        for tries in (1, 2):
            node.trigger_configure()
            assert "valves: no answer" in str(node.failure)
            assert [it.is_closed for it in made] == [True] * tries
            assert len(list(node.services)) == before
        node.destroy_node()
    finally:
        rclpy.shutdown()


class Answering:
    """Regulators that do what they are told, and remember being told to vent."""

    chamber_names, n_chambers, update_hz, reading_age_s, statistics = CHAMBERS, 3, 1000.0, 0.0, None

    def __init__(self):
        self.vents, self.faults = 0, ()

    def configure(self):
        pass

    def exchange(self, setpoint_pa, now_ns):
        return Exchange(setpoint_pa, setpoint_pa, np.full(3, True), self.faults)

    def vent(self):
        self.vents += 1

    def close(self):
        pass


@pytest.mark.parametrize("closing", ["fault", "deactivated"])
def test_a_latch_that_closes_tells_the_regulators_to_vent(domain, monkeypatch, closing):
    """Zero set points alone are slewed by some, and a node that is not active sends none."""
    devices = Answering()
    monkeypatch.setattr(regulator, "open_regulator", lambda *_, **__: devices)
    middleware.init(["--ros-args", "-p", "device:=x", "-p", "autostart:=false"])
    try:
        node = regulator.RegulatorNode()
        node.trigger_configure()
        node.trigger_activate()
        node._cycle()
        assert devices.vents == 0
        if closing == "fault":
            devices.faults = (Fault("rebooted", CHAMBERS[0], "has restarted", latched=True),)
            node._cycle()
        else:
            node.trigger_deactivate()
        assert devices.vents == 1
        assert "rebooted" in node._guarded.cause or node._guarded.cause == "deactivated"
        node.make_safe()
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_a_chamber_that_keeps_its_pressure_is_told_once_and_keeps_the_latch(domain, monkeypatch, capfd):
    devices = Answering()
    kept_pa = np.array([0.0, 40e3, 0.0])
    monkeypatch.setattr(devices, "exchange", lambda sent, _: Exchange(sent, kept_pa.copy(), np.full(3, True)))
    monkeypatch.setattr(regulator, "open_regulator", lambda *_, **__: devices)
    parameters = ["-p", "device:=x", "-p", "autostart:=false", "-p", "limits.vent_limit_s:=0.1"]
    middleware.init(["--ros-args", *parameters])
    try:
        node = regulator.RegulatorNode()
        node.trigger_configure()
        node._chambers._on_vent(Trigger.Request(), Trigger.Response())
        assert devices.vents == 1, "at once, and also while the node is inactive"
        wait_until(lambda: node._cycle() or node._guarded.not_vented, 5, "what is kept")
        for _ in range(5):
            node._cycle()
        said = node._guarded.not_vented
        assert said.startswith("link0/chamber1 still at 40.0 kPa ")
        assert node.diagnostics.status.message == f"vented: vent requested; {said}"
        assert capfd.readouterr().err.count(said) == 1
        answer = node._chambers._on_reset(Trigger.Request(), Trigger.Response())
        assert (answer.success, answer.message) == (False, said)
        kept_pa[:] = 0.0
        node._cycle()
        assert node.diagnostics.status.message == "vented: vent requested"
        assert node._chambers._on_reset(Trigger.Request(), Trigger.Response()).success
        node.make_safe()
        node.destroy_node()
    finally:
        rclpy.shutdown()


@pytest.mark.parametrize("silent", [False, True])
def test_a_node_that_says_nothing_any_more_is_told_of(domain, monkeypatch, silent):
    monkeypatch.setattr(supervisor_module, "SILENT_S", 0.5)
    with Supervisor("alone") as supervisor:
        node = Node("controller", namespace="alone")
        diagnostics = Diagnostics(node)
        wait_until(lambda: diagnostics.publish() or supervisor.spin(0.02) or supervisor.status, 20, "status")
        until = time.monotonic() + 0.8
        while time.monotonic() < until:
            supervisor.spin(0.02)
            if not silent:
                diagnostics.publish()
        supervisor.check_heard(["recorder"])  # never heard: it is waited for elsewhere
        if silent:
            with pytest.raises(SoroError, match="controller: has said nothing for 1 s"):
                supervisor.check_heard(["recorder", "controller"])
        else:
            supervisor.check_heard(["recorder", "controller"])
        node.destroy_node()


class Person:
    """Publishes a straight arm at rest, and listens to what the controller wants of it."""

    def __init__(self, supervisor: Supervisor) -> None:
        self.supervisor = supervisor
        self.node = Node("person", namespace="alone")
        self.state = self.node.create_publisher(JointState, "arm/state", qos.RELIABLE)
        self.reading = self.node.create_publisher(JointState, "chambers/state", qos.RELIABLE)
        self.trajectory = self.node.create_publisher(
            JointTrajectory, "arm/reference/trajectory", qos.RELIABLE
        )
        self.tip = self.node.create_publisher(PoseStamped, "arm/reference/tip", qos.RELIABLE)
        self.commands: list[list[float]] = []
        self.wanted = np.zeros(3)
        self.node.create_subscription(JointState, "chambers/command", self._on_command, qos.RELIABLE)
        self.node.create_subscription(PoseStamped, "arm/desired/tip", self._on_wanted, qos.RELIABLE)
        supervisor._executor.add_node(self.node)

    def _on_command(self, message: JointState) -> None:
        self.commands.append(list(message.effort))

    def _on_wanted(self, message: PoseStamped) -> None:
        self.wanted = messages.pose_arrays(message.pose)[0]

    def hold(self, until, limit_s: float) -> None:
        """Publish the arm's state until something is true."""
        deadline = time.monotonic() + limit_s
        while not until():
            assert time.monotonic() < deadline
            stamp_ns = self.node.get_clock().now().nanoseconds
            self.reading.publish(messages.chambers(CHAMBERS, np.zeros(3), stamp_ns))
            self.state.publish(
                messages.arm_state(COORDINATES, np.zeros(3), np.zeros(3), np.zeros(3), stamp_ns)
            )
            self.supervisor.spin(0.01)


@pytest.mark.timeout(150)
def test_references_come_by_topic_and_wrong_ones_are_refused(domain):
    with Supervisor("alone") as supervisor:
        process = start("controller", "control.reference.kind:=hold", "control.reference.start_s:=0.3")
        try:
            person = Person(supervisor)
            supervisor.wait("controller", lambda: supervisor.active("controller"), lambda: None, 90)
            # Started alone it asks for no air until somebody says so.
            person.hold(lambda: len(person.commands) > 20, 20)
            assert np.all(np.array(person.commands) == 0.0)
            assert supervisor.call("controller/enable") == "enabled"
            person.commands.clear()
            person.hold(lambda: len(person.commands) > 5, 20)
            assert person.wanted == pytest.approx([0, 0, 0.064], abs=1e-6)

            points = [([0.05, 0, 0], 0.4), ([0.1, 0, 0], 0.8)]
            person.trajectory.publish(trajectory(COORDINATES, points))
            person.hold(lambda: abs(person.wanted[2] - 0.064 * 1.1) < 1e-6, 20)

            person.trajectory.publish(trajectory(("link0/elongation", "link9/bending_x", "x"), points))
            person.hold(lambda: "reference refused" in supervisor.status["controller"].message, 20)
            assert person.wanted[2] == pytest.approx(0.064 * 1.1, abs=1e-6)

            person.tip.publish(messages.pose_stamped(tip_pose(0.01, 0.0, 0.066), 0, "world"))
            person.hold(lambda: np.linalg.norm(person.wanted - [0.01, 0.0, 0.066]) < 1e-3, 20)
            person.tip.publish(messages.pose_stamped(tip_pose(0.5, 0.0, 0.5), 0, "world"))
            person.hold(
                lambda: "a point that the tip can reach" in supervisor.status["controller"].message, 20
            )

            assert supervisor.call("controller/vent") == "commanding zero until ~/enable"
            person.commands.clear()
            person.hold(lambda: len(person.commands) > 10, 20)
            assert np.all(np.array(person.commands[5:]) == 0.0)
            person.node.destroy_node()
        finally:
            status, _, err = end(process)
    assert status == 0, err


def trajectory(names, points) -> JointTrajectory:
    rows = [
        JointTrajectoryPoint(positions=[float(v) for v in q], time_from_start=Duration(seconds=t).to_msg())
        for q, t in points
    ]
    return JointTrajectory(joint_names=list(names), points=rows)


def tip_pose(x: float, y: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose
