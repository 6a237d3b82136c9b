"""Resting places on ways through the range of the pressures, with stiffness and modes at each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import stable_equilibrium
from soro_lab.analysis.modes import LinearisedModes, modes
from soro_lab.analysis.stiffness import TipStiffness, tangent_stiffness, tip_stiffness

# Resting places on a way, both ends included.
POINTS = 9
# Name of a way on which all chambers have the same pressure.
EQUAL = "all chambers"


@dataclass(frozen=True)
class RestingPlace:
    """A resting place.

    Attributes
    ----------
    pressure_pa : ndarray (n_u,)
        [Pa gauge].
    q : ndarray (n_q,)
    tip_m : ndarray (3,)
        Position of the tip in the world [m].
    tip : TipStiffness
    modes : LinearisedModes
    """

    pressure_pa: Array
    q: Array
    tip_m: Array
    tip: TipStiffness
    modes: LinearisedModes


@dataclass(frozen=True)
class EquilibriumPath:
    """Resting places from rest to one end of the range of the pressures.

    Attributes
    ----------
    name : str
        The chambers whose pressures change.
    pressure_pa : ndarray (n,)
        Their pressure at each place [Pa gauge].
    places : tuple of RestingPlace
        It ends early where there is no stable rest any more.
    reached : bool
        Whether it goes to the end of the range.
    """

    name: str
    pressure_pa: Array
    places: tuple[RestingPlace, ...]
    reached: bool


def targets(names: tuple[str, ...], low_pa: float, high_pa: float) -> list[tuple[str, Array]]:
    """Return names and pressures of the ends: each chamber alone at both ends of the range, and all together.

    Parameters
    ----------
    names : tuple of str
    low_pa, high_pa : float
        Range of the pressures [Pa gauge].
    """
    n, rest = len(names), rest_pressure(low_pa, high_pa)
    found: list[tuple[str, Array]] = []
    for end in (high_pa, low_pa):
        if end == rest:
            continue
        for i, name in enumerate(names):
            pressure = np.full(n, rest)
            pressure[i] = end
            found.append((name, pressure))
        if n > 1:
            found.append((EQUAL, np.full(n, end)))
    return found


def rest_pressure(low_pa: float, high_pa: float) -> float:
    """Return the pressure of the range nearest to none [Pa gauge]."""
    return min(max(0.0, low_pa), high_pa)


def ways(
    arm: SoftArm, low_pa: float, high_pa: float, show: Callable[[int, int], None] = lambda done, of: None
) -> list[EquilibriumPath]:
    """Return the ways from rest to the ends of the range.

    Parameters
    ----------
    arm : SoftArm
    low_pa, high_pa : float
        Range of the pressures [Pa gauge].
    show : callable
        Takes the number of ways that are done, and that of all.

    Raises
    ------
    ModelError
        If the arm has no stable rest at the start.
    """
    rest = np.full(arm.n_u, rest_pressure(low_pa, high_pa))
    first = place_at(arm, rest)
    ends, found = targets(arm.robot.chamber_names, low_pa, high_pa), []
    for k, (name, end) in enumerate(ends):
        show(k, len(ends))
        found.append(_way(arm, name, first, end))
    return found


def place_at(arm: SoftArm, pressure_pa: Array, near: Array | None = None) -> RestingPlace:
    """Return the resting place under these pressures.

    Parameters
    ----------
    arm : SoftArm
    pressure_pa : ndarray (n_u,)
        [Pa gauge].
    near : ndarray (n_q,), optional
        Rest under pressures nearby.

    Raises
    ------
    ModelError
        If there is no stable one.
    """
    q = stable_equilibrium(arm, pressure_pa, near)
    stiffness = tangent_stiffness(arm, pressure_pa, q)
    tip_m = arm.pose(q, arm.length)[:3, 3]
    return RestingPlace(pressure_pa, q, tip_m, tip_stiffness(arm, q, stiffness), modes(arm, q, stiffness))


def _way(arm: SoftArm, name: str, first: RestingPlace, end: Array) -> EquilibriumPath:
    changing = int(np.argmax(np.abs(end - first.pressure_pa)))
    places = [first]
    for share in np.linspace(0.0, 1.0, POINTS)[1:]:
        pressure = first.pressure_pa + share * (end - first.pressure_pa)
        try:
            places.append(place_at(arm, pressure, places[-1].q))
        except ModelError:
            break
    pressures = np.array([place.pressure_pa[changing] for place in places])
    return EquilibriumPath(name, pressures, tuple(places), len(places) == POINTS)
