"""The elongation that a circle's mean pressure chooses, with what the law has learned.

A scene that states curvature and mean pressure leaves the elongation to the model. Beside a weak chamber that
of the file chooses one for which the true arm needs more than this mean pressure, and a chamber comes to its
limit. With the learned forces and gains the same keys give the elongation that a right file would have given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from soro_core.arrays import Array
from soro_core.control.config import ReferenceConfig
from soro_core.control.motions.kinematics import mean_holding_pressure
from soro_core.control.motions.pressure_feasibility import PressureSupply
from soro_core.control.reference.trajectory import Circle
from soro_core.errors import SoroError

# Least change of the elongation for which a circle moves.
_CHANGE = 2e-3
# First step of the search, most steps, its tolerance, and the shortest elongation.
_STEP, _STEPS, _TOLERANCE, _SHORTEST = 0.01, 8, 1e-4, -0.3


@dataclass(frozen=True)
class LearnedElongation:
    """State of the choice.

    Attributes
    ----------
    since_s : float
        Time since the last choice [s].
    note : str
        What the user must know; empty where the circle is that of the file.
    """

    since_s: float = math.inf
    note: str = ""


def with_learned_elongation(
    supply: PressureSupply, settings: ReferenceConfig, of_file: Circle, now: Circle, differs: bool
) -> tuple[LearnedElongation, Circle]:
    """Return the choice and its circle: `now` itself where it stays.

    Parameters
    ----------
    supply : PressureSupply
        Holds what is learned.
    settings : ReferenceConfig
    of_file : Circle
        What the file's model has chosen.
    now : Circle
        That in force.
    differs : bool
        Whether a chamber differs from its file; without one the circle is that of the file.
    """
    stretch = supply.fields.of("elongation") * supply.fields.uniform
    longest, before = (float(one.centre @ stretch / (stretch @ stretch)) for one in (of_file, now))
    found = longest
    if differs:
        try:
            found = _elongation(supply, settings, of_file, stretch, longest)
        except (SoroError, np.linalg.LinAlgError):  # the model has no value there: the circle stays
            found = before
    if abs(found - before) <= _CHANGE and (differs or found == before):
        found = before
    note = ""
    if found < longest:
        mean = f"{1e-3 * settings.mean_pressure_pa:.0f} kPa on average"
        note = f"elongation {found:.3f} in place of {longest:.3f}: with what is learned it needs {mean}"
    return LearnedElongation(0.0, note), now if found == before else replace(now, centre=found * stretch)


def _elongation(
    supply: PressureSupply, settings: ReferenceConfig, circle: Circle, stretch: Array, longest: float
) -> float:
    """Return the elongation, at most `longest`, whose mean pressure is that of the settings by the secant."""
    low, high, zero = supply.setpoints.minimum_pa, supply.setpoints.maximum_pa, np.zeros_like(stretch)

    def excess_pa(elongation: float) -> float:
        q = circle.curvature_per_m * circle.across + elongation * stretch
        load, actuation = supply.force(q, zero, zero), supply.actuation(q)
        mean_pa = mean_holding_pressure(supply.arm, supply.fields, load, actuation, low, high)
        return mean_pa - settings.mean_pressure_pa

    one, two = longest, longest - _STEP
    of_one, of_two = excess_pa(one), excess_pa(two)
    if of_one <= 0.0:
        return longest
    for _ in range(_STEPS):
        slope = (of_one - of_two) / (one - two)
        if not slope > 0.0:  # shorter needs more: no way to go
            return longest
        one, of_one, two = two, of_two, two - of_two / slope
        if not _SHORTEST <= two <= longest:
            return longest
        if abs(two - one) < _TOLERANCE:
            return two
        of_two = excess_pa(two)
    return longest
