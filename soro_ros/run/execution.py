"""A scene from its file to the end of its processes, for the commands that run one."""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from soro_core.config import find_config
from soro_core.errors import ConfigError, HardwareError, SoroError
from soro_core.extras import require
from soro_hardware.doctor import check_device
from soro_lab.run_folder import new_folder
from soro_lab.scene import Scene, load_scene, with_robot_files
from soro_ros.run.end import End

if TYPE_CHECKING:
    from soro_ros.run.compose import Run
    from soro_ros.run.loop_nodes import LoopNodes
    from soro_ros.run.supervisor import RunMonitor


# Longest time [s] without progress of the run's clock.
STALL_S = 30.0
# Time [s] for which messages are received before the nodes are checked.
ROUND_S = 0.1


def prepare(
    name: str,
    changes: dict[str, Any],
    check: Callable[[Scene, str], list[str]],
    console: Console,
    extras: Sequence[str] = (),
) -> tuple[Scene, str]:
    """Read and check a scene; print what the user must know of it.

    Parameters
    ----------
    name : str
        Scene file, or the name of a shipped one.
    changes : dict of str to object
        Keys that are changed, with their values.
    check : callable
        Function of the scene and its file that refuses what does not fit, and returns warnings.
    console : Console
        Shows warnings.
    extras : sequence of str
        What must be installed beside what the scene needs.

    Returns
    -------
    scene : Scene
    where : str
        Its file.
    """
    scene = load_scene(name, changes)
    require("ros", *(["hardware"] if scene.platforms else []), *extras)
    if any(arm.model is not None and arm.model.auto for arm in scene.each):
        from soro_lab.trade import with_chosen_model

        named = bool(scene.arms)
        scene = scene.of_each(lambda arm: with_chosen_model(arm, called=arm.name if named else name))
    where = str(find_config(name, "scenes"))
    warnings = check(scene, where)
    if scene.mode == "real_time" and scene.platforms:
        from soro_ros.host.middleware import stall_warning

        warnings += stall_warning()
    for line in warnings:
        console.print(f"[yellow]{escape(line)}[/yellow]", soft_wrap=True)
    _check_devices(scene)
    return scene, where


def make_folder(parent: Path, scene: Scene, where: str) -> Path:
    """Make the folder of a run, with the scene as it is written and as it is used.

    Parameters
    ----------
    parent : Path
    scene : Scene
    where : str
        Its file.
    """
    target = new_folder(parent, scene.name)
    shutil.copy(where, target / "scene.yaml")
    (target / "scene_used.yaml").write_text(yaml.safe_dump(scene.to_dict(), sort_keys=False))
    return target


def _check_devices(scene: Scene) -> None:
    """Refuse real valves whose adapter or port does not exist."""
    for one in scene.platforms if scene.valves == "real" else ():
        for finding in check_device(one.own_device):
            if finding.level == "fail":
                raise HardwareError(finding.do, finding.found, "open")


def watch_time(run: Run, supervisor: RunMonitor, scene: Scene, console: Console) -> None:
    """Show progress until the scene's time is over.

    Parameters
    ----------
    run : Run
        Processes of the run.
    supervisor : RunMonitor
        Their messages.
    scene : Scene
        What runs.
    console : Console

    Raises
    ------
    KeyboardInterrupt
        If a signal has ended the run.
    SoroError
        If a process or a node fails, or the run's clock stops.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f}/{task.total:g} s"),
    )
    with Progress(*columns, TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task(scene.name, total=scene.duration_s)
        stall, now = Stall(), 0.0
        while now < scene.duration_s - 1e-9:
            supervisor.spin(ROUND_S)
            run.check_nodes(supervisor, scene.duration_s - now)
            now = run.passed_s(supervisor)
            stall.check(supervisor.clock_s if scene.mode == "lockstep" else now)  # a probe has no time
            progress.update(task, completed=min(now, scene.duration_s), description=_line(scene, supervisor))


class Stall:
    """Notices a clock that stands."""

    def __init__(self) -> None:
        self._moved, self._last = time.monotonic(), 0.0

    def check(self, now_s: float) -> None:
        """Raise SoroError if the time of the run [s] has been the same for too long."""
        if now_s > self._last:
            self._last, self._moved = now_s, time.monotonic()
        elif time.monotonic() - self._moved > STALL_S:
            raise SoroError(f"the clock of the run stands at {now_s:.3f} s for {STALL_S:.0f} s")


def _line(scene: Scene, supervisor: RunMonitor) -> str:
    """Name of the scene; with a real arm also its distance from the shadow."""
    status = supervisor.status.get("shadow")
    return scene.name if status is None else f"{scene.name}, shadow: {escape(status.message)}"


def execute(
    scene: Scene,
    folder: Path,
    interrupted: list[int],
    console: Console,
    loop: LoopNodes | None = None,
    watch: Callable[[Run, RunMonitor, Scene, Console], None] = watch_time,
) -> End:
    """Run the processes of a scene to their end.

    Parameters
    ----------
    scene : Scene
    folder : Path
    interrupted : list of int
        Signals that end the run, see `signals.noted`.
    console : Console
        Shows progress and errors.
    loop : LoopNodes, optional
        Nodes between readings and commands; default: estimator and controller.
    watch : callable
        Returns when the run is over, or raises what ends it.
    """
    from soro_ros.run.compose import Run
    from soro_ros.run.forks import ForkServer
    from soro_ros.run.processes import NodeError
    from soro_ros.run.supervisor import RunMonitor

    def report(line: str) -> None:
        with contextlib.suppress(OSError):  # nobody reads it, or the disk is full: the arm goes on
            console.print(f"[dim]{escape(line)}[/dim]", soft_wrap=True)

    forks = ForkServer(folder)  # before this process has threads
    run = Run(with_robot_files(scene, folder), folder, report, interrupted, loop, forks)
    errors: list[str] = []
    failed = ""  # name of the node that failed first
    is_refused = False
    try:
        with forks, RunMonitor(scene.name, [arm.prefix for arm in scene.each]) as supervisor:
            try:
                run.claim(supervisor.node)
                run.start(supervisor)
                run.begin(supervisor)
                watch(run, supervisor, scene, console)
            except KeyboardInterrupt:  # reported below
                pass
            except SoroError as failure:
                errors.append(str(failure))
                is_refused = isinstance(failure, ConfigError) and not run.has_started
                failed = failure.name if isinstance(failure, NodeError) else ""
                console.print(f"[red]soro: {escape(without_alike(str(failure)))}[/red]", soft_wrap=True)
            said = supervisor.warnings()
            if interrupted:
                console.print("interrupted: venting and closing the bag")
            run.empty(supervisor, bool(errors))
            for name, line in run.end().items():
                errors.append(line)
                if name != failed:  # the end of this one follows from its failure
                    console.print(f"[red]{escape(line)}[/red]", soft_wrap=True)
    finally:
        run.end()
    if not is_refused and (interrupted or errors or run.recording_failure):
        console.print(run.outcome(), soft_wrap=True)
    error = errors[0] if errors else ""
    status = 130 if interrupted else 2 if is_refused or run.refused else 1 if errors else 0
    return End(status, error, tuple(run.warnings.values()), run.recording_failure, said, run.has_begun)


def without_alike(text: str) -> str:
    """Return causes apart by semicolons without those whose first word is in the first: chambers alike."""
    first, *others = text.split("; ")
    left = [other for other in others if other.partition(":")[0] not in first]
    alike = len(others) - len(left)
    return "; ".join((first + (f", and {alike} more like it" if alike else ""), *left))
