"""Pressures for a wished generalised force: bounded, weighted least squares.

minimise |A (H p - f)|^2 + rho |p - p_0|^2  with  minimum <= p <= maximum,   docs/model.md (39)

A primal active-set method in scaled pressures solves it. Every iterate is within the bounds, so the answer is
admissible even if the iterations run out; the problem is strictly convex, so the method terminates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.robot.coordinates import StrainFields

Array: TypeAlias = NDArray[np.float64]

_TOLERANCE = 1e-9
# Rows of H smaller than this part of the largest one of their kind are round-off: the sine of pi is 1e-16.
_ROUND_OFF = 1e-12


@dataclass(frozen=True)
class Allocation:
    """Result of `allocate`.

    Attributes
    ----------
    pressure_pa : ndarray (n_u,)
        Within the bounds, always finite.
    force : ndarray (n_q,)
        H p, the generalised force of these pressures.
    saturated : ndarray of bool (n_u,)
        Chambers at one of their bounds.
    iterations : int
        Iterations of the active-set method.
    ok : bool
        False if the input was not finite (the start is returned) or the iterations ran out.
    """

    pressure_pa: Array
    force: Array
    saturated: NDArray[np.bool_]
    iterations: int
    ok: bool


def allocate(
    actuation: Array,
    force: Array,
    minimum_pa: Array,
    maximum_pa: Array,
    weight: Array,
    regularisation: float,
    preferred_pa: Array,
    start_pa: Array,
) -> Allocation:
    """Return the pressures whose generalised force is nearest to `force`, docs/model.md (39).

    Parameters
    ----------
    actuation : ndarray (n_q, n_u)
        H, generalised force per Pa.
    force : ndarray (n_q,)
        Wished generalised force, in the units of each coordinate.
    minimum_pa, maximum_pa : ndarray (n_u,)
        Bounds [Pa], finite, minimum < maximum.
    weight : ndarray (m, n_q)
        A, applied to the forces; `balanced_weight` makes newtons and newton metres comparable.
    regularisation : float
        rho, > 0, relative to the mean square of the weighted columns; makes the solution unique.
    preferred_pa : ndarray (n_u,)
        p_0 [Pa].
    start_pa : ndarray (n_u,)
        Start of the search (the last result) [Pa], returned for input that is not finite.

    Returns
    -------
    Allocation
    """
    n = minimum_pa.shape[0]
    span = maximum_pa - minimum_pa
    start = np.where(np.isfinite(start_pa), start_pa, minimum_pa)
    x = np.minimum(np.maximum((start - minimum_pa) / span, 0.0), 1.0)
    # The check below finds what is not finite, or becomes so.
    with np.errstate(invalid="ignore", over="ignore"):
        A = (weight @ actuation) * span
        b = weight @ (force - actuation @ minimum_pa)
        square = A.T @ A
        rho = regularisation * max(float(np.trace(square)) / n, 1e-300)
        hessian = square + rho * np.eye(n)
        linear = A.T @ b + rho * (preferred_pa - minimum_pa) / span
    if np.all(np.isfinite(hessian)) and np.all(np.isfinite(linear)):
        x, iterations, ok = _active_set(hessian, linear, x)
    else:
        iterations, ok = 0, False
    # minimum + span * 1 may round to just above the maximum.
    pressure = np.minimum(np.maximum(minimum_pa + span * x, minimum_pa), maximum_pa)
    made = actuation @ pressure
    saturated = (x <= _TOLERANCE) | (x >= 1.0 - _TOLERANCE)
    return Allocation(pressure, np.where(np.isfinite(made), made, 0.0), saturated, iterations, ok)


def balanced_weight(actuation: Array, fields: StrainFields) -> Array:
    """Return the weight A (n_q, n_q) that expresses every generalised force as a pressure.

    The forces f on the coefficients of one strain are measured by the smallest distributed moment (or force)
    that causes them; its mean square is f' W^-1 f with W of docs/model.md (4), in every basis. The forces of
    each strain are divided by this norm of the strain's rows of H. For a constant strain, that is the row
    divided by its length.
    """
    square = np.sum((fields.root @ actuation) ** 2, axis=1)
    length = np.sqrt(np.bincount(fields.index, square))
    forces = fields.stretch[fields.first]
    # Forces and moments have different units; a weak chamber is far above the round-off of its kind.
    largest = np.where(forces, *(np.max(length, initial=0.0, where=kind) for kind in (forces, ~forces)))
    # A strain that no chamber drives gets the weight 0.
    driven = (length > _ROUND_OFF * largest)[fields.index]
    length = np.where(driven, length[fields.index], 1.0)
    return np.asarray(np.where(driven, 1.0 / length, 0.0)[:, None] * fields.root)


def _active_set(hessian: Array, linear: Array, x: Array) -> tuple[Array, int, bool]:
    """Minimise x'Gx/2 - c'x over [0, 1]^n from a feasible x (G positive definite)."""
    n = x.shape[0]
    free = (x > 0.0) & (x < 1.0)
    scale = float(np.max(np.abs(hessian)))
    for iteration in range(1, 10 * n + 10):
        if free.any():
            index = np.flatnonzero(free)
            gradient = hessian[index] @ x - linear[index]
            step = np.linalg.solve(hessian[np.ix_(index, index)], -gradient)
            room = np.where(step > 0.0, 1.0 - x[index], -x[index])
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = np.where(step != 0.0, room / step, np.inf)
            blocking = int(np.argmin(ratio))
            if ratio[blocking] < 1.0:
                x[index] += max(float(ratio[blocking]), 0.0) * step
                np.clip(x, 0.0, 1.0, out=x)
                at = index[blocking]
                x[at] = 1.0 if step[blocking] > 0.0 else 0.0
                free[at] = False
                continue
            x[index] += step
            np.clip(x, 0.0, 1.0, out=x)
        # Multipliers of the bounds: positive where moving inwards would lower the cost.
        slope = hessian @ x - linear
        gain = np.where(free, 0.0, np.where(x <= 0.0, -slope, slope))
        worst = int(np.argmax(gain))
        if gain[worst] <= _TOLERANCE * scale:
            return x, iteration, True
        free[worst] = True
    return x, iteration, False
