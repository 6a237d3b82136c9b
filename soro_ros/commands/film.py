"""`soro film RUN`: a film of a recorded run."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from soro_core.errors import ConfigError
from soro_lab.run_folder import bag_and_scene
from soro_lab.scene import load_scene


def film(
    run: Annotated[
        Path,
        typer.Argument(help="Folder of a run, or one of bags/.", exists=True, file_okay=False),
    ],
    out: Annotated[
        Path | None, typer.Option(help="File to write: .gif, or .png for one picture. Default: RUN/film.gif.")
    ] = None,
    start: Annotated[float, typer.Option(min=0.0, metavar="SECONDS", help="First time that is shown.")] = 0.0,
    end: Annotated[
        float | None,
        typer.Option(min=0.0, metavar="SECONDS", help="Last time; default: where the arm rests."),
    ] = None,
    rate: Annotated[float, typer.Option(min=1.0, max=50.0, metavar="HZ", help="Pictures a second.")] = 10.0,
    width: Annotated[int, typer.Option(min=200, max=4000, metavar="PIXELS", help="Width of the film.")] = 800,
) -> None:
    """Draw the arm of a recorded run as it moves: reference, path of the tip, pressures, tip error.

    A simulated arm is drawn as it was, a real one as the estimator found it. A .png holds the last picture.
    """
    from soro_ros.pictures import film as drawing

    file = run / "film.gif" if out is None else out
    if file.suffix not in (".gif", ".png"):
        raise ConfigError("soro film", "--out", str(file), "a name that ends with .gif or .png")
    bag, scene_file = bag_and_scene(run)
    scene = load_scene(str(scene_file))
    shown = drawing.take(bag, scene, start, math.inf if end is None else end, rate)
    write = drawing.still if file.suffix == ".png" else drawing.write
    write(shown, file, width)
    typer.echo(f"{file}: {file.stat().st_size / 1e6:.2f} MB")
