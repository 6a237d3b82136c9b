"""`soro plot RUN --film FILE`: a film of a recorded run."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from soro_core.errors import ConfigError
from soro_core.extras import require
from soro_core.files.units import unit_option
from soro_lab.run_folder import bag_and_scene
from soro_lab.scene import load_scene

Rate: TypeAlias = Annotated[
    float, unit_option("--rate", "Hz", 1.0, 50.0, "10Hz", help="Pictures a second of a film.")
]
Width: TypeAlias = Annotated[int, typer.Option(min=200, max=4000, metavar="PIXELS", help="Width of a film.")]


def film(
    run: Annotated[
        Path,
        typer.Argument(help="Folder of a run, or one of bags/.", exists=True, file_okay=False),
    ],
    out: Annotated[
        Path | None, typer.Option(help="File to write: .gif, or .png for one picture. Default: RUN/film.gif.")
    ] = None,
    start: Annotated[
        float, unit_option("--start", "s", 0.0, example="0s", help="First time that is shown.")
    ] = 0.0,
    end: Annotated[
        float | None, unit_option("--end", "s", 0.0, help="Last time; default: where the arm rests.")
    ] = None,
    rate: Rate = 10.0,
    width: Width = 800,
) -> None:
    """Draw the arm of a recorded run as it moves: reference, path of the tip, pressures, tip error.

    A simulated arm is drawn as it was, a real one as the estimator found it. A .png holds the last picture.
    """
    require("ros")
    from soro_ros.pictures import film as drawing

    file = run / "film.gif" if out is None else out
    if file.suffix not in (".gif", ".png"):
        raise ConfigError("soro plot", "--film", str(file), "a name that ends with .gif or .png")
    bag, scene_file = bag_and_scene(run)
    scene = load_scene(str(scene_file))
    shown = drawing.take(bag, scene, start, math.inf if end is None else end, rate)
    write = drawing.still if file.suffix == ".png" else drawing.write
    write(shown, file, width)
    typer.echo(f"{file}: {file.stat().st_size / 1e6:.2f} MB")
