"""`soro study SCENE --vary FILE`: a scene many times with other values, without ROS, and what came of it."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from soro_core.extras import require
from soro_hardware import signals
from soro_lab.scene.options import Change, SceneName, given_keys


def study(
    scene: SceneName,
    vary: Annotated[Path, typer.Option(metavar="FILE", help="Keys that vary, and how (docs/study.md).")],
    change: Change = None,
    jobs: Annotated[int, typer.Option(min=1, help="Runs at a time, each in a process.")] = 1,
    dask: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Run on this Dask cluster (extra: dask).")
    ] = "",
    out: Annotated[
        Path | None, typer.Option(help="Folder of the study; default study/SCENE-FILE.", show_default=False)
    ] = None,
) -> None:
    """Run SCENE many times in lockstep with other values, and say how the arm follows.

    Each run is one process without ROS and without devices; its verdict is that of soro run. Writes a table
    (runs.parquet), a summary with confidence intervals and a picture. Ctrl-C keeps what is done; the same
    command goes on where it stopped. Exit status 0: all runs are done, whatever their verdicts; 2: wrong use;
    130: interrupted.
    """
    from soro_core.jobs import executor_of, map_jobs
    from soro_ros.study.folder import StudyFolder, asked
    from soro_ros.study.runs import VariedScene, row_of

    require("parquet")
    console = Console(stderr=True)
    with signals.noted() as interrupted, executor_of(jobs, dask) as executor:
        varied = VariedScene(scene, given_keys(change or []), str(vary))
        keys = list(varied.file.vary)
        folder = StudyFolder(out or Path("study") / f"{Path(scene).stem}-{vary.stem}", asked(varied))
        total, before = varied.file.runs, len(folder.rows)
        if before:
            console.print(f"{before} of {total} runs are done already")
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=console) as bar:
            task = bar.add_task("runs", total=total, completed=before)
            waiting = varied.jobs(dict(folder.rows))
            with closing(map_jobs(row_of, waiting, executor, False, lambda: bool(interrupted))) as rows:
                for row in rows:
                    folder.keep(row)
                    bar.update(task, completed=len(folder.rows))
    if not folder.rows:
        console.print("interrupted: no run is done yet")
        raise typer.Exit(130)
    _write(folder, keys)
    if len(folder.rows) < total:
        console.print(f"interrupted: {len(folder.rows)} of {total} runs are done; the same command goes on")
        raise typer.Exit(130)


def _write(folder: Any, keys: list[str]) -> None:
    """Write table, summary and picture of the rows that are done, and print the summary."""
    from soro_ros.study.pictures import draw
    from soro_ros.study.summary import SHOWN, Interval95, summary_of

    rows = folder.in_order
    found = summary_of(rows, keys)
    written = [folder.write_table(keys), folder.path / "summary.json", folder.path / "study.png"]
    written[1].write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    draw(rows, keys, written[2])
    shown = Table(title=f"{found['runs']} runs; in brackets {100 * found['level']:g} % confidence intervals")
    for column in ("", "mean", "median", "95 % below"):
        shown.add_column(column)
    for name, one in found["figures"].items():
        texts = (str(Interval95(**one[kind])) for kind in ("mean", "median", "95 % below"))
        shown.add_row(f"{SHOWN[name][0]}, {one['unit']}", *texts)
    screen = Console()
    screen.print(shown)
    for word, one in found["verdicts"].items():
        share = Interval95(**{end: 100.0 * value for end, value in one.items()})
        screen.print(f"{word}: {share} % of the runs", highlight=False)
    screen.print(f"written: {', '.join(map(str, written))}", soft_wrap=True, highlight=False)
