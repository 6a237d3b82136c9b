"""Profiles: how the cost rises where one number is held away from its best value and all others follow.

A covariance is a parabola about the solution. Along a profile the cost may rise faster, slower, on one side
only or not at all. Rises are in units of that of the parabola at one deviation: the parabola is k^2 at k
deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from soro_core.arrays import Array

Rows: TypeAlias = Callable[[Array], Array | None]
Side: TypeAlias = Literal["as the parabola", "steeper", "flatter", "flat", "lower", "bound"]

# Where a number is held, in deviations.
STEPS = (1.0, 2.0)
# Rises over those of the parabola between which a side has the shape of it; and below which it is flat.
_STEEP, _FLAT, _NONE = 2.0, 0.5, 0.1
# A search ends where its next step would lower the cost by less than this part of the unit.
_ENOUGH = 0.01


@dataclass(frozen=True)
class ProfilePoint:
    """The cost with one number held.

    Attributes
    ----------
    at : float
        Where it is held: deviations from the solution.
    x : float
        The same as a position of the problem.
    rise : float
        Rise of the cost, in units of that of the parabola at one deviation.
    of_data : float
        Share of the data in it, in the same unit; the rest is that of the prior.
    """

    at: float
    x: float
    rise: float
    of_data: float


@dataclass(frozen=True)
class Profile:
    """Profile of one number.

    Attributes
    ----------
    name : str
    is_searched : bool
        Whether residuals were computed anew; else they are linear in the numbers.
    points : tuple of ProfilePoint
        In the order of `at`, without the solution; none beyond a bound or where no arm can be simulated.
    """

    name: str
    is_searched: bool
    points: tuple[ProfilePoint, ...]

    @property
    def below(self) -> Side:
        """Shape towards smaller values."""
        return _side([p for p in self.points if p.at < 0.0])

    @property
    def above(self) -> Side:
        """Shape towards larger values."""
        return _side([p for p in self.points if p.at > 0.0])

    @property
    def text(self) -> str:
        """What the shape says of the deviation."""
        below, above = self.below, self.above
        if "lower" in (below, above):
            return f"not at its minimum: the cost falls {'below' if below == 'lower' else 'above'}"
        if below == above == "flat":
            return "flat: the data do not determine it"
        if "flat" in (below, above):
            return f"one-sided: open {'below' if below == 'flat' else 'above'}"
        if below == above:
            return "ends at a bound on both sides" if below == "bound" else below
        return f"{below} below, {above} above"


@dataclass(frozen=True)
class Optimum:
    """Where profiles begin: position (n,), residuals (m,), their derivatives (m, n), and the bounds (n,)."""

    x: Array
    rows: Array
    jacobian: Array
    low: Array
    high: Array


def linear(optimum: Optimum, index: int, deviation: float) -> tuple[ProfilePoint, ...]:
    """Return the profile of one number for residuals that are linear in all; no simulation.

    Parameters
    ----------
    optimum : Optimum
    index : int
    deviation : float
        Its deviation, in the unit of x.
    """
    start = optimum
    return searched(lambda x: start.rows + start.jacobian @ (x - start.x), optimum, index, deviation, most=5)


def searched(
    rows_at: Rows, optimum: Optimum, index: int, deviation: float, most: int = 4
) -> tuple[ProfilePoint, ...]:
    """Return the profile of one number, each point searched from the one before.

    The derivatives are those of the optimum.

    Parameters
    ----------
    rows_at : callable
        Residuals (m,) at x (n,); None where there are none.
    optimum : Optimum
    index : int
    deviation : float
        Its deviation, in the unit of x.
    most : int
        Largest number of steps for each point.
    """
    curvature = _curvature(optimum.jacobian, (1.0 + optimum.rows**2) ** -1.5)
    inverse = np.linalg.inv(curvature)
    direction = inverse[:, index] / inverse[index, index]
    unit = 0.5 * deviation**2 / float(inverse[index, index])
    base = _data(optimum.rows), 0.5 * float(optimum.x @ optimum.x)
    found: list[ProfilePoint] = []
    for sign in (-1.0, 1.0):
        x, before = optimum.x, float(optimum.x[index])
        for step in STEPS:
            target = float(optimum.x[index]) + sign * step * deviation
            if not optimum.low[index] <= target <= optimum.high[index]:
                break
            start = np.clip(x + (target - before) * direction, optimum.low, optimum.high)
            start[index] = target
            rows = rows_at(start)
            if rows is None:
                break
            x, rows = _follow(rows_at, start, rows, index, optimum, most, _ENOUGH * unit)
            before = target
            data, prior = _data(rows) - base[0], 0.5 * float(x @ x) - base[1]
            found.append(ProfilePoint(sign * step, target, (data + prior) / unit, data / unit))
    return tuple(sorted(found, key=lambda p: p.at))


def _follow(
    rows_at: Rows,
    x: Array,
    rows: Array,
    index: int,
    optimum: Optimum,
    most: int,
    enough: float,
) -> tuple[Array, Array]:
    """Lower the cost by all numbers but one; return x (n,) and rows (m,) there."""
    jacobian, low, high = optimum.jacobian, optimum.low, optimum.high
    cost, scale = _data(rows) + 0.5 * float(x @ x), 1.0
    for _ in range(most):
        gradient = jacobian.T @ (rows / np.sqrt(1.0 + rows**2)) + x
        free = ~(((x <= low) & (gradient > 0.0)) | ((x >= high) & (gradient < 0.0)))
        free[index] = False
        step = np.zeros(len(x))
        # No cost is above the parabola with these weights, so no step of linear residuals raises it.
        curved = _curvature(jacobian, 1.0 / np.sqrt(1.0 + rows**2))[np.ix_(free, free)]
        step[free] = -scale * np.linalg.solve(curved, gradient[free])
        if -0.5 * float(gradient @ step) < enough:
            break
        new = np.clip(x + step, low, high)
        there = rows_at(new)
        if there is None:
            scale *= 0.5
            continue
        reached = _data(there) + 0.5 * float(new @ new)
        if reached < cost:
            x, rows, cost, scale = new, there, reached, 1.0
        else:
            scale *= 0.5
    return x, rows


def _data(rows: Array) -> float:
    return float(np.sum(np.sqrt(1.0 + rows**2) - 1.0))


def _curvature(jacobian: Array, weight: Array) -> Array:
    """Second derivatives (n, n) of a cost whose residuals have these weights (m,), and of the prior."""
    return np.asarray(jacobian.T @ (weight[:, None] * jacobian) + np.eye(jacobian.shape[1]))


def _side(points: Sequence[ProfilePoint]) -> Side:
    if not points:
        return "bound"
    if min(p.rise for p in points) < -_NONE:
        return "lower"
    last = max(points, key=lambda p: abs(p.at))
    if last.of_data < _NONE * last.at**2:
        return "flat"
    ratio = last.rise / last.at**2
    return "steeper" if ratio > _STEEP else "flatter" if ratio < _FLAT else "as the parabola"
