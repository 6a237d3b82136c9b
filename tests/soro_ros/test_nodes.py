"""Each node alone, without parameters, and the controller's reference topics."""

import contextlib
import functools
import itertools
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.duration import Duration
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soro_core.errors import ConfigError, HardwareError, SoroError
from soro_core.twin import TwinConfig
from soro_hardware.port import BusStatistics, Exchange, Fault
from soro_lab.scene import (
    ControllerNodeConfig,
    EstimatorNodeConfig,
    ExciterNodeConfig,
    RegulatorNodeConfig,
    load_scene,
)
from soro_ros.conversion import messages, qos
from soro_ros.host import middleware, services
from soro_ros.host.latch_file import LatchFile
from soro_ros.nodes import regulator
from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.recorder import Recorder
from soro_ros.nodes.shadow import ShadowNode
from soro_ros.nodes.twin import TwinNode
from soro_ros.process import command_line, node_process, parameters
from soro_ros.run import supervisor as supervisor_module
from soro_ros.run.processes import NodeError
from soro_ros.run.supervisor import RunMonitor
from soro_ros.status_words import is_requested
from soro_ros.topics.diagnostics import ERROR, OK, Diagnostics
from tests.patience import COMPILED_S, LIMIT_S, patient_platform
from tests.refused import refused_keys
from tests.soro_ros.direct import active, fire, receive, request, values
from tests.soro_ros.running import SORO, end, wait_until
from tests.warm import Popen

COORDINATES = ("link0/elongation", "link0/bending_x", "link0/bending_y")
CHAMBERS = ("link0/chamber0", "link0/chamber1", "link0/chamber2")
# Period of the regulator node by default.
CYCLE_S = 5e-3


def start(name: str, *settings: str) -> subprocess.Popen[str]:
    options = [option for setting in settings for option in ("-p", setting)]
    command = [sys.executable, "-m", f"soro_ros.nodes.{name}", "--ros-args", "-r", "__ns:=/alone", *options]
    return Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.process
@pytest.mark.parametrize(
    ("name", "arguments", "key", "names"),
    [
        ("controller", ["--ros-args", "--params-file", "/nope.yaml"], "/nope.yaml", ()),
        ("twin", ["--ros-args", "--params-file", "BROKEN"], "BROKEN", ()),
        ("controller", ["-p", "x:=1"], "controller", ("-p x:=1",)),
        ("recorder", ["--ros-args", "--wrong"], "recorder", ("--wrong",)),
        ("controller", ["--ros-args", "-p", "x"], "controller", ("'-p x'",)),
        ("controller", ["--ros-args", "-p", "robot:=silicone_rod"], "robot", ("silicone_rod",)),
        ("twin", ["--ros-args", "-p", "refine:=0"], "refine", ()),
        ("twin", ["--ros-args", "-p", "plant_link:=/tmp/x.sock"], "plant_link", ("/tmp/x.sock",)),
        ("twin", ["--ros-args", "-p", "pressures:=valves"], "plant_link", ("''",)),
    ],
)
def test_a_wrong_command_line_is_one_line_and_exit_status_2(node_main, tmp_path, name, arguments, key, names):
    broken = str(tmp_path / "broken.yaml")
    Path(broken).write_text("a: [\n")
    ended = node_main(name, *(broken if part == "BROKEN" else part for part in arguments))
    assert ended.status == 2, ended.err
    assert set(refused_keys(ended.err)) == {broken if key == "BROKEN" else key}
    assert all(part in ended.err for part in names)
    assert "Traceback" not in ended.out + ended.err
    # What rcl and the logger of the node print beside it stands in brackets.
    assert sum(not line.startswith("[") for line in ended.err.strip().splitlines()) <= 1, ended.err


INTERRUPTED = """
import os, signal
from soro_core.errors import ConfigError
from soro_ros.process.node_process import run_node
from soro_ros.nodes.estimator import EstimatorNode

class Refuses(EstimatorNode):
    def setup(self, config):
        raise ConfigError("here", "key", 1, "2")

    def make_safe(self):
        os.kill(os.getpid(), signal.SIGINT)

run_node(Refuses)
"""


@pytest.mark.process
def test_a_node_that_is_interrupted_after_it_has_refused_ends_with_status_2(domain):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=2 * LIMIT_S
    )
    assert done.returncode == 2, done.stderr


