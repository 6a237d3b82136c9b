"""What a user gives about a new arm, read into numbers by link."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from soro_core.errors import ConfigError
from soro_lab.scaffold import quantity
from soro_lab.scaffold.quantity import Quantity

Value = TypeVar("Value")

WHERE = "soro new"
MOUNTINGS = {
    "standing": ((0.0, 0.0, 0.0, 1.0), "the tangent of the base points up"),
    "hanging": ((1.0, 0.0, 0.0, 0.0), "half a turn about x: the tangent of the base points down"),
    "lying": (
        (0.0, 0.7071067811865476, 0.0, 0.7071067811865476),
        "a quarter turn about y: the tangent of the base points along the world's x",
    ),
}
SENSORS = ("pose", "poses", "imu")
MOST_LINKS = 12
_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True)
class Options:
    """Options as they are written; empty where they are not given."""

    name: str
    links: int | None = None
    length: str = ""
    radius: str = ""
    mass: str = ""
    chambers: str = ""
    angles: str = ""
    area: str = ""
    offset: str = ""
    pressure_range: str = ""
    material: str = ""
    youngs_modulus: str = ""
    density: str = ""
    axial_stiffness: str = ""
    bending_stiffness: str = ""
    mounting: str = "standing"
    planar: bool = False
    platform: str = "emulated"
    sensors: str = "pose"
    sensor_places: str = ""
    payload: str = ""


@dataclass(frozen=True)
class GivenLink:
    """What is given about one link, in SI units; None where it is not."""

    length: float | None
    radius: float | None
    mass: float | None
    angles: tuple[float, ...] | None
    count: int
    area: float | None
    offset: float | None
    axial: float | None
    bending: float | None


def read_links(options: Options) -> tuple[GivenLink, ...]:
    """Return what is given about each link.

    Raises
    ------
    ConfigError
        With the option, what was found and what is allowed.
    """
    numbers = {
        option: _numbers(kind, text, option)
        for option, kind, text in (
            ("--length", quantity.LENGTH, options.length),
            ("--radius", quantity.LENGTH, options.radius),
            ("--mass", quantity.MASS, options.mass),
            ("--area", quantity.AREA, options.area),
            ("--offset", quantity.DISTANCE, options.offset),
            ("--axial-stiffness", quantity.AXIAL, options.axial_stiffness),
            ("--bending-stiffness", quantity.BENDING, options.bending_stiffness),
        )
    }
    chambers, directions = _counts(options.chambers), _angles(options.angles)
    longest = max(len(values) for values in (*numbers.values(), chambers, directions))
    n = (longest or 1) if options.links is None else options.links
    if not 1 <= n <= MOST_LINKS:
        raise ConfigError(WHERE, "--links", n, f"1 to {MOST_LINKS}")
    spread = {option: _spread(option, values, n) for option, values in numbers.items()}
    angles = _spread("--angles", directions, n)
    counts = [
        count if count is not None else len(own) if own else (2 if options.planar else 3)
        for count, own in zip(_spread("--chambers", chambers, n), angles, strict=True)
    ]
    for count, own in zip(counts, angles, strict=True):
        if own and len(own) != count:
            raise ConfigError(WHERE, "--angles", options.angles, f"{count} angles, one a chamber of a link")
    if not any(counts):
        raise ConfigError(WHERE, "--chambers", options.chambers, "at least one chamber")
    return tuple(
        GivenLink(
            length=spread["--length"][k],
            radius=spread["--radius"][k],
            mass=spread["--mass"][k],
            angles=angles[k],
            count=counts[k],
            area=spread["--area"][k],
            offset=spread["--offset"][k],
            axial=spread["--axial-stiffness"][k],
            bending=spread["--bending-stiffness"][k],
        )
        for k in range(n)
    )


def read_name(name: str) -> str:
    """Return the name of an arm, which files, topics and folders can have."""
    if not _NAME.fullmatch(name):
        raise ConfigError(
            WHERE, "ARM", name, "a name of small letters, digits and _, like my_arm; --out FOLDER"
        )
    return name


def read_range(text: str) -> tuple[float, float] | None:
    """Return lowest and highest pressure [Pa gauge], or None where they are not given."""
    values = quantity.PRESSURE.read(text, "--pressure-range") if text else ()
    if not values:
        return None
    low, high = (0.0, *values) if len(values) == 1 else values[:2]
    if len(values) > 2 or not (low < high and high >= 1e3):
        allowed = "lowest and highest gauge pressure, the highest from 1 kPa on, like 0,90kPa"
        raise ConfigError(WHERE, "--pressure-range", text, allowed)
    return low, high


def read_one(kind: Quantity, text: str, option: str) -> float | None:
    """Return the number of an option of the whole arm, or None where it is not given.

    Parameters
    ----------
    kind : Quantity
        What it is.
    text : str
        As it is written.
    option : str
        For errors.
    """
    values = _numbers(kind, text, option)
    if len(values) > 1:
        raise ConfigError(WHERE, option, text, f"one value for the whole arm, like {kind.example}")
    return values[0] if values else None


def read_sensors(text: str, places: str, n_links: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the places of pose sensors and of IMUs, parts of the length of the arm.

    Parameters
    ----------
    text : str
        Names of sensors, separated by commas.
    places : str
        Places of the sensors, or empty.
    n_links : int
        Number of links, at whose ends `poses` stand.
    """
    names = [name.strip() for name in text.split(",")]
    if not set(names) <= set(SENSORS) or len(set(names)) != len(names) or {"pose", "poses"} <= set(names):
        allowed = "pose (at the tip), poses (at several places), imu, or one of the first two with imu"
        raise ConfigError(WHERE, "--sensors", text, allowed)
    stated = tuple(sorted(set(_numbers(quantity.PLACE, places, "--sensor-places"))))
    if 0.0 in stated:
        raise ConfigError(WHERE, "--sensor-places", places, "places above 0, the base, to 1, the tip")
    ends = tuple(round((k + 1) / max(n_links, 2), 4) for k in range(max(n_links, 2)))
    chosen = stated or (ends if "poses" in names else (1.0,))
    poses = chosen if {"pose", "poses"} & set(names) else ()
    return poses, (stated or (1.0,)) if "imu" in names else ()


