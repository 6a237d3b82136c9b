"""What a user gives about a new arm, read into numbers by link."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from soro_core.errors import ConfigError
from soro_core.files.units import Quantity
from soro_lab.scaffold import quantity

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
MOST_LINKS = 12
_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True)
class ScaffoldOptions:
    """Options as they are written; empty where they are not given."""

    name: str
    links: int | None = None
    length: str = ""
    radius: str = ""
    mass: str = ""
    chambers: str = ""
    pressure_range: str = ""
    axial_stiffness: str = ""
    bending_stiffness: str = ""
    mounting: str = "standing"
    planar: bool = False
    platform: str = "emulated"


@dataclass(frozen=True)
class GivenLink:
    """What is given about one link, in SI units; None where it is not."""

    length: float | None
    radius: float | None
    mass: float | None
    count: int
    axial: float | None
    bending: float | None


def read_links(options: ScaffoldOptions) -> tuple[GivenLink, ...]:
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
            ("--axial-stiffness", quantity.AXIAL, options.axial_stiffness),
            ("--bending-stiffness", quantity.BENDING, options.bending_stiffness),
        )
    }
    chambers = _counts(options.chambers)
    longest = max(len(values) for values in (*numbers.values(), chambers))
    n = (longest or 1) if options.links is None else options.links
    if not 1 <= n <= MOST_LINKS:
        raise ConfigError(WHERE, "--links", n, f"1 to {MOST_LINKS}")
    spread = {option: _spread(option, values, n) for option, values in numbers.items()}
    usual = 2 if options.planar else 3
    counts = [usual if count is None else count for count in _spread("--chambers", chambers, n)]
    if options.planar and max(counts) > 2:
        raise ConfigError(WHERE, "--chambers", options.chambers, "with --planar at most 2 a link")
    if not any(counts):
        raise ConfigError(WHERE, "--chambers", options.chambers, "at least one chamber")
    return tuple(
        GivenLink(
            length=spread["--length"][k],
            radius=spread["--radius"][k],
            mass=spread["--mass"][k],
            count=counts[k],
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
    values = quantity.PRESSURE.read(text, WHERE, "--pressure-range") if text else ()
    if not values:
        return None
    low, high = (0.0, *values) if len(values) == 1 else values[:2]
    if len(values) > 2 or not (low < high and high >= 1e3):
        allowed = "lowest and highest gauge pressure, the highest from 1 kPa on, like 0,90kPa"
        raise ConfigError(WHERE, "--pressure-range", text, allowed)
    return low, high


def _numbers(kind: Quantity, text: str, option: str) -> tuple[float, ...]:
    return kind.read(text, WHERE, option) if text else ()


def _counts(text: str) -> tuple[int, ...]:
    values = _numbers(quantity.COUNT, text, "--chambers")
    if any(value != int(value) for value in values):
        raise ConfigError(WHERE, "--chambers", text, "whole numbers")
    return tuple(map(int, values))


def _spread(option: str, values: Sequence[Value], n: int) -> tuple[Value | None, ...]:
    """Return a value for each link: one for all, or one each."""
    if len(values) not in (0, 1, n):
        raise ConfigError(WHERE, option, f"{len(values)} values", f"one for all links, or {n}, one a link")
    if not values:
        return (None,) * n
    return tuple(values) * n if len(values) == 1 else tuple(values)
