"""The numbers of an arm that recordings can determine, as one flat list: from a robot, and back to one.

A robot file states its laws by the coefficients of their equations, (17), (18) and (21) to (25) of
docs/model.md. Some of those have no meaning alone: the stiffness at rest is a1 - a2. Each number here has
one: the stiffness at rest, how much it rises, the factor of all chambers of a link, that of one chamber
against the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from soro_core.errors import ModelError
from soro_core.robot import Chamber, Link, Robot, link_stiffness
from soro_core.robot.parts import fields, scaled_chamber

# A law that a robot does not use yet starts with these: tanh saturates within usual strains.
_RATES = {"e": 45.0, "b": 3.0}
_DAHL_RANGE = 1.0
# A few kilopascals unfold a wall.
_BAND_PA = 2000.0
# A single branch of creep with a longer relaxation time [s] is the slow one.
_SLOW_S = 0.5
# Branches of creep by name, with the relaxation time [s] of one that a robot does not have yet.
_BRANCHES = {"creep": 0.05, "slow": 5.0}


@dataclass(frozen=True)
class ArmParameter:
    """One number of an arm.

    Attributes
    ----------
    name : str
        ``link0/k_b``, ``link1/chamber2/gain``, ...
    value : float
        Present value, neutral where the robot does not use the law.
    unit : str
    kind : {"factor", "shift"}
        Searched by its logarithm (a positive quantity), or by itself.
    doubt : float
        Deviation before any data: of the natural logarithm for a factor, else in `unit`.
    lower, upper : float
        Bounds.
    """

    name: str
    value: float
    unit: str
    kind: Literal["factor", "shift"]
    doubt: float
    lower: float
    upper: float


def is_of_robot(name: str) -> bool:
    """Whether a number belongs to the robot: not to a frame of the measurement, nor to one run."""
    return name.startswith("link")


def numbers_of(robot: Robot) -> dict[str, ArmParameter]:
    """Return the numbers of a robot by name, those of laws that it does not use included.

    Raises
    ------
    ModelError
        If a link carries other strains than constant elongation and bending.
    """
    found = (n for index, link in enumerate(robot.links) for n in _of_link(robot, link, f"link{index}"))
    return {number.name: number for number in found}


def with_numbers(robot: Robot, values: Mapping[str, float]) -> Robot:
    """Return the robot with these numbers; what is not named keeps its value.

    Parameters
    ----------
    robot : Robot
    values : mapping of str to float
        By the names of `numbers_of`; gains are factors on the robot's own.

    Raises
    ------
    ModelError
        If a name is unknown.
    ConfigError
        If a value is outside what a robot allows.
    """
    numbers = numbers_of(robot)
    odd = sorted(set(values) - set(numbers))
    if odd:
        raise ModelError(f"{odd[0]}: allowed are {', '.join(numbers)}", odd[0])
    links = []
    for index, link in enumerate(robot.links):
        prefix = f"link{index}/"
        given = {k.removeprefix(prefix): float(v) for k, v in values.items() if k.startswith(prefix)}
        present = {k.removeprefix(prefix): n.value for k, n in numbers.items() if k.startswith(prefix)}
        links.append(_changed(link, {**present, **given}) if given else fields(link))
    return robot.replace(links=links)


def _of_link(robot: Robot, link: Link, name: str) -> Iterator[ArmParameter]:
    def factor(key: str, value: float, unit: str, doubt: float, span: float = 1e3) -> ArmParameter:
        return ArmParameter(f"{name}/{key}", value, unit, "factor", doubt, value / span, value * span)

    _refuse(robot, link, name)
    for key, strain in _axes(link):
        rest, rise, rate = _law(link, "eb".index(key))
        yield factor(f"k_{key}", rest, {"e": "N/m", "b": "N m/rad"}[key], 1.5)
        yield ArmParameter(f"{name}/rise_{key}", rise, "of rest", "shift", 1.0, -0.9, 20.0)
        yield factor(f"rate_{key}", rate or _RATES[key], {"e": "1/m", "b": "1/rad"}[key], 0.7, 30.0)
        damping = max(_damping(link, strain), 1e-12)
        yield factor(f"damping_{key}", damping, "of the coordinate", 2.0, 1e6)
        for branch, (share, tau) in _creep(link, strain).items():
            yield ArmParameter(f"{name}/{branch}_{key}", share, "of rest", "shift", 0.3, 0.0, 3.0)
            yield factor(f"{branch}_{key}_tau", tau, "s", 1.0, 1e3)
        share, span = _dahl(link, strain)
        yield ArmParameter(f"{name}/dahl_{key}", share, "of rest", "shift", 0.3, 0.0, 3.0)
        yield factor(f"dahl_{key}_range", span, "of the coordinate", 1.0, 1e3)
    if link.chambers:
        slope = next((c.area_slope for c in link.chambers if c.area_slope), 0.0)
        yield factor("gain", 1.0, "of the file", 1.0)
        yield factor("arm", 1.0, "of the file", 0.3)
        if any(map(_has_slope, link.chambers)):
            yield ArmParameter(f"{name}/area_slope", slope, "1", "shift", 5.0, -50.0, 50.0)
            saturation = max(c.area_saturation for c in link.chambers)
            yield ArmParameter(f"{name}/area_saturation", saturation, "1", "shift", 0.3, 0.0, 0.95)
        band, most = max(c.dead_band_pa for c in link.chambers), max(map(abs, robot.pressure_range_pa))
        yield ArmParameter(f"{name}/dead_band", band, "Pa", "shift", _BAND_PA, 0.0, max(0.5 * most, _BAND_PA))
        swell = max(c.swell_per_pa for c in link.chambers)
        yield ArmParameter(f"{name}/swell", swell, "1/Pa", "shift", 0.3 / most, 0.0, min(0.9 / most, 1e-4))
        for j in range(1, len(link.chambers)):
            yield factor(f"chamber{j}/gain", 1.0, "of the file", 0.15)
            yield factor(f"chamber{j}/arm", 1.0, "of the file", 0.15)


def _changed(link: Link, n: Mapping[str, float]) -> dict[str, Any]:
    """Return the keys of a link with the numbers `n`."""
    part = fields(link)
    part.pop("material", None)
    rests = {}
    for which, key in enumerate("eb"):
        rest, rise, rate = _law(link, which)
        if f"k_{key}" in n:
            rest, rise, rate = n[f"k_{key}"], n[f"rise_{key}"], n[f"rate_{key}"]
        part[f"k_{key}"] = (rest * (1.0 + rise), rest * rise, rate if rise else 0.0)
        rests[key] = rest * link.length**2
    axes = {strain: key for key, strains in _strains(link).items() for strain in strains}
    of = [(axes[strain], rests[axes[strain]]) for strain in link.strains]
    part["damping"] = tuple(n[f"damping_{key}"] for key, _ in of)
    part["hysteresis"] = []
    part["creep"] = [
        {
            "tau": tuple(n[f"{branch}_{key}_tau"] for key, _ in of),
            "stiffness": tuple(n[f"{branch}_{key}"] * rest for key, rest in of),
        }
        for branch in _BRANCHES
        if any(n[f"{branch}_{key}"] for key, _ in of)
    ]
    if any(n[f"dahl_{key}"] for key, _ in of):
        part["hysteresis"] = [
            {
                "range": tuple(n[f"dahl_{key}_range"] for key, _ in of),
                "stiffness": tuple(n[f"dahl_{key}"] * rest for key, rest in of),
            }
        ]
    part["chambers"] = [_chamber(c, n, j) for j, c in enumerate(link.chambers)]
    return part


def _chamber(chamber: Chamber, n: Mapping[str, float], j: int) -> dict[str, Any]:
    gain, arm = (n[key] * (n[f"chamber{j}/{key}"] if j else 1.0) for key in ("gain", "arm"))
    changed = scaled_chamber(chamber, gain, arm)
    if _has_slope(chamber):
        changed["area_slope"] = n["area_slope"]
        changed["area_saturation"] = n["area_saturation"] if changed["area_slope"] else 0.0
    changed["dead_band_pa"], changed["swell_per_pa"] = n["dead_band"], n["swell"]
    return changed


def _has_slope(chamber: Chamber) -> bool:
    """Whether its area may grow with the strain of its fibre: that is known, and no braid says how."""
    return chamber.alpha_eps != 0.0 and chamber.muscle is None


def _strains(link: Link) -> dict[str, tuple[str, ...]]:
    bending = tuple(s for s in link.strains if s.startswith("bending"))
    return {"e": tuple(s for s in link.strains if s == "elongation"), "b": bending}


def _axes(link: Link) -> Iterator[tuple[str, str]]:
    """Letter and first strain of the kinds that the link carries."""
    return ((key, strains[0]) for key, strains in _strains(link).items() if strains)


def _law(link: Link, which: int) -> tuple[float, float, float]:
    """Stiffness at rest, rise over rest and rate of k_e (0) or k_b (1); of a material, of the section."""
    law = (link.k_e, link.k_b)[which]
    if law is not None:
        rest = law[0] - law[1]
        return rest, law[1] / rest, abs(law[2])
    diagonal = dict(zip(link.strains, link_stiffness(link).diagonal(), strict=True))
    strain = next((s for key, s in _axes(link) if key == "eb"[which]), "")
    return float(diagonal.get(strain, link.length**2)) / link.length**2, 0.0, 0.0


def _damping(link: Link, strain: str) -> float:
    from soro_core.robot import link_damping

    return float(link_damping(link)[list(link.strains).index(strain), list(link.strains).index(strain)])


def _rest(link: Link, strain: str) -> float:
    return _law(link, 0 if strain == "elongation" else 1)[0] * link.length**2


def _creep(link: Link, strain: str) -> dict[str, tuple[float, float]]:
    """Stiffness over that at rest, and relaxation time, of each branch by name."""
    at, found = list(link.strains).index(strain), {name: (0.0, tau) for name, tau in _BRANCHES.items()}
    branches = sorted(link.creep, key=lambda c: c.tau)
    names = list(_BRANCHES)
    if len(branches) == 1 and min(branches[0].tau) > _SLOW_S:
        names = names[1:]
    for name, branch in zip(names, branches, strict=False):
        tau = branch.tau[at if len(branch.tau) > 1 else 0]
        found[name] = branch.stiffness[at] / _rest(link, strain), tau
    return found


def _dahl(link: Link, strain: str) -> tuple[float, float]:
    at = list(link.strains).index(strain)
    if not link.hysteresis:
        return 0.0, _DAHL_RANGE * (0.1 if strain == "elongation" else 1.0)
    element = link.hysteresis[0]
    return element.stiffness[at] / _rest(link, strain), element.range[at]


def _refuse(robot: Robot, link: Link, name: str) -> None:
    odd = [
        s
        for s, field in link.strains.items()
        if field.varies or s not in ("elongation", "bending_x", "bending_y")
    ]
    if odd:
        raise ModelError(
            f"{robot.name}, {name}/{odd[0]}: identification takes constant elongation and bending",
            f"{name}/{odd[0]}",
        )
    if len(link.creep) > len(_BRANCHES) or len(link.hysteresis) > 1:
        raise ModelError(
            f"{robot.name}, {name}: identification takes two creep branches and one Dahl element", name
        )
