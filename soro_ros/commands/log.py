"""`soro log ARM`: trips, resets and changed parameters of an arm, over all runs."""

from __future__ import annotations

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
) -> None:
    """Print what tripped an arm, who reset it and which parameters were changed, the newest last.

    Each line has the time in UTC, the node, the event, and its cause or values. The file is one of this user
    and this machine, and keeps the last 1 to 2 MB of all arms. Exit status 2 where it has no line of ARM.
    """
    from soro_ros.host import event_log

    wanted = f"/{arm.strip('/')}"
    found = list(event_log.entries())
    lines = [entry for entry in found if entry.arm == wanted]
    if not lines:
        known = ", ".join(sorted({entry.arm for entry in found}))
        where = str(event_log.files()[-1])
        raise ConfigError(
            "soro log", "ARM", arm, f"one of {known} ({where})" if known else f"none yet in {where}"
        )
    for entry in lines:
        typer.echo("  ".join((entry.time, entry.node, entry.event, entry.text)).rstrip())
