"""`soro log ARM`: trips, resets and changed parameters of an arm, and how it changes from run to run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from soro_core.errors import ConfigError


def log(
    arm: Annotated[
        str,
        typer.Argument(
            help="Namespace of the arm; / for nodes without one. A run has the name of its scene.",
            show_default=False,
        ),
    ],
    runs: Annotated[Path, typer.Option(help="Folder of its runs.")] = Path("runs"),
    report: Annotated[
        Path | None,
        typer.Option(help="Folder for a page with pictures and numbers of its runs.", show_default=False),
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace the page.")] = False,
) -> None:
    """Print what tripped an arm, who reset it, changed parameters, and how its runs say that it ages.

    Each line has the time in UTC, the node, the event, and its cause or values. The file is one of this user
    and this machine, and keeps the last 1 to 2 MB of all arms. Below them, of the runs judged good or poor:
    the error of the model under the measured pressures, the stiffness with which it would be least, learned
    numbers that change with time, and "identify again" from 1.3 times the error when new. Exit status 2
    where there is no line and no run of ARM.
    """
    from rich.console import Console

    from soro_ros.ageing.history import runs_of, since_identified
    from soro_ros.ageing.page import write_page
    from soro_ros.ageing.trend import ageing, lines
    from soro_ros.host import event_log

    if report is not None and report.exists() and not force:
        raise ConfigError("soro log", "--report", str(report), "what does not exist, or --force")
    wanted = f"/{arm.strip('/')}"
    entries = list(event_log.entries())
    events = [entry for entry in entries if entry.arm == wanted]
    with Console(stderr=True).status("") as shown:
        name = wanted[1:]
        found = (
            since_identified(runs_of(name, runs, lambda run: shown.update(f"reads {run}"))) if name else []
        )
    if not events and not found:
        known = ", ".join(sorted({entry.arm for entry in entries}))
        where = f"{event_log.files()[-1]}; no run in {runs}"
        raise ConfigError(
            "soro log", "ARM", arm, f"one of {known} ({where})" if known else f"none yet in {where}"
        )
    if report is not None and not found:
        raise ConfigError("soro log", "--report", str(report), f"an arm with runs; none of {arm} in {runs}")
    for entry in events:
        typer.echo("  ".join((entry.time, entry.node, entry.event, entry.text)).rstrip())
    if found:
        said = ageing(found)
        typer.echo("\n".join(lines(said)))
        if report is not None:
            typer.echo(f"page: {write_page(name, said, report)}")
