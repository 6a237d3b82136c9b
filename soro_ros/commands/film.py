"""`soro plot RUN --film FILE`: a film of a recorded run."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from soro_core.errors import ConfigError
from soro_core.files.units import unit_option
from soro_lab.run_folder import bag_and_scene
from soro_lab.scene import arm_of, load_scene

Rate: TypeAlias = Annotated[
    float, unit_option("--rate", "Hz", 1.0, 50.0, "10Hz", help="Pictures a second of a film.")
]
Width: TypeAlias = Annotated[int, typer.Option(min=200, max=4000, metavar="PIXELS", help="Width of a film.")]


def write_film(
    run: Path,
    file: Path,
    span_s: tuple[float, float | None],
    rate_hz: float,
    width: int,
    arm: str | None = None,
) -> None:
    """Draw the arm of a recorded run as it moves: reference, path of the tip, pressures, tip error.

    A simulated arm is drawn as it was, a real one as the estimator found it.

    Parameters
    ----------
    run : Path
        Folder of a run or bag.
    file : Path
        To write: .gif; .png holds the last picture.
    span_s : tuple
        First and last time [s]; None: where the arm rests.
    rate_hz : float
        Pictures a second.
    width : int
        Pixels.
    arm : str, optional
        Which of several arms.

    Raises
    ------
    ConfigError
        If the file has another ending.
    """
    from soro_ros.pictures import film
    from soro_ros.recordings.bodies.tracks import tracks_of

    if file.suffix not in (".gif", ".png"):
        raise ConfigError("soro plot", "--film", str(file), "a name that ends with .gif or .png")
    bag, scene_file = bag_and_scene(run)
    whole = load_scene(str(scene_file))
    scene = arm_of(whole, arm, str(run))
    start_s, end_s = span_s
    # A carried arm is seen from the tip of its carrier, bodies from the world.
    of_world = [] if scene.mounted_on else tracks_of(bag, whole, f"/{scene.name}/arm/desired/tip").values()
    end_s = math.inf if end_s is None else end_s
    alone = film.take(bag, scene, start_s, end_s, rate_hz, list(of_world))
    shown = film.with_carried(alone, bag, whole.carried_by(scene), rate_hz)
    write = film.still if file.suffix == ".png" else film.write
    write(shown, file, width)
    typer.echo(f"{file}: {file.stat().st_size / 1e6:.2f} MB")
