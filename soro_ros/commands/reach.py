"""`soro reach ROBOT`: where the tip of an arm can rest."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from soro_core.errors import ConfigError


def reach(
    robot: Annotated[str, typer.Argument(help="Robot file, or the name of a shipped one.")],
    load_g: Annotated[
        float, typer.Option(min=0.0, help="Load at the tip, beside the tip mass of the robot.")
    ] = 0.0,
    low_kpa: Annotated[
        float | None, typer.Option(help="Lowest pressure; default: that of the robot.")
    ] = None,
    high_kpa: Annotated[
        float | None, typer.Option(help="Highest pressure; default: that of the robot.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Picture to write (PNG); default ROBOT_reach.png.")] = None,
) -> None:
    """Compute where the tip rests under a grid of pressures; print its range and draw it.

    The pressures hold these places for ever. A motion needs some pressure more, see `soro move`.
    """
    from rich.console import Console
    from rich.table import Table

    from soro_core.control.config import require_chambers
    from soro_core.control.reach_picture import draw
    from soro_core.control.reachable import reachable
    from soro_core.model import SoftArm
    from soro_core.robot import load_robot

    loaded = load_robot(robot)
    require_chambers(loaded, "soro reach")
    low, high = (
        own if given is None else 1e3 * given
        for own, given in zip(loaded.pressure_range_pa, (low_kpa, high_kpa), strict=True)
    )
    if not low < high:
        raise ConfigError("soro reach", "--low-kpa", 1e-3 * low, f"less than --high-kpa, {1e-3 * high:g}")
    file = Path(f"{loaded.name}_reach.png") if out is None else out
    if file.suffix != ".png":
        raise ConfigError("soro reach", "--out", str(file), "a name that ends with .png")
    arm, console = SoftArm(loaded), Console(stderr=True)
    with console.status("resting places"):
        found = reachable(arm, low, high, 1e-3 * load_g)
    title = f"{loaded.name}, {1e-3 * low:g} to {1e-3 * high:g} kPa, load {load_g:g} g"
    table = Table(title, "")
    for row in found.numbers():
        table.add_row(*row)
    Console().print(table)
    draw(file, arm, found, title)
    typer.echo(f"written: {file}")