class Unready(Recorder):
    """Refuses its first configuration; a person asks for the second one, and ends the process."""

    def __init__(self, stopping: list[int]) -> None:
        super().__init__()
        self._tries, self._stopping, self.seen = 0, stopping, []
        self.create_timer(0.01, self._try_again)

    def setup(self, config):
        self._tries += 1
        if self._tries == 1:
            raise ConfigError("here", "key", 1, "2")
        super().setup(config)

    def _try_again(self):
        status = self.diagnostics.status
        self.seen.append((status.level, status.message))
        if len(self.seen) == 1:
            self.trigger_configure()
        else:
            self._stopping.append(signal.SIGINT)


@pytest.mark.parametrize("ends", [False, True])
def test_a_node_that_refuses_its_configuration_stays_unless_it_is_to_end(domain, tmp_path, capfd, ends):
    stopping, made = [], []
    words = (f"end_on_failed_start:={str(ends).lower()}", f"folder:={tmp_path / 'bag'}")
    arguments = ["--ros-args", *(part for word in words for part in ("-p", word))]

    def noted():
        made.append(Unready(stopping))
        return made[0]

    program = command_line.of_node(Unready.node_name, Unready.config_model)
    status = node_process.run_until_end([noted], program, arguments, stopping)
    said = capfd.readouterr().err
    assert refused_keys(said) == ["key"]
    if ends:
        assert (status, made[0].seen) == (2, [])
        return
    assert status == 0
    assert made[0].seen == [(ERROR, "here: key: got 1; allowed: 2"), (OK, "inactive")]
    assert "ros2 lifecycle set /recorder configure" in said


def test_a_node_subscribes_by_the_names_that_rclpy_gives_its_parameters(domain):
    rclpy.init()
    try:
        node = Recorder()
        made = node.create_subscription(msg_type=JointState, topic="x", callback=print, qos_profile=1)
        assert (made.topic_name, made.msg_type) == ("/x", JointState)
        node.destroy_node()
    finally:
        rclpy.shutdown()


def test_a_node_explains_its_parameters(node_main):
    ended = node_main("regulator", "--help")
    assert ended.status == 0, ended.err
    for part in ("soro_regulator", "--ros-args", "device ['']: ", "limits.maximum_pa [90000.0]: "):
        assert part in ended.out
    assert "highest set point (above 0, below 1e+06)" in ended.out


def test_the_defaults_of_parameters_are_those_of_the_model():
    for config in (
        RegulatorNodeConfig(),
        EstimatorNodeConfig(),
        ControllerNodeConfig(),
        ExciterNodeConfig(),
        TwinConfig(),
    ):
        shown = {name: default for name, default, _ in parameters.described(type(config))}
        assert shown == parameters.overrides(config)


@pytest.mark.parametrize(("mode", "priority"), [("real_time", 20), ("lockstep", 0)])
def test_a_node_asks_for_its_priority_in_real_time_only(domain, mode, priority):
    middleware.init(["--ros-args", "-p", f"mode:={mode}"])
    try:
        node = ControllerNode()
        assert node.priority == priority
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


@pytest.mark.slow
def test_emulated_valves_ask_for_a_priority_as_the_nodes_do(soro, monkeypatch, tmp_path):
    def refuse(*_):
        raise PermissionError("not permitted")

    monkeypatch.setattr("os.sched_setscheduler", refuse)
    nowhere = ("--device-link", str(tmp_path / "no" / "folder"))
    for options, asks in (((), True), (("--priority", "0"), False), (("--lockstep",), False)):
        ended = soro("emulate", "emulated_canopen", *nowhere, *options)
        assert ended.status == 1
        assert ("no real-time priority (not permitted)" in ended.err) is asks


def test_a_lone_controller_holds_the_arm_where_it_is():
    assert ControllerNodeConfig().control.reference.kind == "hold"
    assert load_scene("track_circle").controller_node().control.reference.kind == "circle"


def test_a_shadow_starts_with_its_defaults(domain):
    middleware.init(["--ros-args"])
    try:
        node = ShadowNode()
        node.trigger_configure()
        assert node.failure is None
    finally:
        rclpy.shutdown()


STATES = {
    Transition.TRANSITION_CONFIGURE: "inactive",
    Transition.TRANSITION_ACTIVATE: "active",
    Transition.TRANSITION_DEACTIVATE: "inactive",
    Transition.TRANSITION_CLEANUP: "unconfigured",
}


