"""`soro move line|arc|spline|to` and `soro press`: the tip of a running arm moves, and presses."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Annotated

import numpy as np
import typer

from soro_core.arrays import Array
from soro_core.control.motions.tip_path import arc, corners
from soro_core.errors import ConfigError
from soro_core.files.units import Quantity, unit_option
from soro_ros.commands.services import COMMANDS, one_node, service_caller

# Of one press: later ones are as configured.
_TARE = "control.force.tare"
# Numbers below zero are no options.
CONTEXT = {"ignore_unknown_options": True}


class MotionType(StrEnum):
    """Kinds of motion."""

    LINE = "line"
    ARC = "arc"
    SPLINE = "spline"
    TO = "to"


# Fewest and most points of each kind.
_POINTS = {
    MotionType.LINE: (1, 10_000),
    MotionType.ARC: (2, 2),
    MotionType.SPLINE: (2, 10_000),
    MotionType.TO: (1, 1),
}


_NODE = typer.Option(help="Controller, by its full name or its end; default: the only one.")
_TIMEOUT = unit_option(
    "--timeout", "s", 0.1, 600.0, "10s", help="Longest wait for a node, an answer or progress."
)


def move(
    kind: Annotated[
        MotionType,
        typer.Argument(
            help="line: straight to each point in turn, at rest at each. arc: on a circle through the first "
            "of two points to the second. spline: on a smooth curve through all points. to: to one point on "
            "the shortest way in the arm's coordinates, which is no line.",
            show_default=False,
        ),
    ],
    points: Annotated[
        list[str],
        typer.Argument(
            metavar="X Y Z...",
            help="Points in the world frame: numbers in mm, or with a unit, 2cm.",
            show_default=False,
        ),
    ],
    relative: Annotated[
        bool, typer.Option("--relative", help="Points count from where the tip is wanted now.")
    ] = False,
    around: Annotated[
        bool | None,
        typer.Option(
            "--around/--straight",
            help="to: go around the obstacles of the robot file, or not, also later. Default: as the "
            "controller has it.",
        ),
    ] = None,
    margin_m: Annotated[
        float | None,
        unit_option("--margin", "m", 0.0, 1.0, help="Clearance of a way around obstacles, also later."),
    ] = None,
    speed: Annotated[
        float | None,
        unit_option("--speed", "m/s", 1e-6, help="Fastest, also later. Default: as the controller has it."),
    ] = None,
    acceleration: Annotated[
        float | None,
        unit_option("--acceleration", "m/s2", 1e-6, help="Largest, also of later motions."),
    ] = None,
    node: Annotated[str, _NODE] = "",
    timeout_s: Annotated[float, _TIMEOUT] = 10.0,
) -> None:
    """Move the tip of a running arm from where it is wanted now, and wait until it is there.

    Exit status 0: the tip has reached the end. 1: the motion was lost, replaced or vented. 2: it was refused
    before anything moved. Ctrl-C ends the command; the motion goes on.
    """
    goals = _goals(kind, points)
    given = {
        "control.motion.speed_m_s": speed,
        "control.motion.acceleration_m_s2": acceleration,
        "control.motion.around": around,
        "control.motion.margin_m": margin_m,
    }
    if around and kind is not MotionType.TO:
        raise ConfigError("soro move", "--around", kind.value, "to: the other kinds state their path")
    with service_caller() as caller:
        from soro_ros.run.motion_client import Mover

        name = one_node(caller, "enable", node, timeout_s, COMMANDS)
        mover = Mover(caller, name, timeout_s, typer.echo)
        start = mover.start()
        positions = path(kind, start, goals + start if relative else goals)
        with mover.configured(given):
            status = mover.move(positions)
    raise typer.Exit(status)


def press(
    force: Annotated[str, typer.Argument(help="Force on what the tip meets: 100mN; a number alone is in N.")],
    direction: Annotated[
        list[str],
        typer.Argument(
            metavar="X Y Z",
            help="Where the tip goes and presses, in the world frame: three numbers of any length, 0 -1 0.",
            show_default=False,
        ),
    ],
    duration_s: Annotated[
        float,
        unit_option("--duration", "s", 0.0, 3600.0, "5s", help="How long the force is held before it ends."),
    ] = 5.0,
    tare: Annotated[
        bool | None,
        typer.Option(
            "--tare/--no-tare",
            help="Whether the force that is estimated at the begin counts as none. Default: as configured.",
            show_default=False,
        ),
    ] = None,
    cap: Annotated[
        float | None,
        unit_option(
            "--cap", "N", 0.0, 1e3, help="Largest force, also later, whatever the reference asks; 0: none."
        ),
    ] = None,
    approach_speed: Annotated[
        float | None,
        unit_option(
            "--approach-speed", "m/s", 1e-6, 1.0, help="Until the tip touches something, also later."
        ),
    ] = None,
    approach_s: Annotated[
        float | None,
        unit_option("--approach", "s", 1e-3, 600.0, help="Longest time until it does, also later."),
    ] = None,
    node: Annotated[str, _NODE] = "",
    timeout_s: Annotated[float, _TIMEOUT] = 10.0,
) -> None:
    """Press on what is in the way of the tip, hold the force, release and return to the begin.

    The tip goes along the direction from where it is wanted now, slowly, until it touches something, and then
    keeps the force along the direction; across it, it stays. The controller must estimate forces
    (docs/force.md): the tip is measured. `--tare`: only while nothing touches the arm.

    Exit status 0: the force was held for the duration, and the tip is back. 1: the tip met nothing, the force
    was not reached or lost, or the press was replaced or vented. 2: it was refused before anything moved.
    Ctrl-C releases and ends the command.
    """
    size = Quantity("N", 0.0, 1e3, "100mN").number(force, "soro press", "FORCE")
    along = _direction(direction)
    given = {
        "control.force.cap_n": cap,
        "control.force.approach_speed_m_s": approach_speed,
        "control.force.approach_s": approach_s,
        _TARE: tare,
    }
    with service_caller() as caller:
        from soro_ros.run.motion_client import Presser

        name = one_node(caller, "enable", node, timeout_s, COMMANDS)
        presser = Presser(caller, name, timeout_s, typer.echo)
        presser.start()
        with presser.configured(given, once=[_TARE]):
            status = presser.press(size * along, duration_s)
    raise typer.Exit(status)


def _direction(words: list[str]) -> Array:
    """Unit vector (3,) of a direction in words."""
    number = Quantity("", -math.inf, math.inf, "0 -1 0")
    found = np.array([number.number(word, "soro press", "X Y Z") for word in words])
    length = float(np.linalg.norm(found))
    if found.shape != (3,) or not 0.0 < length < math.inf:
        raise ConfigError("soro press", "X Y Z", " ".join(words), "three numbers that are not all 0")
    return np.asarray(found / length)


def path(kind: MotionType, start: Array, goals: Array) -> Array:
    """Return the positions (n, 3) [m] that a motion passes.

    Parameters
    ----------
    kind : MotionType
    start : ndarray (3,)
        Where the tip is wanted now [m].
    goals : ndarray (n, 3)
        The points of the command [m].

    Raises
    ------
    ConfigError
        If three points have no arc.
    """
    if kind is MotionType.TO:
        return goals
    if kind is MotionType.ARC:
        return arc(start, goals[0], goals[1])
    return corners([start, *goals]) if kind is MotionType.LINE else np.array([start, *goals])


def _goals(kind: MotionType, numbers: list[str]) -> Array:
    """Points (n, 3) [m] of numbers, those without a unit in mm."""
    n, rest = divmod(len(numbers), 3)
    least, most = _POINTS[kind]
    if rest or not least <= n <= most:
        count = f"{('one', 'two')[least - 1]}{' or more' if most > least else ''}"
        allowed = f"three numbers a point, {count} {'point' if most == 1 else 'points'} for {kind}"
        raise ConfigError("soro move", "X Y Z", f"{len(numbers)} numbers", allowed)
    coordinate = Quantity("m", -math.inf, math.inf, "2cm", alone="mm")
    metres = [coordinate.number(text, "soro move", "X Y Z") for text in numbers]
    return np.array(metres, dtype=np.float64).reshape(-1, 3)
