"""`soro run SCENE`: check a scene, start its processes, watch them, and report the result."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
import yaml
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from soro_core.config import find_config, read_value
from soro_core.errors import ConfigError, HardwareError, SoroError
from soro_core.extras import require
from soro_core.hardware.doctor import check_device
from soro_core.scene import Scene, check_gains, check_scene, load_scene
from soro_ros import signals
from soro_ros.run_folder import new_folder

if TYPE_CHECKING:
    from soro_ros.compose import Run
    from soro_ros.supervisor import Supervisor


@dataclass(frozen=True)
class End:
    """How the processes ended: exit status, and the first error (empty without one)."""

    status: int
    error: str


# Longest time [s] without progress of the run's clock.
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

    Ends with a verdict (good, lost, vented or refused), a table, a picture and a bag in FOLDER/NAME-TIME.
    Exit status 0: good; 1: lost or vented; 2: refused before anything moved. Ctrl-C vents, closes the bag and
    ends.
    """
    console = Console(stderr=True)
    with signals.noted() as interrupted:
        loaded = load_scene(scene, _changes(change or [], valves, device, arm))
        require("ros", *(["hardware"] if loaded.platform else []))
        if loaded.model is not None and loaded.model.auto:
            from soro_core.trade import with_chosen_model

            loaded = with_chosen_model(loaded, called=scene)
        where = str(find_config(scene, "scenes"))
        warnings = check_scene(loaded, where)
        if loaded.mode == "real_time" and loaded.platform:
            from soro_ros.middleware import stall_warning

            warnings += stall_warning()
        for line in warnings:
            console.print(f"[yellow]{escape(line)}[/yellow]", soft_wrap=True)
        _check_devices(loaded)
        target = new_folder(folder, loaded.name)
        shutil.copy(where, target / "scene.yaml")
        used = yaml.safe_dump(loaded.to_dict(), sort_keys=False)
        (target / "scene_used.yaml").write_text(used)
        _check_gains(loaded, where, target, console)
        end = execute(loaded, target, interrupted, console)
    raise typer.Exit(_report(loaded, target, end, figure, console))


def _changes(given: list[str], valves: str | None, device: str | None, arm: str | None) -> dict[str, Any]:
    """Keys of the scene that the options change, with their values."""
    changes = given_keys(given)
    if device == "":  # of a shell variable that is not set: the run would be on emulated valves
        raise ConfigError("soro run", "--device", device, "the path or address of the valves")
    options = {"valves": valves or ("real" if device else None), "device": device, "arm": arm}
    return changes | {key: value for key, value in options.items() if value is not None}


def given_keys(given: list[str]) -> dict[str, Any]:
    """Return the keys of a scene that KEY=VALUE change, with their values."""
    changes: dict[str, Any] = {}
    for item in given:
        key, equals, value = item.partition("=")
        if not key or not equals:
            raise ConfigError("--set", "", item, "KEY=VALUE, for example controller.adapt=false")
        changes[key] = read_value(value, f"--set {key}") if value else ""
    return changes


def _check_devices(scene: Scene) -> None:
    """Refuse real valves whose adapter or port does not exist."""
    if scene.valves == "real" and scene.loaded_platform is not None:
        for finding in check_device(scene.device or scene.loaded_platform.device or ""):
            if finding.level == "fail":
                raise HardwareError(finding.do, finding.found, "open")


def _check_gains(scene: Scene, where: str, target: Path, console: Console) -> None:
    """Refuse gains of another robot; the folder of the run then holds the verdict."""
    try:
        line = check_gains(scene, scene.loaded_robot, where)
    except ConfigError as error:
        from soro_ros.verdict import Verdict, write

        write(target, None, Verdict("refused", str(error)))
        raise
    if line:
        console.print(f"[dim]{escape(line)}[/dim]", soft_wrap=True)


