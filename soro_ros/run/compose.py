"""A scene as processes: emulated valves, twin, regulator, estimator, controller, recorder."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from rclpy.node import Node

from soro_core.config import Strict, with_changes
from soro_core.control.laws.registry import SHIPPED
from soro_core.errors import SoroError
from soro_core.jobs.versions import versions
from soro_core.safety.vent_check import REST_S
from soro_hardware.emulation.sockets.control import ControlClient
from soro_lab.bag.config import RecorderConfig
from soro_lab.scene import Scene
from soro_ros.host import claims
from soro_ros.host.claims import Claims
from soro_ros.recorder.recorded_topics import recorded_topics
from soro_ros.run.forks import ForkServer
from soro_ros.run.loop_nodes import OBSERVERS, LoopNodes, control_loop
from soro_ros.run.processes import NodeError
from soro_ros.run.run_processes import END_ORDER, START_LIMIT_S, RunProcesses, kind_of
from soro_ros.run.supervisor import RunMonitor
from soro_ros.topics.diagnostics import OVER

# The user starts the driver of a real arm's pose sensor.
POSE_LIMIT_S = 20.0
# Running nodes discover each other within two seconds.
LOOP_LIMIT_S = 30.0
# Longest probe of the chambers [s].
PROBE_LIMIT_S = 180.0
# Longest wait for a controller to command zero, at the end and after Ctrl-C; then the valves are vented [s].
ZERO_LIMIT_S, URGENT_S = 2.0, 0.5
# A run that hangs may be longer than its scene by this time, in which control begins [s].
_BEGIN_S, _END_S = 30.0, 2.0


class Run:
    """The processes of one scene.

    Parameters
    ----------
    scene : Scene
        What to start.
    folder : Path
        Folder of the run: parameters, logs, bag.
    report : callable
        Function that shows one line of progress.
    interrupted : sequence of int
        Signals that have ended the run, see `signals.noted`; the start stops as soon as there is one.
    loop : LoopNodes, optional
        Nodes between readings and commands; default: estimator and controller.
    forks : ForkServer, optional
        Starts the processes; without it each is a Python of its own.
    """

    def __init__(
        self,
        scene: Scene,
        folder: Path,
        report: Callable[[str], None],
        interrupted: Sequence[int] = (),
        loop: LoopNodes | None = None,
        forks: ForkServer | None = None,
    ) -> None:
        self.scene, self.folder, self._report, self._interrupted = scene, folder, report, interrupted
        self._loop = loop or control_loop(scene)
        self.bag = folder / "bag"
        """Folder of the bag."""
        self.processes = RunProcesses(scene, folder, report, self.check, forks)
        """What has been started."""
        self.has_started = False
        """Whether control has started."""
        self.has_begun = False
        """Whether control has been enabled: nothing moves before."""
        self._claims = Claims()
        self.warnings: dict[str, str] = {}
        """What became of an observer while the arm went on, by the name of its node."""
        self.recording_failure = ""
        """Why the recording has no end; empty where it has one."""

    def claim(self, node: Node) -> None:
        """Claim the arm in the domain of a node; its own nodes claim their names as they start.

        Raises
        ------
        ConfigError
            If another program has this arm, or one of its nodes.
        """
        namespace = f"/{self.scene.name}"
        nodes = [name for name in END_ORDER if name not in (*OBSERVERS, "valves")]
        names: list[str] = []
        for arm in self.scene.each:
            own = f"{namespace}/{arm.prefix}"
            names += [claims.readings(own), *(f"{own}{name}" for name in nodes)]
        if self.scene.mode == "lockstep":
            names.append("/clock")
        self._claims.take(node, [claims.of_arm(self.scene.name)])
        claims.require_free(node, names)

    def start(self, supervisor: RunMonitor) -> None:
        """Start every process and wait until every node is active; nothing moves before `begin`.

        Raises
        ------
        KeyboardInterrupt
            If a signal has ended the run.
        ConfigError
            If another program has a node of the same name.
        SoroError
            If a process ends or a node reports an error.
        """
        scene, forks = self.scene, self.processes.forks
        self.check()
        if forks is not None:
            supervisor.wait("fork server", forks.has_answered, self.check, START_LIMIT_S)
        self.processes.start_valves()
        if scene.recorder.enabled:
            topics, exclude = recorded_topics(scene), scene.recorder.exclude
            notes = tuple(f"{name}={version}" for name, version in versions().items())
            recorder = RecorderConfig(
                mode=scene.mode, folder=str(self.bag), topics=topics, exclude=exclude, notes=notes
            )
            self.processes.start_nodes(supervisor, {"recorder": recorder})
        # A law from outside is not run in the server: its threads, or a device, would not live on in a fork.
        is_warmed = self._loop.commander == "controller" and all(
            arm.controller.law in SHIPPED for arm in scene.each
        )
        if forks is not None and is_warmed:
            forks.warm(self.folder / "scene_used.yaml")
        nodes: dict[str, Strict] = {}
        if scene.arm != "real":
            nodes |= {f"{arm.prefix}twin": self._twin(arm) for arm in scene.each}
        elif self._loop.shadow:
            nodes |= {f"{arm.prefix}shadow": arm.shadow_node() for arm in scene.each}
        nodes |= self._loop.nodes
        if scene.markers:
            nodes |= {f"{arm.prefix}markers": arm.markers_node() for arm in scene.each}
        supervisor.look()
        if is_warmed:
            self.processes.wait_for_kernels(supervisor, len(nodes))
        self.processes.start_nodes(supervisor, nodes)
        if self.scene.platforms:
            # Last, when no node compiles any more: its deadlines start with its first exchange.
            regulators = {f"{one.prefix}regulator": self._regulator(one) for one in self.scene.platforms}
            self.processes.start_nodes(supervisor, regulators)
        if scene.arm == "real":
            for arm in scene.each:
                self._wait_for_arm(supervisor, arm.prefix)
        if scene.mode == "real_time":
            # Before the nodes have discovered each other, the controller would act on old readings.
            command = f"command of the {self._loop.commander}, which answers readings"
            check = partial(self.processes.check_start, supervisor)
            supervisor.wait(command, lambda: supervisor.commanded, check, LOOP_LIMIT_S)
        self.processes.check_start(supervisor)
        if scene.mode == "lockstep":
            supervisor.check_clock()

    def _twin(self, arm: Scene) -> Strict:
        links = self.processes.links.get("" if arm.is_shared else arm.prefix)
        config = arm.twin_node(str(links.plant), str(links.faults)) if links else arm.twin_node()
        bodies = str(self.folder / "scene_used.yaml") if self.scene.bodies or self.scene.mounts else ""
        # It cannot know how long a probe takes: the run ends its time then.
        ends = {"duration_s": 0.0} if self._probes_in_lockstep else {}
        return with_changes(config, bodies_file=bodies, **ends)

    def _regulator(self, one: Scene) -> Strict:
        return one.regulator_node(str(self.processes.links[one.prefix].device) if one.emulates else "")

    def begin(self, supervisor: RunMonitor) -> None:
        """Enable the controller, inject the scene's faults, and start the clock and what the twin plans.

        In real time all of them count from the end of the probe.

        Raises
        ------
        SoroError
            If the controller refuses to begin.
        """
        self.has_started = True
        for pulse in self.processes.pulses.values():
            pulse.begin(self.scene.duration_s + _BEGIN_S)
        scene = self.scene
        if scene.mode == "real_time" and self._probes("auto", "refuse", "warn"):
            self._enable(supervisor)
            check = partial(self.check_nodes, supervisor, scene.duration_s)
            self._report("probing the chambers, each alone: some 4 to 10 s")
            what = "set point of the law behind the probe of the chambers"
            supervisor.wait(what, lambda: supervisor.controlled_s > 0.0, check, PROBE_LIMIT_S)
            self._inject()
        else:
            self._inject()
            self._enable(supervisor)
        if self.scene.arm == "simulated":
            for arm in scene.each:
                supervisor.call(f"{arm.prefix}twin/start")

    def _probes(self, *settings: str) -> bool:
        """Whether a controller probes by one of these settings."""
        each = self.scene.each if self._loop.commander == "controller" else ()
        return any(arm.controller.probe_at_enable in settings for arm in each)

    @property
    def _probes_in_lockstep(self) -> bool:
        return self.scene.mode == "lockstep" and self._probes("refuse", "warn")

    def passed_s(self, supervisor: RunMonitor) -> float:
        """Time of the run until now, behind a probe [s]: in lockstep that of its clock."""
        if self.scene.mode == "real_time":
            return supervisor.controlled_s
        return supervisor.simulated_s if self._probes_in_lockstep else supervisor.clock_s

    def _enable(self, supervisor: RunMonitor) -> None:
        for arm in self.scene.each:
            supervisor.call(f"{arm.prefix}{self._loop.commander}/enable")
            self.has_begun = True

    def _inject(self) -> None:
        """Inject the scene's faults."""
        for one in self.scene.platforms:
            if one.faults:
                with contextlib.closing(ControlClient(self.processes.links[one.prefix].faults)) as client:
                    for fault in one.faults:
                        client.inject(fault)

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has ended the run, and NodeError if a process has ended.

        That an observer has ended is a warning, once the arm is in control.
        """
        if self._interrupted:
            raise KeyboardInterrupt
        for child in self.processes.children.values():
            if child.process.poll() is not None:
                if not self._spares(child.name):
                    raise NodeError(child.name, child.end_report())
                self._warn(child.name, child.end_report(), has_failed=True)

    def check_nodes(self, supervisor: RunMonitor, left_s: float) -> None:
        """Raise what ends a run in control, and warn of what does not.

        Parameters
        ----------
        supervisor : RunMonitor
            What the nodes say.
        left_s : float
            Time [s] that the run still takes: without another call the arm is vented soon after it.

        Raises
        ------
        KeyboardInterrupt
            If a signal has ended the run.
        SoroError
            If a process or a node fails, or this program itself stood still.
        """
        for driver, pulse in self.processes.pulses.items():
            pulse.renew(left_s + _END_S)
            if still_s := pulse.stood_still_s:
                raise SoroError(
                    f"this program stood still for {still_s:.1f} s (stopped, or starved), so the "
                    f"{driver} has vented the arm"
                )
        self.check()
        essential = [name for name in self.processes.nodes if not self._spares(name)]
        supervisor.check(essential, spares_requested=not self._loop.empties)
        supervisor.check_silence(essential)
        for name in set(self.processes.nodes) - set(essential):
            if self.processes.children[name].process.poll() is not None:
                continue
            if failure := supervisor.error(name):
                self._warn(name, failure, has_failed=True)
            elif failure := supervisor.silence(name):
                self._warn(name, failure)

    def _spares(self, name: str) -> bool:
        """Whether the run goes on without a node now."""
        return self.has_started and kind_of(name) in self._loop.observers

    def _warn(self, name: str, line: str, has_failed: bool = False) -> None:
        """Report once what became of an observer; `has_failed` if it does not do its work any more."""
        if has_failed and name == "recorder":
            self.recording_failure = line
        if self.warnings.get(name) != line:
            self.warnings[name] = line
            self._report(f"warning: {line}; the arm goes on")

    def empty(self, supervisor: RunMonitor, has_failed: bool) -> None:
        """Let the arm become empty before the nodes end, so that the recording shows it.

        Where the valves are not vented yet, and no controller could command zero, the end vents at once.

        Parameters
        ----------
        supervisor : RunMonitor
        has_failed : bool
            Whether an error has ended the run, such as a trip.
        """
        scene, interrupts = self.scene, len(self._interrupted)
        vented = any(map(supervisor.error, self.processes.drivers))
        skips = not vented if has_failed else self._loop.empties and not interrupts
        if skips or not (self.has_started and scene.recorder.enabled):
            return
        limit_s = scene.limits.vent_limit_s + REST_S
        for pulse in self.processes.pulses.values():
            pulse.renew(limit_s + _END_S)
        lockstep = scene.mode == "lockstep"
        if not has_failed and (interrupts or not lockstep):  # in lockstep the controller ends by itself
            try:
                for arm in scene.each:
                    vent = f"{arm.prefix}{self._loop.commander}/vent"
                    supervisor.call(vent, URGENT_S if interrupts else ZERO_LIMIT_S)
            except SoroError:
                return
        now_ns = int(supervisor.node.get_clock().now().nanoseconds)
        ended_s = (
            supervisor.clock_s if self._probes_in_lockstep else min(supervisor.clock_s, scene.duration_s)
        )
        begin_ns = round(1e9 * ended_s) if lockstep else now_ns

        def goes_on() -> bool:
            """Return whether readings may still come, and nobody asks for the end once more."""
            twin = supervisor.status.get(f"{scene.each[0].prefix}twin")
            drivers = [self.processes.children.get(name) for name in self.processes.drivers]
            ended = any(driver is None or driver.process.poll() is not None for driver in drivers)
            return not (ended or (twin and twin.message == OVER) or len(self._interrupted) > interrupts)

        supervisor.watch_emptying(scene.limits, begin_ns, limit_s, goes_on, lockstep)

    def end(self) -> dict[str, str]:
        """End every process in order; return a line for each that did not end cleanly, by name.

        An observer of a run that had started is no such process: `warnings` have its line.
        """
        unclean = {}
        for name, line in self.processes.end():
            if self._spares(name):
                self._warn(name, line, has_failed=True)
            else:
                unclean[name] = line
        self._claims.close()
        return unclean

    @property
    def refused(self) -> bool:
        """Whether a node refused its configuration before the begin; after `end`."""
        return not self.has_started and 2 in self.processes.status.values()

    def outcome(self) -> str:
        """State of valves and bag, in one line; after `end`."""
        if not self.has_started:
            air = "ended before control began"
        elif not (left := [name for name in self.processes.drivers if self.processes.status.get(name) != 0]):
            air = "vented"
        else:
            others = "valves with a watchdog vent by themselves, others by the second process"
            air = f"the {', '.join(left)} ended without venting ({others})"
        if not self.bag.exists():
            return air
        if self.processes.status.get("recorder") == 0:
            return f"{air}; bag closed"
        return f"{air}; the bag is not closed: soro bag repair {self.bag}"

    def _wait_for_arm(self, supervisor: RunMonitor, arm: str) -> None:
        """Wait until a sample of a real arm has come to the node that needs it."""
        kind, count = ("shadow", "compared") if self._loop.shadow else (self._loop.commander, "samples")
        node, topic = f"{arm}{kind}", f"{arm}sensors/"
        what = f"pose of the arm on {topic}pose0" if self._loop.shadow else f"sample of the arm on {topic}"
        self._report(f"waiting for the {what}")

        def arrived() -> bool:
            return int(supervisor.values(node).get(count, 0)) > 0

        supervisor.wait(what, arrived, self.check, POSE_LIMIT_S)
