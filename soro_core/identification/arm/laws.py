"""Laws that an arm may need beyond linear stiffness and damping, each a set of numbers that a fit frees."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from soro_core.identification.arm.numbers import Number, numbers_of, with_numbers
from soro_core.robot import Robot

# Found for every arm: stiffness at rest, damping, gains.
_ALWAYS = ("k_{}", "damping_{}", "gain", "arm", "chamber*/gain")


@dataclass(frozen=True)
class Law:
    """An addition to the linear law.

    Attributes
    ----------
    name : str
    keys : tuple of str
        Numbers of a link that it frees; ``{}`` stands for the kind of strain, e or b.
    starts : dict
        Where the search starts, for those that are not neutral there.
    """

    name: str
    keys: tuple[str, ...]
    starts: dict[str, float]


LAWS = (
    Law("hyper-elastic", ("rise_{}", "rate_{}"), {"rise_{}": 0.1}),
    Law("area slope", ("area_slope",), {}),
    Law("saturating area", ("area_slope", "area_saturation"), {"area_saturation": 0.2}),
    Law("dead band", ("dead_band",), {"dead_band": 500.0}),
    Law("creep", ("creep_{}", "creep_{}_tau"), {"creep_{}": 0.1}),
    Law("slow creep", ("slow_{}", "slow_{}_tau"), {"slow_{}": 0.1}),
    Law("Dahl hysteresis", ("dahl_{}", "dahl_{}_range"), {"dahl_{}": 0.1}),
)
_NEUTRAL = (
    *("rise_e", "rise_b", "area_slope", "area_saturation", "dead_band"),
    *("creep_e", "creep_b", "slow_e", "slow_b", "dahl_e", "dahl_b"),
)


def plain(robot: Robot) -> Robot:
    """Return the robot with linear laws alone."""
    known = numbers_of(robot)
    return with_numbers(robot, {name: 0.0 for name in known if name.split("/", 1)[1] in _NEUTRAL})


def freed(robot: Robot, laws: Iterable[Law], kinds: str) -> tuple[tuple[Number, ...], dict[str, float]]:
    """Return the numbers that a fit with these laws searches, and where it starts.

    Parameters
    ----------
    robot : Robot
    laws : iterable of Law
    kinds : str
        Kinds of strain that the recordings show: "eb", or "b" of curvatures alone.
    """
    found = numbers_of(robot)
    laws = tuple(laws)
    keys = [*_ALWAYS, *(key for law in laws for key in law.keys)]
    wanted = {key.format(kind) for key in keys for kind in kinds}
    starts = {key.format(kind): value for law in laws for key, value in law.starts.items() for kind in kinds}
    numbers, begin = [], {}
    for name, number in found.items():
        own = name.split("/", 1)[1]
        general = f"chamber*/{own.split('/')[1]}" if own.startswith("chamber") else own
        if general in wanted:
            numbers.append(number)
            if own in starts:
                begin[name] = starts[own]
    return tuple(numbers), begin


def is_of_law(name: str) -> bool:
    """Whether a number belongs to a law that was added."""
    own = name.split("/", 1)[1]
    return any(own == key.format(kind) for law in LAWS for key in law.keys for kind in "eb")
