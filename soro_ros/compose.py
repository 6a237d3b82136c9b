"""A scene as processes: emulated valves, twin, regulator, estimator, controller, recorder."""

from __future__ import annotations

import contextlib
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from soro_core.bag.config import RecorderConfig
from soro_core.errors import SoroError
from soro_core.hardware.emulation.control import ControlClient
from soro_core.scene import Scene
from soro_ros import kernels, processes
from soro_ros.processes import Child
from soro_ros.supervisor import Supervisor

# A cold start compiles the model's kernels in several processes at once.
START_LIMIT_S = 180.0
# The driver of a real arm's pose sensor is somebody else's, and runs already.
POSE_LIMIT_S = 20.0
# Nodes that run find one another within a second or two.
LOOP_LIMIT_S = 30.0
# So long one may take to end [s]: to vent and to see that it has, to write what is left; others 5 s.
_PATIENCE_S = {"regulator": 10.0, "recorder": 10.0}
# Ended in this order: first what holds the valves, last what they hang on and what records them.
END_ORDER = ("regulator", "controller", "estimator", "shadow", "twin", "recorder", "valves")


# Of the control loop. Named with their types, so that the recorder hears them from the first message on.
_TOPICS = (
    ("chambers/command", "sensor_msgs/msg/JointState"),
    ("chambers/state", "sensor_msgs/msg/JointState"),
    ("sensors/pose0", "geometry_msgs/msg/PoseStamped"),
    ("sensors/imu0", "sensor_msgs/msg/Imu"),
    ("arm/state", "sensor_msgs/msg/JointState"),
    ("arm/tip", "geometry_msgs/msg/PoseWithCovarianceStamped"),
    ("arm/shadow/tip", "geometry_msgs/msg/PoseStamped"),
    ("arm/shadow/difference", "sensor_msgs/msg/JointState"),
    ("arm/desired/tip", "geometry_msgs/msg/PoseStamped"),
    ("controller/estimates", "sensor_msgs/msg/JointState"),
    ("truth/tip", "geometry_msgs/msg/PoseStamped"),
    ("truth/state", "sensor_msgs/msg/JointState"),
    ("truth/chambers", "sensor_msgs/msg/JointState"),
)
_BACKBONE, _DIAGNOSTICS = "geometry_msgs/msg/PoseArray", "diagnostic_msgs/msg/DiagnosticArray"


def _topics(namespace: str, scene: Scene) -> tuple[str, ...]:
    lockstep = scene.mode == "lockstep"
    kept = " transient_local" if lockstep else ""  # as qos.loop() has it
    named = [f"/{namespace}/{topic} {kind}{kept}" for topic, kind in _TOPICS]
    clock = [f"/clock rosgraph_msgs/msg/Clock{kept}"] if lockstep else []
    others = (f"/{namespace}/arm/backbone {_BACKBONE}", f"/diagnostics {_DIAGNOSTICS}", f"/{namespace}/*")
    return (*named, *clock, *others)