def execute(scene: Scene, folder: Path, interrupted: list[int], console: Console) -> End:
    """Run the processes of a scene to their end.

    Parameters
    ----------
    scene : Scene
        What to run.
    folder : Path
        Folder of the run.
    interrupted : list of int
        Signals that end the run, see `signals.noted`.
    console : Console
        Shows progress and errors.

    Returns
    -------
    End
    """
    from soro_ros.compose import Run
    from soro_ros.processes import NodeError
    from soro_ros.supervisor import Supervisor

    run = Run(scene, folder, lambda line: console.print(f"[dim]{line}[/dim]"), interrupted)
    errors: list[str] = []
    failed = ""  # name of the node that failed first
    try:
        with Supervisor(scene.name) as supervisor:
            try:
                run.start(supervisor)
                run.begin(supervisor)
                _watch(run, supervisor, scene, console)
            except KeyboardInterrupt:  # reported below
                pass
            except SoroError as failure:
                errors.append(str(failure))
                failed = failure.name if isinstance(failure, NodeError) else ""
                console.print(f"[red]soro: {escape(str(failure))}[/red]", soft_wrap=True)
            if interrupted:
                console.print("interrupted: venting and closing the bag")
            for name, line in run.end().items():
                errors.append(line)
                if name != failed:  # the end of this one follows from its failure
                    console.print(f"[red]{escape(line)}[/red]", soft_wrap=True)
    finally:
        run.end()
    if interrupted or errors:
        console.print(run.outcome(), soft_wrap=True)
    error = errors[0] if errors else ""
    if interrupted:
        return End(130, error)
    return End(2 if run.refused else 1 if errors else 0, error)


def _watch(run: Run, supervisor: Supervisor, scene: Scene, console: Console) -> None:
    """Show progress until the scene's time is over.

    Raises
    ------
    KeyboardInterrupt
        If a signal has ended the run.
    SoroError
        If a process or a node fails, or the run's clock stops.
    """
    moved, last = time.monotonic(), 0.0
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f}/{task.total:g} s"),
    )
    with Progress(*columns, TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task(scene.name, total=scene.duration_s)
        now = 0.0
        while now < scene.duration_s - 1e-9:
            supervisor.spin(0.1)
            run.check()
            supervisor.check()
            supervisor.check_silence(run.nodes)
            now = supervisor.clock_s if scene.mode == "lockstep" else supervisor.controlled_s
            if now > last:
                last, moved = now, time.monotonic()
            elif time.monotonic() - moved > STALL_S:
                raise SoroError(f"the clock of the run stands at {now:.3f} s for {STALL_S:.0f} s")
            progress.update(task, completed=min(now, scene.duration_s), description=_line(scene, supervisor))


def _line(scene: Scene, supervisor: Supervisor) -> str:
    """Name of the scene; with a real arm also its distance from the shadow."""
    status = supervisor.status.get("shadow")
    return scene.name if status is None else f"{scene.name}, shadow: {escape(status.message)}"


def _report(scene: Scene, folder: Path, end: End, figure: bool, console: Console) -> int:
    """Judge a run, write and print the result; return the exit status."""
    from soro_ros.picture import draw
    from soro_ros.report import summarise, table
    from soro_ros.verdict import judge, with_verdict, write

    bag = folder / "bag"
    recorded = scene.recorder.enabled and bag.exists()
    summary = summarise(bag, scene) if recorded else None
    verdict = judge(summary, scene, end.status, end.error)
    write(folder, summary, verdict)
    if summary is not None:
        summary = with_verdict(summary, verdict)
        Console().print(table(summary, scene))
        if figure:
            draw(bag, scene, folder / "run.png")
            console.print(f"picture: {folder / 'run.png'}")
    elif recorded:
        console.print("control was too short for a report")
    if verdict.word == "lost":
        console.print(f"[red]soro: {escape(str(verdict))}[/red]", soft_wrap=True)
    if recorded:
        console.print(f"bag:     {bag}")
        if summary is not None:
            console.print(f"film:    soro film {folder}")
    return 1 if verdict.word == "lost" else end.status
