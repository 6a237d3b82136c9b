"""Designs that a task is judged by: projected at its threshold and, if it asks for it, above and below.

A wall or gap too thin for the filter vanishes in one of them, so a design that lives on it does not pay
(F. Wang, B. S. Lazarov, O. Sigmund, On projection methods, convergence and robust formulations in
topology optimization, 2011). The goal is that of the worst.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_design.topology.domain import Domain
from soro_design.topology.physics.compliance import Compliance
from soro_design.topology.physics.filter import projection
from soro_design.topology.physics.grid import Evaluation
from soro_design.topology.physics.stroke import Stroke

# The greater, the nearer to the goal of the worst.
WORST = 8.0


def densities(
    domain: Domain, weights: Any, x: Array, sharpness: float, threshold: float | None = None
) -> tuple[Array, Array, Array]:
    """Return filtered and final densities (e,), and the derivative of the latter by the former.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    weights : sparse matrix, (e, e)
        The density filter.
    x : ndarray, (e,)
        Design variables.
    sharpness : float
        Of the projection, 0 without.
    threshold : float, optional
        Of the projection; default: that of the schedule.
    """
    filtered = np.clip(weights @ x, 0.0, 1.0)
    at = domain.task.schedule.threshold if threshold is None else threshold
    density, slope = projection(filtered, sharpness, at)
    density = np.where(domain.is_solid, 1.0, np.where(domain.is_void, 0.0, density))
    return filtered, density, np.where(domain.is_given, 0.0, slope)


class Judged(NamedTuple):
    """The goal of a set of designs.

    Attributes
    ----------
    goal : float
        Of the worst of them.
    by_filtered : ndarray, (e,)
        Its derivative by the filtered densities.
    each : list of Evaluation
        Of the designs.
    """

    goal: float
    by_filtered: Array
    each: list[Evaluation]


def judged(
    found: Stroke | Compliance,
    designs: Sequence[tuple[Array, Array, Array]],
    penalty: float,
    pressure_pa: float,
    guesses: Iterable[Array],
) -> Judged:
    """Return the goal of the worst of some designs.

    Parameters
    ----------
    found : Stroke or Compliance
        What they are computed with.
    designs : sequence
        What `densities` returns for the threshold of each.
    penalty : float
        Exponent of the stiffness.
    pressure_pa : float
        At the inlet [Pa].
    guesses : iterable of ndarray, (n, d)
        Displacements to begin with [m].

    Raises
    ------
    ModelError
        Where there is no equilibrium, or the air strains nothing.
    """
    each = [
        found.evaluate(density, penalty, pressure_pa)
        if isinstance(found, Compliance)
        else found.evaluate(density, penalty, pressure_pa, guess)
        for (_, density, _), guess in zip(designs, guesses, strict=True)
    ]
    goal, by_goal = worst(np.array([one.objective for one in each]))
    slopes = np.array([one.gradient * slope for one, (_, _, slope) in zip(each, designs, strict=True)])
    return Judged(goal, by_goal @ slopes, each)


def worst(goals: Array) -> tuple[float, Array]:
    """Return a smooth greatest of goals (k,), and its derivative by each (k,).

    That of G. Kreisselmeier, R. Steinhauser, 1979, in units of their root mean square, so that it grows with
    them; of equal goals it is their value.
    """
    unit = float(np.sqrt(np.mean(goals**2)))
    if len(goals) == 1 or unit == 0.0:
        return float(goals.max()), np.full(len(goals), 1.0 / len(goals))
    scaled = goals / unit
    powers = np.exp(WORST * (scaled - scaled.max()))
    share = powers / powers.sum()
    value = float(scaled.max() + np.log(powers.mean()) / WORST)
    return unit * value, share + (value - float(share @ scaled)) * scaled / len(goals)


def least_length(radius_m: float, erosion: float, dimensions: int) -> float:
    """Return the least width of walls and gaps [m] that the greatest threshold leaves anything of.

    Parameters
    ----------
    radius_m : float
        Of the filter (T1) [m].
    erosion : float
        Of the schedule; the threshold of the part is 1/2.
    dimensions : int
        Of the grid.
    """
    # The weights across a plane wall, and the share of them that lies in walls of all widths.
    at = np.linspace(-1.0, 1.0, 2001)
    gap = np.abs(at)
    if dimensions == 3:
        across = 1.0 - 3.0 * gap**2 + 2.0 * gap**3
    else:
        along = np.sqrt(1.0 - gap**2)
        across = along - gap**2 * np.arctanh(np.minimum(along, 1.0 - 1e-15))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (across[1:] + across[:-1]))])
    total /= total[-1]

    def filtered(width: Array | float, place: Array | float) -> Array:
        ends = [np.interp(place + side * width, at, total) for side in (0.5, -0.5)]
        return np.asarray(ends[0] - ends[1])

    widths = np.linspace(0.0, 2.0, 2001)
    width = widths[np.searchsorted(filtered(widths, 0.0), min(0.5 + erosion, 1.0 - 1e-9))]
    # Of what the threshold of the part leaves of that wall.
    return radius_m * float(2.0 * at[filtered(width, at) >= 0.5].max())
