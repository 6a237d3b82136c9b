"""`soro reach ROBOT`: where the tip of an arm can rest, how stiff it is there, and how it swings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from soro_core.errors import ConfigError

# Width of the tables, at least.
_WIDTH = 120


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
    modes: Annotated[int, typer.Option(min=1, max=6, help="Modes that are printed and drawn.")] = 3,
    out: Annotated[Path | None, typer.Option(help="Picture to write (PNG); default ROBOT_reach.png.")] = None,
    numbers: Annotated[Path | None, typer.Option("--json", help="File for all numbers (JSON).")] = None,
) -> None:
    """Compute where the tip rests under a grid of pressures, its stiffness there, and natural frequencies.

    Prints the range of the tip, the stiffness of the tip and the modes, and draws them (docs/analysis.md).
    The pressures hold these places for ever. A motion needs some pressure more, see `soro move`.
    """
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    from soro_core.control.config import require_chambers
    from soro_core.control.reachable_workspace import reachable
    from soro_core.model import SoftArm
    from soro_core.robot import load_robot
    from soro_lab.analysis.equilibrium_paths import ways
    from soro_lab.analysis.reach_picture import draw
    from soro_lab.analysis.reach_report import as_dict, mode_rows, place_rows

    loaded = load_robot(robot)
    require_chambers(loaded, "soro reach")
    low, high = (
        own if given is None else 1e3 * given
        for own, given in zip(loaded.pressure_range_pa, (low_kpa, high_kpa), strict=True)
    )
    for option, value in (("--load-g", load_g), ("--low-kpa", 1e-3 * low), ("--high-kpa", 1e-3 * high)):
        if not np.isfinite(value):
            raise ConfigError("soro reach", option, value, "a finite number")
    if not low < high:
        raise ConfigError("soro reach", "--low-kpa", 1e-3 * low, f"less than --high-kpa, {1e-3 * high:g}")
    file = Path(f"{loaded.name}_reach.png") if out is None else out
    if file.suffix != ".png":
        raise ConfigError("soro reach", "--out", str(file), "a name that ends with .png")
    if numbers is not None and numbers.suffix != ".json":
        raise ConfigError("soro reach", "--json", str(numbers), "a name that ends with .json")
    arm = SoftArm(loaded.replace(tip_mass=loaded.tip_mass + 1e-3 * load_g))
    console = Console(stderr=True)
    with console.status("resting places"):
        found = reachable(arm, low, high)
    with console.status("stiffness and modes") as status:
        through = ways(arm, low, high, lambda done, of: status.update(f"stiffness and modes: {done} of {of}"))
    title = f"{loaded.name}, {1e-3 * low:g} to {1e-3 * high:g} kPa, load {load_g:g} g"
    tip, places, shapes = Table(title, ""), Table(), Table()
    for row in found.numbers():
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