def change(supervisor: RunMonitor, name: str, transition: int) -> None:
    """Ask for a lifecycle transition, and wait until the node reports the state that it leads to.

    Not for the answer: the middleware drops one to a client that the server has not discovered within 0.1 s.
    """
    request = ChangeState.Request(transition=Transition(id=transition))
    call = services.Call(supervisor.node, ChangeState, f"{name}/change_state", request)

    def changed() -> bool:
        supervisor.spin(0.02)
        if call.done():
            assert call.response.success, transition
        return supervisor.values(name)["lifecycle"] == STATES[transition]

    with contextlib.closing(call):
        wait_until(changed, f"transition {transition}", COMPILED_S)


@pytest.mark.process
@pytest.mark.parametrize("name", ["estimator", "controller", "twin", "regulator", "recorder"])
def test_a_node_lives_through_its_lifecycle_twice(domain, tmp_path, name):
    """On the default robot, where no parameter names another."""
    settings, valves = ["autostart:=false"], None
    if name == "regulator":
        device, platform = tmp_path / "valves.pty", patient_platform(tmp_path)
        command = [*SORO, "emulate", str(platform), "--device-link", str(device)]
        valves = Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        wait_until(device.exists, "emulated valves")
        settings += [f"device:={device}", f"platform:={platform}"]
    if name == "recorder":
        settings.append(f"folder:={tmp_path / 'bag'}")
    with RunMonitor("alone") as supervisor:
        process = start(name, *settings)
        try:
            supervisor.wait(name, lambda: name in supervisor.status, lambda: None, LIMIT_S)
            supervisor.spin(1.5)  # two rounds of diagnostics before anything is configured
            assert process.poll() is None, process.communicate()
            steps = [Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE]
            if name != "recorder":  # a bag is written once
                steps += [Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE]
                steps += [Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP]
                steps += [Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE]
            for step in steps:
                change(supervisor, name, step)
            known = [
                service for service, _ in supervisor.node.get_service_names_and_types_by_node(name, "/alone")
            ]
            assert len(known) == len(set(known))
            if name == "regulator":
                assert supervisor.call("regulator/vent") == "vented until ~/reset"
                assert supervisor.call("regulator/reset") == "reset"
        finally:
            status, _, err = end(process)
            if valves is not None:
                end(valves)
    assert status == 0, err


def test_a_controller_node_follows_the_limits_and_warns_of_contradictions(domain, capfd):
    settings = ("limits.maximum_pa:=20e3", "limits.rise_pa_s:=50e3", "control.pressures.lag_s:=0.1")
    middleware.init(["--ros-args", *(part for setting in settings for part in ("-p", setting))])
    try:
        node = ControllerNode()
        node.trigger_configure()
        pressures = node.controller.pressures
        node.destroy_node()
    finally:
        rclpy.shutdown()
    assert (pressures.maximum_pa, pressures.rise_pa_s, pressures.lag_s) == (20e3, 50e3, 0.1)
    assert "pressures.lag_s 0.1 is used, but the platform's regulators have 0.052" in capfd.readouterr().err


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

    chamber_names, n_chambers, update_hz, reading_age_s = CHAMBERS, 3, 1000.0, 0.0
    device_watchdog = True
    statistics = BusStatistics()

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


@contextlib.contextmanager
def regulating(devices, monkeypatch, *settings):
    """Give an active regulator node of these devices."""
    monkeypatch.setattr(regulator, "open_regulator", lambda *_, **__: devices)
    with active(regulator.RegulatorNode, "device:=x", "autostart:=false", *settings) as node:
        yield node
        node.make_safe()


@pytest.mark.parametrize("closing", ["fault", "deactivated"])
def test_a_latch_that_closes_vents_the_regulators(domain, monkeypatch, closing):
    """Zero set points alone are slewed by some, and a node that is not active sends none."""
    devices = Answering()
    with regulating(devices, monkeypatch) as node:
        fire(node, CYCLE_S)
        assert devices.vents == 0
        if closing == "fault":
            devices.faults = (Fault("rebooted", CHAMBERS[0], "has restarted", latched=True),)
            fire(node, CYCLE_S)
        else:
            node.trigger_deactivate()
        assert devices.vents == 1
        assert values(node)["cause"].startswith({"fault": "rebooted"}.get(closing, closing))


