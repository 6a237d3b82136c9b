"""`soro study SCENE --vary FILE`: a scene many times with other values, without ROS, and what came of it."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from soro_core.extras import require
from soro_hardware import signals
from soro_lab.scene.options import Change, SceneName, given_keys

if TYPE_CHECKING:
    from soro_ros.study.folder import StudyFolder


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
    command goes on where it stopped. Exit status 0: all runs are done, whatever their verdicts; 1: all are
    refused; 2: wrong use; 130: interrupted.
    """
    from soro_core.jobs import executor_of, map_jobs
    from soro_ros.study.folder import StudyFolder
    from soro_ros.study.runs import VariedScene, row_of, warm_up

    require("parquet")
    console = Console(stderr=True)
    with signals.noted() as interrupted, executor_of(jobs, dask) as executor:
        varied = VariedScene(scene, given_keys(change or []), str(vary))
        folder = StudyFolder(out or Path("study") / f"{Path(scene).stem}-{vary.stem}", varied)
        total, before = varied.file.runs, len(folder.rows)
        if before:
            console.print(f"{before} of {total} runs are done already")
        if before < total and not dask:
            warm_up(varied.scene)  # here, where it is said: workers of this machine find the kernels
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
    _write(folder, list(varied.file.vary))
    if len(folder.rows) < total:
        console.print(f"interrupted: {len(folder.rows)} of {total} runs are done; the same command goes on")
        raise typer.Exit(130)
    if all(row["verdict"] == "refused" for row in folder.rows.values()):
        console.print(f"every run is refused, the first one: {folder.in_order[0]['reason']}", soft_wrap=True)
        raise typer.Exit(1)


def _write(folder: StudyFolder, keys: list[str]) -> None:
    """Write table, summary and picture of the rows that are done, and print the summary."""
    from soro_ros.study.pictures import draw
    from soro_ros.study.summary import (
        LEVEL,
        SHOWN,
        STATISTICS,
        WORDS,
        bootstrapped,
        figure,
        share,
        summary_of,
    )

    rows, screen = folder.in_order, Console()
    written = [folder.write_table(keys), folder.path / "summary.json", folder.path / "study.png"]
    written[1].write_text(json.dumps(summary_of(rows, keys), indent=1) + "\n", encoding="utf-8")
    draw(rows, keys, written[2])
    shown = Table("", *STATISTICS, title=f"{len(rows)} runs, with {100 * LEVEL:g} % confidence intervals")
    for name, (text, _, unit) in SHOWN.items():
        if len(values := figure(rows, name)):
            shown.add_row(f"{text}, {unit}", *(str(bootstrapped(values, of)) for of in STATISTICS.values()))
    screen.print(shown)
    for word in WORDS:
        if count := sum(row["verdict"] == word for row in rows):
            screen.print(f"{word}: {share(count, len(rows), 100.0)} % of the runs", highlight=False)
    screen.print(f"written: {', '.join(map(str, written))}", soft_wrap=True, highlight=False)
