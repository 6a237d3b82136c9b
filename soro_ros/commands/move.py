"""`soro move line|arc|spline|to`: motions of the tip of a running arm."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, TypeAlias

import numpy as np
import typer

from soro_core.control.tip_path import arc as arc_of
from soro_core.control.tip_path import corners
from soro_core.errors import ConfigError
from soro_ros.commands.services import COMMANDS, one_node, service_caller

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Make: TypeAlias = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]

app = typer.Typer(no_args_is_help=True)
# Numbers below zero are no options.
_NUMBERS = {"ignore_unknown_options": True}

Points = Annotated[
    list[float],
    typer.Argument(metavar="X Y Z...", help="Points in mm, in the world frame.", show_default=False),
]
Relative = Annotated[bool, typer.Option("--relative", help="Points count from where the tip is wanted now.")]
Speed = Annotated[
    float | None,
    typer.Option(
        min=1e-3, help="Fastest speed of the tip; stays for later motions. Default: as the controller has it."
    ),
]
Acceleration = Annotated[
    float | None,
    typer.Option(min=1e-3, help="Largest acceleration of the tip; stays for later motions, as the speed."),
]
NodeName = Annotated[
    str, typer.Option("--node", help="Controller, by its full name or its end; default: the only one.")
]
Timeout = Annotated[
    float,
    typer.Option("--timeout-s", min=0.1, max=600.0, help="Longest wait for a node, an answer or progress."),
]


@app.callback()
def _group() -> None:
    """Move the tip of a running arm and wait until it is there.

    Exit status 0: the tip has reached the end. 1: the motion was lost, replaced or vented. 2: it was refused
    before anything moved.
    """


@app.command(context_settings=_NUMBERS)
def line(
    points: Points,
    relative: Relative = False,
    speed_mm_s: Speed = None,
    acceleration_mm_s2: Acceleration = None,
    node: NodeName = "",
    timeout_s: Timeout = 10.0,
) -> None:
    """Move the tip on a straight line to each point in turn; it rests at each."""
    _move(_points(points, 1), relative, lambda at, to: corners([at, *to]), locals())


@app.command(context_settings=_NUMBERS)
def arc(
    points: Points,
    relative: Relative = False,
    speed_mm_s: Speed = None,
    acceleration_mm_s2: Acceleration = None,
    node: NodeName = "",
    timeout_s: Timeout = 10.0,
) -> None:
    """Move the tip on a circular arc through the first of two points to the second."""
    _move(_points(points, 2, 2), relative, lambda at, to: arc_of(at, *to), locals())


@app.command(context_settings=_NUMBERS)
def spline(
    points: Points,
    relative: Relative = False,
    speed_mm_s: Speed = None,
    acceleration_mm_s2: Acceleration = None,
    node: NodeName = "",
    timeout_s: Timeout = 10.0,
) -> None:
    """Move the tip on a smooth curve through all points, to rest at the last."""
    _move(_points(points, 2), relative, lambda at, to: np.array([at, *to]), locals())


@app.command(context_settings=_NUMBERS)
def to(
    points: Points,
    relative: Relative = False,
    speed_mm_s: Speed = None,
    acceleration_mm_s2: Acceleration = None,
    node: NodeName = "",
    timeout_s: Timeout = 10.0,
) -> None:
    """Move the tip to one point on the shortest way in the arm's coordinates, which is no line."""
    _move(_points(points, 1, 1), relative, lambda at, to: to, locals())


def _points(numbers: list[float], least: int, most: int = 10_000) -> NDArray[np.float64]:
    """Points (n, 3) [m] of numbers in mm."""
    n, rest = divmod(len(numbers), 3)
    if rest or not least <= n <= most:
        count = f"{least}" if most == least else f"{least} or more"
        allowed = f"{count} points of three numbers [mm]"
        raise ConfigError("soro move", "X Y Z", f"{len(numbers)} numbers", allowed)
    return 1e-3 * np.array(numbers, dtype=np.float64).reshape(-1, 3)


def _move(points: NDArray[np.float64], relative: bool, make: Make, options: dict[str, object]) -> None:
    """Send the path of a command, with its options by name, and wait for its end."""
    limit_s = float(str(options["timeout_s"]))
    given = {
        f"control.motion.{key}_m_{unit}": 1e-3 * float(str(value))
        for key, unit in (("speed", "s"), ("acceleration", "s2"))
        if (value := options[f"{key}_mm_{unit}"]) is not None
    }
    with service_caller() as caller:
        from soro_ros.moving import Mover

        name = one_node(caller, "enable", str(options["node"]), limit_s, COMMANDS)
        mover = Mover(caller, name, limit_s, typer.echo)
        mover.configure(given)
        start = mover.start()
        status = mover.move(make(start, points + start if relative else points))
    raise typer.Exit(status)
