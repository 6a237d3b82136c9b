"""`soro run SCENE`: check a scene, start its processes, watch them, and report the result."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from soro_core.adaptation.kept import kept_file, load_kept
from soro_core.errors import ConfigError, SoroError
from soro_hardware import signals
from soro_lab.run_folder import run_folders
from soro_lab.scene import Scene, check_gains, check_learned, check_scene
from soro_lab.scene.options import Arm, Change, Device, Folder, SceneName, Valves, changes_of
from soro_ros.run.end import End
from soro_ros.run.execution import execute, make_folder, prepare


def run(
    scene: SceneName,
    change: Change = None,
    valves: Valves = None,
    device: Device = None,
    arm: Arm = None,
    folder: Folder = Path("runs"),
    figure: Annotated[bool, typer.Option(help="Draw the picture of the run.")] = True,
    view: Annotated[
        bool, typer.Option("--view", help="Show the arm in the browser while it runs (docs/view.md).")
    ] = False,
    learn_from: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN",
            autocompletion=run_folders,
            help="Run folder, or its learned.yaml: start from what the law had learned there.",
        ),
    ] = None,
) -> None:
    """Run a scene: emulated or simulated robot, estimator, controller and recorder, as ROS 2 nodes.

    Ends with a verdict (good, poor, lost, vented or refused), a table, a picture and a bag in
    FOLDER/NAME-TIME. Exit status 0: good; 1: poor, lost or vented; 2: refused
    before anything moved. Ctrl-C vents, closes the bag and ends.
    """
    console = Console(stderr=True)
    with signals.noted() as interrupted:
        changes = changes_of("soro run", change or [], valves, device, arm)
        loaded, where = prepare(scene, changes, check_scene, console, ["view"] if view else [])
        if learn_from is not None:
            loaded = loaded.with_learned(load_kept(learn_from))
        check_learned(loaded, where if learn_from is None else str(kept_file(learn_from)))
        target = make_folder(folder, loaded, where)
        _check_gains(loaded, where, target, console)
        with _viewing(loaded, target, interrupted, console) if view else contextlib.nullcontext():
            end = execute(loaded, target, interrupted, console)
    raise typer.Exit(_report(loaded, target, end, figure, console))


@contextlib.contextmanager
def _viewing(scene: Scene, folder: Path, interrupted: list[int], console: Console) -> Iterator[None]:
    """Show the run in the browser, as long as it lasts."""
    from soro_ros.view.beside import viewing

    with viewing(scene, folder, interrupted) as address:
        console.print(f"view:    {address}", soft_wrap=True, highlight=False)
        yield
    console.print(f"view:    ended; again: soro view {folder}", highlight=False)


def _check_gains(scene: Scene, where: str, target: Path, console: Console) -> None:
    """Refuse gains of another robot; the folder of the run then holds the verdict."""
    try:
        line = check_gains(scene, scene.loaded_robot, where)
    except ConfigError as error:
        from soro_ros.recordings.verdict import Verdict, write

        write(target, None, Verdict("refused", str(error)))
        raise
    if line:
        console.print(f"[dim]{escape(line)}[/dim]", soft_wrap=True)


def _report(scene: Scene, folder: Path, end: End, figure: bool, console: Console) -> int:
    """Judge a run, write and print the result; return the exit status."""
    from soro_ros.pictures.picture import draw
    from soro_ros.recordings.learned import keep_learned
    from soro_ros.recordings.report import read_run, summarise, table
    from soro_ros.recordings.verdict import advice, judge, with_verdict, write

    bag = folder / "bag"
    recorded = scene.recorder.enabled and bag.exists()
    failure = end.recording_failure
    recording = summary = None
    try:
        if recorded:
            recording = read_run(bag, scene)
            summary = summarise(recording, scene)
    except SoroError as error:
        failure = failure or str(error)
    verdict = judge(summary, scene, replace(end, recording_failure=failure), recording)
    write(folder, summary, verdict)
    if summary is not None:
        summary = with_verdict(summary, verdict)
        Console().print(table(summary, scene))
        if figure and recording is not None:
            draw(recording, scene, folder / "run.png")
            console.print(f"picture: {folder / 'run.png'}")
    elif recorded and not failure:
        console.print("control was too short for a report")
    if verdict.word in ("poor", "lost"):
        console.print(f"[red]soro: {escape(str(verdict))}[/red]", soft_wrap=True)
    for line in verdict.notes:
        beside = "good, but " if verdict.word == "good" else ""
        console.print(f"[yellow]{beside}{escape(line)}[/yellow]", soft_wrap=True)
    if hint := advice(verdict, scene):
        console.print(hint, soft_wrap=True)
    if recorded:
        console.print(f"bag:     {bag}")
        if summary is not None:
            console.print(f"film:    soro plot {folder} --film {folder}/film.gif", soft_wrap=True)
            console.print(f"page:    soro report {folder}")
    if recording is not None and verdict.word in ("good", "poor") and keep_learned(folder, recording, scene):
        console.print(f"learned: soro run SCENE --learn-from {folder}", soft_wrap=True, highlight=False)
    return end.status or (0 if verdict.word == "good" else 1)