@pytest.mark.parametrize("closing", ["a latch", "the end"])
def test_an_error_in_the_report_does_not_prevent_the_note_of_a_latch(domain, monkeypatch, tmp_path, closing):
    """The next driver of these devices must know that they were vented, and why."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    devices = Answering()
    monkeypatch.setattr(regulator, "open_regulator", lambda *_, **__: devices)
    middleware.init(["--ros-args", "-p", "device:=x", "-p", "autostart:=false"])
    try:
        node = regulator.RegulatorNode()
        node.trigger_configure()
        node.trigger_activate()
        if closing == "the end":
            devices.faults = (Fault("rebooted", CHAMBERS[0], "has restarted", latched=True),)
            fire(node, CYCLE_S)
            LatchFile("x").write("what the cycle wrote is gone")
        monkeypatch.setattr(devices, "vent", lambda: monkeypatch.setattr(node, "diagnose", broken))
        vent = functools.partial(request, node, "~/vent")
        with pytest.raises(RuntimeError, match="broken report"):
            node.make_safe() if closing == "the end" else vent()
        assert LatchFile("x").cause().startswith("rebooted" if closing == "the end" else "vent requested")
        monkeypatch.undo()
        node.destroy_node()
    finally:
        rclpy.shutdown()


def broken():
    raise RuntimeError("broken report")


def test_a_fault_of_devices_that_are_vented_on_request_is_a_trip(domain, monkeypatch, tmp_path):
    """It ends a run, keeps the latch closed while it stands, and the next driver knows of it."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    devices = Answering()
    with regulating(devices, monkeypatch) as node:
        fire(node, CYCLE_S)
        request(node, "~/vent")
        fire(node, CYCLE_S)
        assert is_requested(node.diagnostics.status.message)
        lost = "bus off"
        monkeypatch.setattr(devices, "exchange", lambda *_: broken_bus(lost))
        fire(node, CYCLE_S)
        assert node.diagnostics.status.message == f"vented: vent requested; {lost}"
        assert not is_requested(node.diagnostics.status.message)
        assert LatchFile("x").cause() == f"vent requested; {lost}"
        monkeypatch.setattr(devices, "configure", lambda: broken_bus(lost))
        answer = request(node, "~/reset")
        assert (answer.success, answer.message) == (False, lost)


def test_a_tick_that_waited_as_the_node_was_deactivated_is_gone_at_the_next_activation(domain, monkeypatch):
    """In lockstep; the devices would else be taken through a cycle of the time before."""
    devices, told_ns = Answering(), []
    monkeypatch.setattr(devices, "exchange", lambda sent, now_ns: told_ns.append(now_ns) or answer(sent))
    with regulating(devices, monkeypatch, "mode:=lockstep") as node:
        receive(node, "/clock", Clock())
        receive(node, "/clock", Clock(clock=messages.to_time(10**9)))  # waits for its command
        assert told_ns == [0]
        node.trigger_deactivate()
        node.trigger_activate()
        command = messages.chambers(CHAMBERS, np.zeros(3), 2 * 10**9 - 5_000_000)
        receive(node, "/clock", Clock(clock=messages.to_time(2 * 10**9)))
        receive(node, "chambers/command", command, {"publication_sequence_number": None})
        assert told_ns == [0, 2 * 10**9]


def answer(setpoint_pa):
    return Exchange(setpoint_pa, setpoint_pa, np.full(3, True))


def broken_bus(why):
    raise HardwareError(why)


def test_a_chamber_that_keeps_its_pressure_is_reported_once_and_keeps_the_latch(domain, monkeypatch, capfd):
    devices = Answering()
    kept_pa = np.array([0.0, 40e3, 0.0])
    monkeypatch.setattr(devices, "exchange", lambda sent, _: Exchange(sent, kept_pa.copy(), np.full(3, True)))
    monkeypatch.setattr(regulator, "open_regulator", lambda *_, **__: devices)
    parameters = ["-p", "device:=x", "-p", "autostart:=false", "-p", "limits.vent_limit_s:=0.1"]
    middleware.init(["--ros-args", *parameters])
    try:
        node = regulator.RegulatorNode()
        node.trigger_configure()
        request(node, "~/vent")
        assert devices.vents == 1, "at once, and also while the node is inactive"
        node.trigger_activate()
        wait_until(lambda: fire(node, CYCLE_S) or values(node)["not_vented"], "what is kept")
        for _ in range(5):
            fire(node, CYCLE_S)
        said = values(node)["not_vented"]
        assert said.startswith("link0/chamber1 still at 40.0 kPa ")
        assert node.diagnostics.status.message == f"vented: vent requested; {said}"
        assert capfd.readouterr().err.count(said) == 1
        answer = request(node, "~/reset")
        assert (answer.success, answer.message) == (False, said)
        kept_pa[:] = 0.0
        fire(node, CYCLE_S)
        assert node.diagnostics.status.message == "vented: vent requested"
        assert request(node, "~/reset").success
        node.make_safe()
        node.destroy_node()
    finally:
        rclpy.shutdown()


