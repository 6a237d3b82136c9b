"""The elongation that a circle's mean pressure chooses, with what the law has learned.

A scene that states curvature and mean pressure leaves the elongation to the model. Beside a weak chamber the
file's model chooses one for which the true arm needs a higher mean pressure, and a chamber is at its limit.
With the learned forces and gains the same keys give about the elongation of a right file; it has the force of
non-uniform strain, too, which the file's choice leaves out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from soro_core.arrays import Array
from soro_core.control.config import ReferenceConfig
from soro_core.control.motions.kinematics import mean_holding_pressure
from soro_core.control.motions.pressure_feasibility import PressureSupply
from soro_core.control.reference.active_reference import ActiveReference
from soro_core.control.reference.trajectory import Circle
from soro_core.errors import SoroError
from soro_core.frozen import replaced

# Least change of the elongation for which a circle moves.
_CHANGE = 2e-3
# First step of the search, most tries, and how near the mean pressure comes to the stated one [Pa].
_STEP, _TRIES, _NEAR_PA = 0.01, 8, 100.0


@dataclass(frozen=True)
class ElongationChoice:
    """State of the choice.

    Attributes
    ----------
    circle : Circle or None
        What was chosen last in place of the configured circle; it may not be in force any more.
    said : str
        What the user must know of it.
    enough_s, chosen_s : float
        Time since a chamber has lacked pressure, and since the last choice [s].
    tried : tuple of tuple of float
        Elongations of the search under way, and how far their mean pressures are too high [Pa].
    """

    circle: Circle | None = None
    said: str = ""
    enough_s: float = math.inf
    chosen_s: float = math.inf
    tried: tuple[tuple[float, float], ...] = ()

    def later(self, dt: float, lacks: bool) -> ElongationChoice:
        """Return the state after `dt` [s], in which a chamber has lacked pressure or not."""
        enough_s = 0.0 if lacks else self.enough_s + dt
        return replaced(self, enough_s=enough_s, chosen_s=self.chosen_s + dt)

    def is_due(self, every_s: float) -> bool:
        """Whether to choose, at most every so many seconds [s]: the circle moves between two choices."""
        return self.chosen_s >= every_s and (self.enough_s < every_s or self.circle is not None)

    def is_followed(self, following: ActiveReference) -> bool:
        """Whether the chosen circle is in force, and no reference that came later."""
        return self.circle is not None and following.wanted is self.circle

    def note(self, following: ActiveReference) -> str:
        """Return what the user must know while the chosen circle is in force, or an empty string."""
        return self.said if self.is_followed(following) else ""

    def renewed(
        self, supply: PressureSupply, settings: ReferenceConfig, own: Circle, now: Circle, differs: str
    ) -> tuple[ElongationChoice, Circle]:
        """Return the choice and its circle: `now` itself where it stays.

        A tick tries one elongation: a whole search would take longer than fast loops have.

        Parameters
        ----------
        supply : PressureSupply
            Holds what is learned.
        settings : ReferenceConfig
        own : Circle
            The configured circle, which the file's model has chosen.
        now : Circle
            That in force.
        differs : str
            Chambers that differ from the file; where none does, the circle is the configured one.
        """
        stretch = supply.fields.of("elongation") * supply.fields.uniform
        longest, before = (float(one.centre @ stretch / (stretch @ stretch)) for one in (own, now))
        found, tried = longest, self.tried
        if not differs and longest == before:
            return replaced(self, tried=()), now
        if differs:
            found, at = before, _next(tried, longest)
            if len(tried) < _TRIES and -settings.stretch_limit <= at <= longest:
                try:
                    more_pa = _excess_pa(supply, settings, own, at * stretch)
                except (SoroError, np.linalg.LinAlgError):  # the model has no value there
                    more_pa = math.nan
                if not math.isfinite(more_pa):
                    return replaced(self, chosen_s=0.0, tried=()), now
                if more_pa > _NEAR_PA or (tried and more_pa < -_NEAR_PA):
                    return replaced(self, tried=(*tried, (at, more_pa))), now
                found = at
        after = replaced(self, chosen_s=0.0, tried=())
        if differs and abs(found - before) <= _CHANGE:
            return after, now
        circle = replace(now, centre=own.centre + (found - longest) * stretch)
        said = "" if found == longest else _said(supply, settings, own, circle, (longest, found))
        return replaced(after, circle=circle, said=said), circle


def _next(tried: tuple[tuple[float, float], ...], longest: float) -> float:
    """Return the next elongation to try, by the secant; NaN where shorter needs more: no way to go."""
    if len(tried) < 2:
        return longest - len(tried) * _STEP
    (one, of_one), (two, of_two) = tried[-2:]
    slope = (of_one - of_two) / (one - two)
    return two - of_two / slope if slope > 0.0 else math.nan


def _excess_pa(supply: PressureSupply, settings: ReferenceConfig, own: Circle, centre: Array) -> float:
    """Return how far the mean pressure [Pa] of a circle about a centre (n_q,) is above the stated one."""
    q, zero = own.curvature_per_m * own.across + centre, np.zeros_like(centre)
    low, high = supply.setpoints.minimum_pa, supply.setpoints.maximum_pa
    load, actuation = supply.force(q, zero, zero), supply.actuation(q)
    mean_pa = mean_holding_pressure(supply.arm, supply.fields, load, actuation, low, high)
    return mean_pa - settings.mean_pressure_pa


def _said(
    supply: PressureSupply,
    settings: ReferenceConfig,
    own: Circle,
    circle: Circle,
    elongations: tuple[float, float],
) -> str:
    """Return that the circle has changed, and by how much; elongations before and after."""
    before, after = elongations
    bent = circle.curvature_per_m * circle.across
    tips = [supply.arm.pose(one.centre + bent, supply.arm.length)[:3, 3] for one in (own, circle)]
    return (
        f"the circle has the elongation {after:.3f} in place of {before:.3f}, the tip "
        f"{1e3 * math.dist(*tips):.1f} mm away: with what is learned it takes "
        f"{1e-3 * settings.mean_pressure_pa:g} kPa on average, as stated"
    )
