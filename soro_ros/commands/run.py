"""`soro run SCENE`: check a scene, start its processes, watch them, and report the result."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from soro_core.adaptation.kept import kept_file, load_kept
from soro_core.errors import ConfigError, SoroError
from soro_hardware import signals
from soro_lab.run_folder import run_folders
from soro_lab.scene import Scene, check_gains, check_learned, check_scene, require_one_arm
from soro_lab.scene.options import Arm, Change, Device, Folder, SceneName, Valves, changes_of
from soro_ros.run.end import End
from soro_ros.run.execution import execute, make_folder, prepare

if TYPE_CHECKING:
    from soro_ros.recordings.recording import RunRecording
    from soro_ros.recordings.report import Summary
    from soro_ros.recordings.verdict import Verdict


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
            loaded = require_one_arm(loaded, where).with_learned(load_kept(learn_from))
        for one in loaded.each:
            check_learned(one, where if learn_from is None else str(kept_file(learn_from)))
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
    for arm in scene.each:
        try:
            line = check_gains(arm, arm.loaded_robot, where)
        except ConfigError as error:
            from soro_ros.recordings.verdict import Verdict, write

            write(target, None, Verdict("refused", str(error)))
            raise
        if line:
            console.print(f"[dim]{escape(arm.prefix + line)}[/dim]", soft_wrap=True)


def _report(scene: Scene, folder: Path, end: End, figure: bool, console: Console) -> int:
    """Judge a run, write and print the result; return the exit status."""
    from soro_ros.recordings.verdict import advice, worst, write

    results = {one.prefix.rstrip("/"): _judge_arm(one, folder, end) for one in scene.each}
    bodies, of_bodies = _judge_bodies(scene, folder)
    verdict = worst({name or "arm": result.verdict for name, result in results.items()} | of_bodies)
    if scene.arms:
        arms = {name: (found.summary, found.verdict) for name, found in results.items()}
        write(folder, None, verdict, arms, bodies)
    else:
        write(folder, results[""].summary, verdict, bodies=bodies)
    for one, result in zip(scene.each, results.values(), strict=True):
        _show(one, folder, result, figure, console, end.error)
    if verdict.word in ("poor", "lost"):
        console.print(f"[red]soro: {escape(str(verdict))}[/red]", soft_wrap=True)
    for line in verdict.notes:
        beside = "good, but " if verdict.word == "good" else ""
        console.print(f"[yellow]{beside}{escape(line)}[/yellow]", soft_wrap=True)
    if hint := advice(verdict, scene):
        console.print(hint, soft_wrap=True)
    if scene.recorder.enabled and (folder / "bag").exists():
        console.print(f"bag:     {folder / 'bag'}")
        if any(result.summary is not None for result in results.values()):
            which = f" --arm {scene.each[0].name}" if scene.arms else ""
            console.print(f"film:    soro plot {folder}{which} --film {folder}/film.gif", soft_wrap=True)
            console.print(f"page:    soro report {folder}{which}")
    if not scene.arms:
        _keep(scene, folder, results[""], console)
    return end.status or (0 if verdict.word == "good" else 1)


@dataclass(frozen=True)
class _Result:
    """What came out of a run for one arm."""

    recording: RunRecording | None
    summary: Summary | None
    verdict: Verdict
    failure: str


def _judge_arm(arm: Scene, folder: Path, end: End) -> _Result:
    from soro_ros.recordings.report import read_run, summarise
    from soro_ros.recordings.verdict import judge

    failure = end.recording_failure
    recording = summary = None
    try:
        if arm.recorder.enabled and (folder / "bag").exists():
            recording = read_run(folder / "bag", arm)
            summary = summarise(recording, arm)
    except SoroError as error:
        failure = failure or str(error)
    prefix = arm.prefix
    said = {name.removeprefix(prefix): line for name, line in end.said.items() if name.startswith(prefix)}
    own = replace(end, recording_failure=failure, said=said)
    return _Result(recording, summary, judge(summary, arm, own, recording), failure)


def _judge_bodies(scene: Scene, folder: Path) -> tuple[dict[str, Any], dict[str, Verdict]]:
    """Return the figures of the bodies, and the verdict on them by its name; print them."""
    if not (scene.bodies and scene.recorder.enabled and (folder / "bag").exists()):
        return {}, {}
    from soro_ros.recordings.bodies.figures import figures_of_bodies, judge_bodies, table_of_bodies

    try:
        found = figures_of_bodies(folder / "bag", scene)
    except SoroError:  # what the arms say of the bag
        return {}, {}
    if found:
        Console().print(table_of_bodies(found))
    return {name: one.to_dict() for name, one in found.items()}, {"bodies": judge_bodies(found)}


def _show(arm: Scene, folder: Path, result: _Result, figure: bool, console: Console, said: str) -> None:
    """Print the figures of an arm, and draw its picture."""
    from soro_ros.pictures.picture import draw
    from soro_ros.recordings.report import table
    from soro_ros.recordings.verdict import with_verdict

    if result.summary is not None:
        Console().print(table(with_verdict(result.summary, result.verdict), arm, said))
        if figure and result.recording is not None:
            picture = folder / f"{arm.prefix.rstrip('/') or 'run'}.png"
            draw(result.recording, arm, picture)
            console.print(f"picture: {picture}")
    elif result.recording is not None and not result.failure:
        console.print(f"{arm.prefix}control was too short for a report")


def _keep(scene: Scene, folder: Path, result: _Result, console: Console) -> None:
    """Keep what the law has learned, for a later run."""
    from soro_ros.recordings.learned import keep_learned

    recording, word = result.recording, result.verdict.word
    if recording is not None and word in ("good", "poor") and keep_learned(folder, recording, scene):
        console.print(f"learned: soro run SCENE --learn-from {folder}", soft_wrap=True, highlight=False)