@pytest.mark.parametrize("silent", [False, True])
def test_a_node_that_stops_its_diagnostics_is_an_error(domain, monkeypatch, silent):
    monkeypatch.setattr(supervisor_module, "SILENT_S", 0.5)
    with RunMonitor("alone") as supervisor:
        node = Node("controller", namespace="alone")
        diagnostics = Diagnostics(node)

        def heard() -> bool:
            before = supervisor.status.get("controller")
            diagnostics.publish()
            supervisor.spin(0.02)
            return supervisor.status.get("controller") is not before

        wait_until(heard, "status")
        until = time.monotonic() + 0.8
        while time.monotonic() < until:
            if silent:
                supervisor.spin(0.02)
            else:
                wait_until(heard, "status")
                supervisor.check_silence(
                    ["recorder", "controller"]
                )  # the recorder never: waited for elsewhere
        supervisor.check_silence(["recorder"])
        if silent:
            with pytest.raises(NodeError) as told:
                supervisor.check_silence(["recorder", "controller"])
            assert told.value.name == "controller"
        node.destroy_node()


def test_nodes_live_while_the_clock_of_lockstep_goes_on(domain, monkeypatch):
    monkeypatch.setattr(supervisor_module, "SILENT_S", 0.5)
    with RunMonitor("alone") as supervisor:
        node = Node("controller", namespace="alone")
        diagnostics, clock = Diagnostics(node), node.create_publisher(Clock, "/clock", 10)

        def heard() -> bool:
            diagnostics.publish()
            supervisor.spin(0.02)
            return "controller" in supervisor.status

        wait_until(heard, "status")
        silent_s = time.monotonic()
        for tick in itertools.count(1):
            clock.publish(Clock(clock=messages.to_time(tick * 10**7)))
            supervisor.spin(0.02)
            supervisor.check_silence(["controller"])
            if time.monotonic() > silent_s + 0.8:
                break
        until = time.monotonic() + 0.7
        while time.monotonic() < until:
            clock.publish(Clock(clock=messages.to_time(tick * 10**7)))  # the clock stands still
            supervisor.spin(0.02)
        with pytest.raises(NodeError):
            supervisor.check_silence(["controller"])
        node.destroy_node()


class Person:
    """Publishes a straight arm at rest, tick by tick, and notes what the controller wants of it.

    The controller is in lockstep: its time is that of the ticks, however fast or busy the machine is.
    """

    def __init__(self, supervisor: RunMonitor) -> None:
        self.supervisor, self.t_s = supervisor, 1.0
        self.node = Node("person", namespace="alone")
        self.state = self.node.create_publisher(JointState, "arm/state", qos.LOCKSTEP)
        self.reading = self.node.create_publisher(JointState, "chambers/state", qos.LOCKSTEP)
        self.trajectory = self.node.create_publisher(
            JointTrajectory, "arm/reference/trajectory", qos.RELIABLE
        )
        self.tip = self.node.create_publisher(PoseStamped, "arm/reference/tip", qos.RELIABLE)
        self.commands: list[list[float]] = []
        self.seen: list[tuple[float, np.ndarray]] = []
        self._answered_ns = 0
        self.node.create_subscription(JointState, "chambers/command", self._on_command, qos.LOCKSTEP)
        self.node.create_subscription(PoseStamped, "arm/desired/tip", self._on_wanted, qos.LOCKSTEP)
        supervisor.add_node(self.node)
        for publisher in (self.trajectory, self.tip):
            wait_until(
                lambda p=publisher: supervisor.spin(0.02) or p.get_subscription_count() == 1, "discovery"
            )

    def _on_command(self, message: JointState) -> None:
        self._answered_ns = messages.to_ns(message.header.stamp)
        self.commands.append(list(message.effort))

    def _on_wanted(self, message: PoseStamped) -> None:
        stamp_s = messages.to_ns(message.header.stamp) * 1e-9
        self.seen.append((stamp_s, messages.pose_arrays(message.pose)[0]))

    @property
    def wanted(self) -> np.ndarray:
        """Where the controller wants the tip."""
        return self.seen[-1][1]

    @property
    def said(self) -> str:
        """Message of the controller on /diagnostics."""
        return self.supervisor.status["controller"].message

    def tick(self) -> None:
        """Publish the arm's state of one tick of 5 ms, and wait for the command that answers it."""
        self.t_s += 5e-3
        stamp_ns = round(self.t_s * 1e9)
        self.reading.publish(messages.chambers(CHAMBERS, np.zeros(3), stamp_ns))
        self.state.publish(messages.arm_state(COORDINATES, np.zeros(3), np.zeros(3), np.zeros(3), stamp_ns))
        wait_until(
            lambda: self.supervisor.spin_once(LIMIT_S) or self._answered_ns == stamp_ns,
            "command",
            every_s=0.0,
        )

    def hold(self, until: Callable[[], object]) -> None:
        """Go on until something is true."""
        wait_until(lambda: self.tick() or until(), "the condition", every_s=0.0)


