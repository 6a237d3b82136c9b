"""What no arm can be: rules for the robot that is described, and for the numbers that are found.

Limits are those of matter, with room for links that are hollow, folded or carry plates. They find wrong
units and fits that went astray; they do not judge a design.

Described: the mass of a link over the volume of its round outside lies between that of air, 1.2 kg/m^3,
which even a film tube holds, and that of osmium, 22 600 kg/m^3, the densest matter. Grams for kilograms and
millimetres for metres are outside.

Found: stiffnesses, gains, moment arms, lengths and times are above 0; damping, creep and hysteresis are 0
or more; a stiffness that falls stays above 0. Over the round outside of a link the Young's modulus,
k_e L / A or k_b L / I, lies between 10 Pa (the softest gels) and 1.2 TPa (diamond). The radius of gyration
sqrt(k_b / k_e) of the section that both imply is at most three outer radii, with room for bellows whose
outside is described roughly, and at least a thousandth of one, as of a cable that does not stretch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from soro_core.errors import ConfigError
from soro_core.robot import Link, Robot, refuse_tendons
from soro_lab.identification.arm.cases.parameters import numbers_of

DENSITY = 1.2, 22_600.0  # kg/m^3
MODULUS = 10.0, 1.2e12  # Pa
GYRATION = 1e-3, 3.0  # of the outer radius

_Rule = tuple[Callable[[float], bool], str]
_ABOVE: _Rule = (lambda v: v > 0.0, "above 0")
_NOT_BELOW: _Rule = (lambda v: v >= 0.0, "0 or more")
# By how the last part of a name begins, or else ends: the first that fits counts.
_BEGINS: tuple[tuple[str, _Rule], ...] = (
    ("k_", _ABOVE),
    ("damping_", _NOT_BELOW),
    ("rise_", (lambda v: v > -1.0, "above -1")),
    ("rate_", _ABOVE),
    ("gain", _ABOVE),
    ("arm", _ABOVE),
    ("length", _ABOVE),
)
_ENDS: tuple[tuple[str, _Rule], ...] = (("_tau", _ABOVE), ("_range", _ABOVE))
_SHARES: tuple[tuple[str, _Rule], ...] = tuple((name, _NOT_BELOW) for name in ("creep_", "slow_", "dahl_"))


@dataclass(frozen=True)
class Unphysical:
    """A quantity that no arm has.

    Attributes
    ----------
    name : str
        A number, or ``link0/E_b``, ``link0/gyration``.
    value : float
    unit : str
    allowed : str
    numbers : tuple of str
        Numbers that it follows from.
    """

    name: str
    value: float
    unit: str
    allowed: str
    numbers: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.name} is {self.value:.3g} {self.unit}".rstrip() + f"; allowed: {self.allowed}"


def check_described(robot: Robot, where: str) -> None:
    """Refuse a robot that no matter can be; `where` is its file.

    Raises
    ------
    ConfigError
        That names the link.
    """
    refuse_tendons(robot, where)
    low, high = DENSITY
    for index, link in enumerate(robot.links):
        if not link.mass > 0.0:
            raise ConfigError(where, f"links[{index}].mass", f"{link.mass:g} kg", "a mass above 0")
        density = link.mass / link.volume
        if not low <= density <= high:
            got = f"{link.mass:g} kg in a link of {link.length:g} m and radius {link.radius:g} m"
            allowed = f"{low:g} to {high:g} kg/m^3 over its round outside; these are {density:.3g}"
            raise ConfigError(where, f"links[{index}].mass", got, f"{allowed}. Units are kg and m")


def unphysical(robot: Robot, values: Mapping[str, float]) -> tuple[Unphysical, ...]:
    """Return what no arm has among found numbers.

    Parameters
    ----------
    robot : Robot
        With the numbers.
    values : mapping of str to float
        Those that were found, by name; frames are not judged.
    """
    own = {name: value for name, value in values.items() if not name.startswith("frame/")}
    return (*_signs(robot, own), *_sections(robot, own))


def _signs(robot: Robot, values: Mapping[str, float]) -> Iterator[Unphysical]:
    units = {name: number.unit for name, number in numbers_of(robot).items()}
    for name, value in values.items():
        holds, allowed = _rule(name.split("/")[-1])
        if not (math.isfinite(value) and holds(value)):
            yield Unphysical(name, value, units.get(name, ""), allowed, (name,))


def _rule(key: str) -> _Rule:
    of_ends = (rule for end, rule in _ENDS if key.endswith(end))
    of_begins = (rule for start, rule in (*_BEGINS, *_SHARES) if key.startswith(start))
    return next(of_ends, None) or next(of_begins, None) or (lambda v: True, "a finite number")


def _sections(robot: Robot, values: Mapping[str, float]) -> Iterator[Unphysical]:
    numbers = numbers_of(robot)
    for index, link in enumerate(robot.links):
        at = f"link{index}"
        area, second = _outside(link)
        found = {key: numbers[f"{at}/k_{key}"].value for key in "eb" if f"{at}/k_{key}" in values}
        for key, over in (("e", area), ("b", second)):
            if key in found:
                modulus = found[key] * link.length / over
                if not MODULUS[0] <= modulus <= MODULUS[1]:
                    allowed = f"{MODULUS[0]:g} to {MODULUS[1]:g} Pa"
                    yield Unphysical(f"{at}/E_{key}", modulus, "Pa", allowed, (f"{at}/k_{key}",))
        if len(found) == 2 and min(found.values()) > 0.0:
            radius = math.sqrt(found["b"] / found["e"]) / link.radius
            if not GYRATION[0] <= radius <= GYRATION[1]:
                allowed = f"{GYRATION[0]:g} to {GYRATION[1]:g} outer radii"
                both = (f"{at}/k_e", f"{at}/k_b")
                yield Unphysical(f"{at}/gyration", radius, "outer radii", allowed, both)


def _outside(link: Link) -> tuple[float, float]:
    """Area [m^2] and second moment [m^4] of the round outside of a link."""
    return math.pi * link.radius**2, 0.25 * math.pi * link.radius**4
