"""Laws that an arm may need beyond linear stiffness and damping, each a set of numbers that a fit frees."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from soro_core.errors import ConfigError
from soro_core.robot import Robot
from soro_lab.identification.arm.cases.parameters import ArmParameter, numbers_of, with_numbers

# Found for every arm: stiffness at rest, damping, gains.
_ALWAYS = ("k_{}", "damping_{}", "gain", "arm", "chamber*/gain")


@dataclass(frozen=True)
class LawTerm:
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
    LawTerm("hyper-elastic", ("rise_{}", "rate_{}"), {"rise_{}": 0.02}),
    LawTerm("area slope", ("area_slope",), {}),
    LawTerm("saturating area", ("area_slope", "area_saturation"), {"area_saturation": 0.2}),
    LawTerm("dead band", ("dead_band",), {"dead_band": 500.0}),
    LawTerm("creep", ("creep_{}", "creep_{}_tau"), {"creep_{}": 0.1}),
    LawTerm("slow creep", ("slow_{}", "slow_{}_tau"), {"slow_{}": 0.02}),
    LawTerm("Dahl hysteresis", ("dahl_{}", "dahl_{}_range"), {"dahl_{}": 0.02}),
)
# Added only where they are named: without a position sensor moment arms take up what other laws leave out;
# an area that swells counts near the pressure alone beyond which its chamber has no balance.
NAMED = (LawTerm("moment arms", ("chamber*/arm",), {}), LawTerm("swelling area", ("swell",), {"swell": 1e-6}))
_NEUTRAL = (
    *("rise_e", "rise_b", "area_slope", "area_saturation", "dead_band", "swell"),
    *("creep_e", "creep_b", "slow_e", "slow_b", "dahl_e", "dahl_b"),
)


def plain(robot: Robot, keep: Collection[str] = ()) -> Robot:
    """Return the robot with linear laws alone, but for numbers that are kept."""
    own = (name for name in numbers_of(robot) if name not in keep)
    return with_numbers(robot, {name: 0.0 for name in own if name.split("/", 1)[1] in _NEUTRAL})


def free_parameters(
    robot: Robot, laws: Iterable[LawTerm], kinds: str, keep: Collection[str] = ()
) -> tuple[tuple[ArmParameter, ...], dict[str, float]]:
    """Return the numbers that a fit with these laws searches, and where it starts.

    Parameters
    ----------
    robot : Robot
    laws : iterable of LawTerm
    kinds : str
        Kinds of strain that the recordings show: "eb", or "b" of curvatures alone.
    keep : collection of str
        Names of numbers that are not searched.

    Raises
    ------
    ConfigError
        If a name is unknown.
    """
    found = numbers_of(robot)
    odd = [name for name in keep if name not in found]
    if odd:
        raise ConfigError("soro identify", "--keep", odd[0], ", ".join(found))
    laws = tuple(laws)
    keys = [*_ALWAYS, *(key for law in laws for key in law.keys)]
    wanted = {key.format(kind) for key in keys for kind in kinds}
    starts = {key.format(kind): value for law in laws for key, value in law.starts.items() for kind in kinds}
    numbers, begin = [], {}
    for name, number in found.items():
        own = _general(name)
        if own in wanted and name not in keep:
            numbers.append(number)
            if own in starts:
                begin[name] = starts[own]
    return tuple(numbers), begin


def is_of_law(name: str) -> bool:
    """Whether a number belongs to a law that was added."""
    own = _general(name)
    return any(own == key.format(kind) for law in (*LAWS, *NAMED) for key in law.keys for kind in "eb")


def _general(name: str) -> str:
    """Return the key that a law gives a number: without its link, and with * for the number of a chamber."""
    own = name.split("/", 1)[1]
    return f"chamber*/{own.split('/')[1]}" if own.startswith("chamber") else own