@contextlib.contextmanager
def person(**reference: object) -> Iterator[Person]:
    """A person beside a controller node, which holds until it hears of something else."""
    with RunMonitor("alone") as supervisor:
        settings = {"kind": "hold", **reference}
        keys = [f"control.reference.{k}:={v}" for k, v in settings.items()]
        # `composite` would wait for arm/covariance, which this person does not publish.
        process = start("controller", "mode:=lockstep", "control.law:=adaptive", *keys)
        try:
            supervisor.wait("controller", lambda: supervisor.active("controller"), lambda: None, COMPILED_S)
            person = Person(supervisor)
            yield person
            assert process.poll() is None
            person.node.destroy_node()
        finally:
            status, _, err = end(process)
    assert status == 0, err


@pytest.mark.process
def test_references_come_by_topic_and_wrong_ones_are_refused(domain):
    with person(start_s=0.3) as it:
        # Started alone it asks for no air until somebody says so.
        it.hold(lambda: len(it.commands) > 20)
        assert np.all(np.array(it.commands) == 0.0)
        assert it.supervisor.call("controller/enable") == "enabled"
        it.commands.clear()
        it.hold(lambda: len(it.commands) > 5)
        assert it.wanted == pytest.approx([0, 0, 0.064], abs=1e-6)

        points = [([0.05, 0, 0], 0.4), ([0.1, 0, 0], 0.8)]
        it.trajectory.publish(trajectory(COORDINATES, points))
        it.hold(lambda: abs(it.wanted[2] - 0.064 * 1.1) < 1e-9)  # at rest

        it.trajectory.publish(trajectory(("link0/elongation", "link9/bending_x", "x"), points))
        it.hold(lambda: "joint_names" in it.said)
        assert it.wanted[2] == pytest.approx(0.064 * 1.1, abs=1e-6)

        it.tip.publish(messages.pose_stamped(tip_pose(0.01, 0.0, 0.066), 0, "world"))
        it.hold(lambda: np.linalg.norm(it.wanted - [0.01, 0.0, 0.066]) < 1e-3)
        it.tip.publish(messages.pose_stamped(tip_pose(0.5, 0.0, 0.5), 0, "world"))
        it.hold(lambda: "0.5" in it.said)

        assert it.supervisor.call("controller/vent")
        it.commands.clear()
        it.hold(lambda: len(it.commands) > 10)
        assert np.all(np.array(it.commands[5:]) == 0.0)


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


def test_an_activation_that_fails_is_undone_and_stays_an_error(domain, monkeypatch):
    middleware.init(["--ros-args", "-p", "autostart:=false"])
    node = TwinNode()
    try:
        node.trigger_configure()
        begin = node._begin

        def failing():
            begin()
            raise SoroError("no room")

        monkeypatch.setattr(node, "_begin", failing)
        node.trigger_activate()
        node._each_second()
        assert (node.diagnostics.level, node.diagnostics.message) == (ERROR, "no room")
        assert not list(node._timers_active)
        monkeypatch.setattr(node, "_begin", begin)
        node.trigger_activate()
        node._each_second()
        assert (node.diagnostics.level, node.diagnostics.message) == (OK, "active")
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
