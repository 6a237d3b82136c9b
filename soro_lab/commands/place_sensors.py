"""`soro place-sensors ROBOT`: which sensors an arm needs, and where."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from soro_core.config import name_argument
from soro_core.errors import ConfigError
from soro_core.files.units import Quantity, unit_of, unit_option
from soro_lab.scene.options import Change, given_keys

_WHERE = "soro place-sensors"
# Longest motion of a scene that is looked at unless --seconds says so [s].
_SECONDS = 8.0
_WIDTH = 120


def place_sensors(
    robot: Annotated[str, name_argument("Robot file, or the name of a shipped one.", "robots")],
    scene: Annotated[
        str | None,
        typer.Option(
            help="Scene whose motion, noise and rates count; default: to the ends of the pressures."
        ),
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="Number of sensors.")] = 3,
    kinds: Annotated[str, typer.Option(help="Of pose, marker (position alone), imu, bend.")] = "pose,imu",
    candidates: Annotated[int, typer.Option(min=1, max=50, help="Places on each link.")] = 4,
    noise: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help="Deviation of a sensor, e.g. position_m=1mm; see the docs."),
    ] = None,
    pieces: Annotated[
        int, typer.Option(min=0, max=16, help="Pieces that each link bends in; 0: as the scene has it.")
    ] = 0,
    seconds: Annotated[
        float | None,
        unit_option(
            "--seconds",
            "s",
            0.1,
            600.0,
            help=f"Time of the scene's motion; default: all, {_SECONDS:g} s at most.",
        ),
    ] = None,
    change: Change = None,
    out: Annotated[
        Path | None, typer.Option(help="Picture to write (PNG); default ROBOT_sensors.png.")
    ] = None,
    numbers: Annotated[Path | None, typer.Option("--json", help="File for all numbers (JSON).")] = None,
) -> None:
    """Choose sensors and their places on an arm by what they say of its state during a motion.

    Prints the sensors in the order of choice with what each adds, and the keys of a scene that has them
    (docs/analysis.md). Ctrl-C ends it with exit status 130, and nothing is written.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.table import Table

    from soro_core.config import parse
    from soro_core.robot import load_robot
    from soro_lab.analysis.problem import place_sensors as choose
    from soro_lab.analysis.sensor_picture import draw
    from soro_lab.analysis.sensor_report import as_dict, best_line, scene_block, step_rows
    from soro_lab.analysis.sensors import KINDS
    from soro_lab.scene import Scene, load_scene, require_one_arm

    names = tuple(name.strip() for name in kinds.split(","))
    odd = [name for name in names if name not in KINDS or names.count(name) > 1]
    if odd:
        raise ConfigError(_WHERE, "--kinds", kinds, f"different ones of {', '.join(KINDS)}, with commas")
    deviations = _deviations(noise or [])
    described = load_robot(robot)
    file = Path(f"{described.name}_sensors.png") if out is None else out
    if file.suffix != ".png":
        raise ConfigError(_WHERE, "--out", str(file), "a name that ends with .png")
    if numbers is not None and numbers.suffix != ".json":
        raise ConfigError(_WHERE, "--json", str(numbers), "a name that ends with .json")
    changes = given_keys(change or []) | {"robot": robot}
    if scene is None:
        if seconds is not None:
            raise ConfigError(_WHERE, "--seconds", seconds, "none without --scene")
        if change:
            raise ConfigError(_WHERE, "--set", change[0], "none without --scene")
        loaded, time_s = parse(changes, Scene, _WHERE), 0.0
    else:
        loaded = require_one_arm(load_scene(scene, changes), scene)
        time_s = min(loaded.duration_s, _SECONDS) if seconds is None else seconds
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    try:
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task("motion", total=None)

            def show(what: str, done: int, total: int) -> None:
                bar.update(task, description=what, completed=done, total=total)

            found = choose(loaded, names, count, candidates, deviations, pieces, time_s, show)
    except KeyboardInterrupt:
        console.print("interrupted: nothing is written")
        raise typer.Exit(130) from None
    motion = f"motion of {loaded.name}" if scene else "to the ends of the pressures and back"
    title = f"{described.name}, {motion}, windows of {found.window_s:.3g} s"
    table = Table(title=title)
    for name in (
        "",
        "sensor",
        "link",
        "mm",
        "adds, nat",
        "smallest eigenvalue",
        "tip, mm",
        "worst coordinate",
    ):
        table.add_column(name)
    for row in step_rows(found):
        table.add_row(*row)
    screen = Console()
    Console(width=max(_WIDTH, screen.width)).print(table)
    if line := best_line(found):
        typer.echo(line)
    typer.echo(scene_block(found), nl=False)
    draw(file, found, title)
    written = [file]
    if numbers is not None:
        numbers.write_text(json.dumps(as_dict(found), indent=1) + "\n", encoding="utf-8")
        written.append(numbers)
    typer.echo(f"written: {', '.join(map(str, written))}")


def _deviations(given: list[str]) -> dict[str, float]:
    """Return the deviations of KEY=VALUE."""
    found = {}
    for item in given:
        key, _, text = item.partition("=")
        if not key or not text:
            raise ConfigError(_WHERE, "--noise", item, "KEY=NUMBER")
        found[key] = Quantity(unit_of(key), -math.inf, math.inf, "0.001").number(text, _WHERE, "--noise")
    return found
