"""`soro reach ROBOT`: where the tip of an arm can rest, how stiff it is there, and how it swings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from soro_core.config import name_argument
from soro_core.errors import ConfigError
from soro_core.files.units import unit_option

# Width of the tables, at least.
_WIDTH = 120


def reach(
    robot: Annotated[str, name_argument("Robot file, or the name of a shipped one.", "robots")],
    load: Annotated[
        float, unit_option("--load", "kg", 0.0, 1e3, "0g", help="At the tip, beside the robot's tip mass.")
    ] = 0.0,
    lowest: Annotated[
        float | None, unit_option("--low", "Pa", help="Lowest pressure; default: that of the robot.")
    ] = None,
    highest: Annotated[
        float | None, unit_option("--high", "Pa", help="Highest pressure; default: that of the robot.")
    ] = None,
    modes: Annotated[int, typer.Option(min=1, max=6, help="Modes that are printed and drawn.")] = 3,
    out: Annotated[Path | None, typer.Option(help="Picture to write (PNG); default ROBOT_reach.png.")] = None,
    numbers: Annotated[Path | None, typer.Option("--json", help="File for all numbers (JSON).")] = None,
) -> None:
    """Compute where the tip rests under a grid of pressures, its stiffness there, and natural frequencies.

    Prints the range of the tip, the stiffness of the tip and the modes, and draws them (docs/analysis.md).
    The pressures hold these places for ever. A motion needs some pressure more, see `soro move`.
    """
    from rich.console import Console
    from rich.table import Table

    from soro_core.control.config import require_chambers
    from soro_core.control.reachable_workspace import reachable
    from soro_core.model import SoftArm
    from soro_core.robot import load_robot
    from soro_lab.analysis.equilibrium_paths import ways
    from soro_lab.analysis.reach_picture import draw
    from soro_lab.analysis.reach_report import as_dict, mode_rows, place_rows, stiffness_rows

    loaded = load_robot(robot)
    require_chambers(loaded, "soro reach")
    low, high = (
        own if given is None else given
        for own, given in zip(loaded.pressure_range_pa, (lowest, highest), strict=True)
    )
    if not low < high:
        raise ConfigError(
            "soro reach", "--low", f"{1e-3 * low:g}kPa", f"less than --high, {1e-3 * high:g}kPa"
        )
    file = Path(f"{loaded.name}_reach.png") if out is None else out
    if file.suffix != ".png":
        raise ConfigError("soro reach", "--out", str(file), "a name that ends with .png")
    if numbers is not None and numbers.suffix != ".json":
        raise ConfigError("soro reach", "--json", str(numbers), "a name that ends with .json")
    arm = SoftArm(loaded.replace(tip_mass=loaded.tip_mass + load))
    console = Console(stderr=True)
    with console.status("resting places"):
        found = reachable(arm, low, high)
    with console.status("stiffness and modes") as status:
        through = ways(arm, low, high, lambda done, of: status.update(f"stiffness and modes: {done} of {of}"))
    title = f"{loaded.name}, {1e-3 * low:g} to {1e-3 * high:g} kPa, load {1e3 * load:g} g"
    tip, places, shapes = Table(title, ""), Table(), Table()
    for row in (*found.numbers(), *stiffness_rows(through)):
        tip.add_row(*row)
    for name in ("at", "tip, mm", "stiffness of the tip, N/m", "modes, Hz", "with losses, Hz (ratio)"):
        places.add_column(name)
    for cells in place_rows(through, modes):
        places.add_row(*cells)
    for name in ("mode at rest", "Hz", "of the tip's compliance", "strains"):
        shapes.add_column(name)
    for cells in mode_rows(arm, through, modes):
        shapes.add_row(*cells)
    screen = Console()
    screen = Console(
        width=max(_WIDTH, screen.width)
    )  # wrapped by a narrow terminal: a cut name would be worse
    for table in (tip, places, shapes):
        screen.print(table)
    draw(file, arm, found, through, modes, title)
    written = [file]
    if numbers is not None:
        numbers.write_text(json.dumps(as_dict(arm, found, through), indent=1) + "\n", encoding="utf-8")
        written.append(numbers)
    typer.echo(f"written: {', '.join(map(str, written))}")
