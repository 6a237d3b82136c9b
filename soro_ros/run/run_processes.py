"""The processes of a run: emulated valves and nodes, how they start together, and in which order they end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from soro_core.config import Strict, with_changes
from soro_lab.scene import Scene
from soro_ros.host.pulse import Pulse
from soro_ros.run import processes
from soro_ros.run.forks import ForkServer
from soro_ros.run.processes import Child
from soro_ros.run.start_progress import StartProgress
from soro_ros.run.supervisor import RunMonitor
from soro_ros.run.valves import Links, start_valves, wait_for_valves

# Longest start of nodes [s], without the time in which they compile kernels.
START_LIMIT_S = 180.0
# Time limits of an end [s]: the regulator vents and checks its readings, the recorder writes its buffer.
_END_LIMITS_S = {"regulator": 10.0, "recorder": 10.0}
_END_LIMIT_S = 5.0
# Order of the end: first the node that drives the valves, last the recorder and the valves themselves.
_LOOP, _BESIDE = ("regulator", "exciter", "hand", "controller", "estimator"), ("shadow", "twin", "markers")
END_ORDER = (*_LOOP, *_BESIDE, "recorder", "valves")


class RunProcesses:
    """What a run has started.

    Parameters
    ----------
    scene, folder, report, forks : as in `compose.Run`
    check : callable
        Raises what ends the start.
    """

    def __init__(
        self,
        scene: Scene,
        folder: Path,
        report: Callable[[str], None],
        check: Callable[[], None],
        forks: ForkServer | None = None,
    ) -> None:
        self._scene, self._folder, self._report, self._check = scene, folder, report, check
        self._starter: Any = forks or processes
        self.forks = forks
        """Starts the processes, if there is one."""
        self._progress: StartProgress | None = None
        self.nodes: list[str] = []
        """Names of the nodes that have been started."""
        self.children: dict[str, Child] = {}
        """Processes that have been started and not ended, by the name of each node."""
        self.status: dict[str, int] = {}
        """Exit status of those that have been ended."""
        self.links = {one.prefix: Links() for one in scene.platforms if one.emulates}
        """Links of the emulated valves of each platform."""
        self.drivers = [
            *(f"{one.prefix}regulator" for one in scene.platforms),
            *(f"{arm.prefix}twin" for arm in scene.each if not arm.platform),
        ]
        """The nodes that drive the valves; they vent when they end."""
        # In lockstep no air moves, and the time of the nodes is not that of this program.
        self.pulses: dict[str, Pulse] = (
            {name: Pulse() for name in self.drivers} if scene.mode == "real_time" else {}
        )
        """What tells each driver that this program is there."""

    def start_valves(self) -> None:
        """Start the emulated valves of each platform and wait until they are ready."""
        for one in self._scene.platforms:
            if one.emulates:
                self._report(f"starting emulated valves of {one.platform}")
                valves = start_valves(one, self._folder, self.links[one.prefix], self._starter.start)
                self.children[f"{one.prefix}valves"] = valves
                wait_for_valves(valves, self._check)

    def start_nodes(self, supervisor: RunMonitor, configs: Mapping[str, Strict]) -> None:
        """Start nodes with their parameters and wait until all of them are active."""
        self._check()
        supervisor.check_alone(configs)
        self._report(f"starting {', '.join(configs)}")
        ending = {name: with_changes(config, end_on_failed_start=True) for name, config in configs.items()}
        # The twins of several arms are one process, because they are one world.
        twins = {name: config for name, config in ending.items() if kind_of(name) == "twin"}
        groups = [{name: config} for name, config in ending.items() if len(twins) < 2 or name not in twins]
        for nodes in ([twins] if len(twins) > 1 else []) + groups:
            (name, config), *others = nodes.items()
            if others:
                command = processes.arms_command(nodes, self._scene.name, self._folder)
            else:
                command = processes.node_command(name, config, self._scene.name, self._folder)
            pulse = self.pulses.get(name)
            called = kind_of(name) if others else name
            child = self._starter.start(called, command, self._folder, pipe=pulse.pipe if pulse else None)
            for node in nodes:
                self.children[node] = child
                self.nodes.append(node)
                supervisor.listen_to(node, child.process.pid)

        def missing() -> list[str]:
            return [name for name in configs if not supervisor.active(name)]

        def advice() -> str:
            return (
                f": {', '.join(missing())} did not become active (see {self._folder / 'log'}); "
                "on a busy machine run it again: compiled kernels are kept"
            )

        self._wait(supervisor, "answer of all nodes", lambda: not missing(), advice=advice)

    def wait_for_kernels(self, supervisor: RunMonitor, to_come: int) -> None:
        """Wait until the fork server has warmed the kernels of so many nodes."""
        if self.forks is not None:
            self._wait(supervisor, "kernels", self.forks.has_answered, to_come)

    def _wait(
        self,
        supervisor: RunMonitor,
        what: str,
        ready: Callable[[], bool],
        to_come: int = 0,
        advice: Callable[[], str] = str,
    ) -> None:
        """Wait for the nodes of the start; `to_come` of them have not been started yet."""
        progress = self._progress = self._progress or StartProgress(self._report)

        def check() -> None:
            self.check_start(supervisor)
            progress.tell(sum(map(supervisor.active, self.nodes)), len(self.nodes) + to_come)

        supervisor.wait(what, ready, check, START_LIMIT_S, progress.is_compiling, advice)

    def check_start(self, supervisor: RunMonitor) -> None:
        """Raise SoroError if a process has ended, or another run has nodes of the same names.

        Two controllers of one name would command both arms.
        """
        self._check()
        supervisor.check_alone(self.nodes)

    def end(self) -> Iterator[tuple[str, str]]:
        """End every process in order; give name and line of each that did not end cleanly."""
        order = {kind: place for place, kind in enumerate(END_ORDER)}
        for name in sorted(self.children, key=lambda name: (name not in self.drivers, order[kind_of(name)])):
            child = self.children.pop(name)
            limit_s = _END_LIMITS_S.get(kind_of(name), _END_LIMIT_S)
            self.status[name], forced = processes.stop(child, limit_s)
            if self.status[name] != 0:
                yield name, child.end_report(forced)
        for links in self.links.values():
            links.close()
        for pulse in self.pulses.values():
            pulse.close()


def kind_of(name: str) -> str:
    """Return the name of a node without that of its arm."""
    return name.rpartition("/")[2]