def _numbers(kind: Quantity, text: str, option: str) -> tuple[float, ...]:
    return kind.read(text, option) if text else ()


def _counts(text: str) -> tuple[int, ...]:
    values = _numbers(quantity.COUNT, text, "--chambers")
    if any(value != int(value) for value in values):
        raise ConfigError(WHERE, "--chambers", text, "whole numbers")
    return tuple(map(int, values))


def _angles(text: str) -> tuple[tuple[float, ...], ...]:
    """Return the angles of the chambers of each link [rad]; links are separated by a slash."""
    if not text:
        return ()
    found = tuple(quantity.ANGLE.read(part, "--angles") for part in text.split("/"))
    if "deg" not in text and "rad" not in text:
        numbers = [float(part) for part in re.split("[/,]", text)]
        if any(0.0 < abs(x) <= 6.3 for x in numbers):
            allowed = (
                "a unit where angles are this small: 0,2.094,4.189rad, or 0,5deg; alone they are degrees"
            )
            raise ConfigError(WHERE, "--angles", text, allowed)
    return found


def _spread(option: str, values: Sequence[Value], n: int) -> tuple[Value | None, ...]:
    """Return a value for each link: one for all, or one each."""
    if len(values) not in (0, 1, n):
        raise ConfigError(WHERE, option, f"{len(values)} values", f"one for all links, or {n}, one a link")
    if not values:
        return (None,) * n
    return tuple(values) * n if len(values) == 1 else tuple(values)
