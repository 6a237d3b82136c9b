"""`soro run SCENE`: start everything that a scene names, run it, and say how it went."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from soro_core.config import find_config, read_value
from soro_core.control.config import require_chambers
from soro_core.errors import ConfigError, HardwareError, SoroError
from soro_core.hardware import load_platform
from soro_core.hardware.doctor import check_device
from soro_core.robot import Robot, load_robot
from soro_core.scene import Scene, check_model, load_scene
from soro_ros import signals
from soro_ros.run_folder import new_folder

# A lockstep run whose clock does not move any more.
STALL_S = 30.0
SCENE_HELP = "Scene file, or the name of a shipped one."


def run(
    scene: Annotated[str, typer.Argument(help=SCENE_HELP)],
    change: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Change a key of the scene, e.g. controller.adapt=false."
        ),
    ] = None,
    valves: Annotated[
        str | None, typer.Option(help="emulated, or real: those of the platform, there already.")
    ] = None,
    device: Annotated[
        str | None, typer.Option(help="Path or address of real valves; implies --valves real.")
    ] = None,
    arm: Annotated[
        str | None,
        typer.Option(help="simulated, or real: its sensors publish, the twin runs beside it as a shadow."),
    ] = None,
    folder: Annotated[Path, typer.Option(help="Where the folder of the run is made.")] = Path("runs"),
    figure: Annotated[bool, typer.Option(help="Draw the picture of the run.")] = True,
) -> None:
    """Run a scene: emulated or simulated robot, estimator, controller and recorder, as ROS 2 nodes.

    Ends with a table, a picture and a bag in FOLDER/NAME-TIME. Ctrl-C vents, closes the bag and ends.
    """
    console = Console(stderr=True)
    with signals.noted() as interrupted:
        loaded = load_scene(scene, {**_changes(change or []), **_hardware(valves, device, arm)})
        robot = _check_files(loaded)
        for fault in loaded.faults:
            if fault.at >= loaded.duration_s:
                late = f"{fault} at {fault.at:g} s: the run ends at {loaded.duration_s:g} s"
                console.print(f"[yellow]{escape(late)}[/yellow]")
        if loaded.model is not None and loaded.model.auto:
            from soro_core.trade import with_chosen_model

            loaded = with_chosen_model(loaded, called=scene)
        check_model(loaded, robot, str(find_config(scene, "scenes")))
        _warn_of_stalls(loaded, console)
        target = new_folder(folder, loaded.name)
        shutil.copy(find_config(scene, "scenes"), target / "scene.yaml")
        used = yaml.safe_dump(loaded.to_dict(), sort_keys=False)
        (target / "scene_used.yaml").write_text(used)
        status = _execute(loaded, target, interrupted, console)
    bag = target / "bag"
    if loaded.recorder.enabled and bag.exists():
        from soro_ros.report import draw, summarise, table

        summary = summarise(bag, loaded)
        if summary is None:
            console.print("nothing was under control long enough to report on")
        else:
            Console().print(table(summary, loaded))
            (target / "summary.json").write_text(summary.to_json())
            if figure:
                draw(bag, loaded, target / "run.png")
                console.print(f"picture: {target / 'run.png'}")
        console.print(f"bag:     {bag}")
    raise typer.Exit(status)


def _warn_of_stalls(scene: Scene, console: Console) -> None:
    from soro_ros.middleware import may_stall

    if scene.mode == "real_time" and scene.platform and (warning := may_stall()):
        console.print(f"[yellow]{escape(warning)}[/yellow]", soft_wrap=True)


def _execute(scene: Scene, folder: Path, interrupted: list[int], console: Console) -> int:
    """Run the processes to their end; returns the exit status."""
    from soro_ros.compose import Run
    from soro_ros.processes import NodeError
    from soro_ros.supervisor import Supervisor

    run = Run(scene, folder, say=lambda line: console.print(f"[dim]{line}[/dim]"))
    status, told = 0, ""
    try:
        with Supervisor(scene.name) as supervisor:
            try:
                run.start(supervisor, lambda: bool(interrupted))
                if not interrupted:
                    run.begin(supervisor)
                    _watch(run, supervisor, scene, interrupted, console)
            except SoroError as error:
                console.print(f"[red]soro: {escape(str(error))}[/red]", soft_wrap=True)
                status, told = 1, error.name if isinstance(error, NodeError) else ""
            if interrupted:
                console.print("interrupted: venting and closing the bag")
            for name, trouble in run.end().items():
                status = 1
                if name != told:  # its end is what has just been told, or came of it
                    console.print(f"[red]{escape(trouble)}[/red]", soft_wrap=True)
    finally:
        run.end()
    if interrupted or status:
        console.print(run.outcome(), soft_wrap=True)
    return 130 if interrupted else status


def _watch(run: Any, supervisor: Any, scene: Scene, interrupted: list[int], console: Console) -> None:
    """Show progress until the scene's time is over; raises SoroError when something goes wrong."""
    moved, last = time.monotonic(), 0.0
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f}/{task.total:g} s"),
    )
    with Progress(*columns, TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task(scene.name, total=scene.duration_s)
        while not interrupted:
            supervisor.spin(0.1)
            run.check()
            supervisor.check()
            supervisor.check_heard(run.nodes)
            now = supervisor.clock_s if scene.mode == "lockstep" else supervisor.controlled_s
            if now > last:
                last, moved = now, time.monotonic()
            elif time.monotonic() - moved > STALL_S:
                raise SoroError(f"time has stood still at {now:.3f} s for {STALL_S:.0f} s")
            progress.update(task, completed=min(now, scene.duration_s), description=_line(scene, supervisor))
            if now >= scene.duration_s - 1e-9:
                return


def _line(scene: Scene, supervisor: Any) -> str:
    """Name of the scene, and with a real arm how far it is from its shadow now."""
    status = supervisor.status.get("shadow")
    return scene.name if status is None else f"{scene.name}, shadow: {escape(status.message)}"


def _check_files(scene: Scene) -> Robot:
    """Read what the scene names, so that a wrong file is told before anything starts."""
    robot = load_robot(find_config(scene.robot, "robots"))
    require_chambers(robot, f"scene {scene.name}")
    if not scene.platform:
        return robot
    platform = load_platform(scene.platform).at_rate(scene.rate_hz)
    if scene.valves == "real" and not (scene.device or platform.device):
        allowed = f"--device, or {platform.where_device} in the platform file: where the valves are"
        raise ConfigError(scene.platform, "device", "", allowed)
    if scene.valves == "real":
        for finding in check_device(scene.device or platform.device or ""):
            if finding.level == "fail":
                raise HardwareError(f"{finding.found}: {finding.do}")
    fed, has = platform.chamber_names, robot.chamber_names
    if set(fed) != set(has):
        other = [f"{name}, which the robot has not" for name in fed if name not in has]
        other += [f"no {name}" for name in has if name not in fed]
        allowed = f"one valve for each chamber of robot {scene.robot}: {', '.join(has)}"
        raise ConfigError(scene.platform, "valves", f"{len(fed)} valves: {other[0]}", allowed)
    return robot


def _hardware(valves: str | None, device: str | None, arm: str | None) -> dict[str, Any]:
    """What the options change in the scene."""
    if device == "":  # of a shell variable that is not set: the run would be on emulated valves
        raise ConfigError("soro run", "--device", device, "the path or address of the valves")
    given = {"valves": valves or ("real" if device else None), "device": device, "arm": arm}
    return {key: value for key, value in given.items() if value is not None}


def _changes(given: list[str]) -> dict[str, Any]:
    changes = {}
    for item in given:
        key, equals, value = item.partition("=")
        if not key or not equals:
            raise ConfigError("--set", "", item, "KEY=VALUE, for example controller.adapt=false")
        changes[key] = read_value(value, f"--set {key}") if value else ""
    return changes