class Run:
    """The processes of one scene.

    Parameters
    ----------
    scene : Scene
        What to start.
    folder : Path
        Folder of the run: parameters, logs, bag.
    say : callable
        Takes one line about what is going on.
    """

    def __init__(self, scene: Scene, folder: Path, say: Callable[[str], None]) -> None:
        self.scene, self.folder, self._say = scene, folder, say
        self._children: dict[str, Child] = {}
        # Short, whatever the folder of the run: the path of a socket has at most 107 characters.
        self._links = tempfile.TemporaryDirectory(prefix="soro-")
        # The supervisor waits for these to be active.
        self.nodes: list[str] = []
        # What holds the air: it vents when it ends.
        self._holder = "regulator" if scene.platform else "twin"
        self._begun = False
        self._told: set[str] = set()
        self._status: dict[str, int] = {}

    @property
    def bag(self) -> Path:
        """Folder of the bag."""
        return self.folder / "bag"

    def start(self, supervisor: Supervisor, cancelled: Callable[[], bool]) -> None:
        """Start everything and wait until every node is ready; nothing moves before `begin`."""
        scene, namespace = self.scene, self.scene.name
        device, link = Path(self._links.name) / "valves.pty", Path(self._links.name) / "plant.sock"
        self._faults = Path(self._links.name) / "faults.sock"
        if cancelled():
            return
        if scene.emulates:
            self._start_valves(device, link, cancelled)
        if scene.recorder.enabled and not cancelled():
            record = RecorderConfig(
                folder=str(self.bag), topics=_topics(namespace, scene), exclude=scene.recorder.exclude
            )
            self._node("recorder", record)
            self._ready(supervisor, ["recorder"], cancelled)
        if cancelled():
            return
        if scene.arm == "real":
            self._node("shadow", scene.shadow_node())
        else:
            self._node("twin", scene.twin_node(str(link), str(self._faults)))
        self._node("estimator", scene.estimator_node())
        self._node("controller", scene.controller_node())
        self._ready(supervisor, self.nodes, cancelled)
        if scene.platform and not cancelled():
            # Last, when nothing compiles any more: its deadlines run from its first exchange on.
            self._node("regulator", scene.regulator_node(str(device)))
            self._ready(supervisor, ["regulator"], cancelled)
        if scene.arm == "real":
            self._hear_arm(supervisor, cancelled)
        if scene.mode == "real_time":
            # Control that begins before all have found one another begins with old readings.
            heard = "command of the controller, which answers readings and estimates"
            supervisor.wait(heard, lambda: cancelled() or supervisor.commanded, self.check, LOOP_LIMIT_S)
        self.check()
        # Controllers of two runs would command the valves of both.
        supervisor.check_alone({name: self._children[name].process.pid for name in self.nodes})
        if scene.mode == "lockstep":
            supervisor.check_clock()

    def begin(self, supervisor: Supervisor) -> None:
        """Let time and control begin."""
        self._begun = True
        if self.scene.faults:
            with contextlib.closing(ControlClient(self._faults)) as client:
                for fault in self.scene.faults:
                    client.inject(fault)
        supervisor.call("controller/enable")
        if self.scene.mode == "lockstep":
            supervisor.call("twin/start")

    def check(self) -> None:
        """Raise NodeError if a process has ended."""
        processes.check(list(self._children.values()))

    def end(self) -> dict[str, str]:
        """End every process, what holds the valves first; returns what did not end cleanly, by name."""
        trouble = {}
        for name in END_ORDER:
            child = self._children.pop(name, None)
            if child is None:
                continue
            self._status[name], forced = processes.stop(child, _PATIENCE_S.get(name, 5.0))
            if self._status[name] != 0:
                trouble[name] = child.obituary(forced)
        self._links.cleanup()
        return trouble

    def outcome(self) -> str:
        """What has become of valves and bag, in one line; after `end`."""
        if not self._begun:
            air = "ended before control began"
        elif self._status.get(self._holder) == 0:
            air = "vented"
        else:
            others = "valves with a watchdog vent by themselves, others by the second process"
            air = f"the {self._holder} ended without venting ({others})"
        if not self.bag.exists():
            return air
        if self._status.get("recorder") == 0:
            return f"{air}; bag closed"
        return f"{air}; the bag is not closed: soro bag repair {self.bag}"

    def _node(self, name: str, config: object) -> None:
        command = processes.node_command(name, config, self.scene.name, self.folder)
        self._children[name] = processes.start(name, command, self.folder)
        self.nodes.append(name)

    def _ready(self, supervisor: Supervisor, names: list[str], cancelled: Callable[[], bool]) -> None:
        def ready() -> bool:
            return cancelled() or all(supervisor.active(name) for name in names)

        before, told = kernels.compiled(), False

        def check() -> None:
            nonlocal told
            self.check()
            if not told and kernels.compiled() > before:
                told = True
                self._say("the first start compiles the model's kernels: half a minute, cached afterwards")

        new = [name for name in names if name not in self._told]
        self._told.update(new)
        self._say(f"starting {', '.join(new)}")
        supervisor.wait("answer of all nodes", ready, check, START_LIMIT_S)

    def _hear_arm(self, supervisor: Supervisor, cancelled: Callable[[], bool]) -> None:
        """Wait until poses of the real arm come."""
        self._say("waiting for the pose of the real arm on sensors/pose0")

        def heard() -> bool:
            return cancelled() or int(supervisor.values("shadow").get("compared", 0)) > 0

        supervisor.wait("pose of the arm on sensors/pose0", heard, self.check, POSE_LIMIT_S)

    def _start_valves(self, device: Path, link: Path, cancelled: Callable[[], bool]) -> None:
        self._say(f"starting emulated valves of {self.scene.platform}")
        command = [sys.executable, "-m", "soro_core.hardware.emulation", self.scene.platform]
        command += ["--device-link", str(device), "--plant-link", str(link), "--seed", str(self.scene.seed)]
        command += ["--control", str(self._faults)]
        if self.scene.mode == "lockstep":
            command.append("--lockstep")
        # Above the driver's: devices do not share a processor with it.
        priority = 40 if self.scene.mode == "real_time" else 0
        child = self._children["valves"] = processes.start("valves", command, self.folder, priority)
        deadline = time.monotonic() + 20.0
        while "ready:" not in child.log.read_text(errors="replace") and not cancelled():
            self.check()
            if time.monotonic() > deadline:
                raise SoroError(f"emulated valves are not ready: {child.last_words()}")
            time.sleep(0.02)
