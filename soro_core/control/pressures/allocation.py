"""Pressures for a desired generalised force: bounded, weighted least squares.

minimise |A (H p - f)|^2 + rho |p - p_0|^2  with  minimum <= p <= maximum,   docs/model.md (39)

`soro_core.control.kernel.allocation` solves it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array
from soro_core.control.kernel import allocation as kernel
from soro_core.frozen import quick
from soro_core.robot.coordinates import StrainFields


@quick
@dataclass(frozen=True)
class Allocation:
    """Result of `allocate`.

    Attributes
    ----------
    pressure_pa : ndarray (n_u,)
        Within the bounds, always finite.
    force : ndarray (n_q,)
        H p, the generalised force of these pressures; finite if H is.
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
        Desired generalised force, in the units of each coordinate.
    minimum_pa, maximum_pa : ndarray (n_u,)
        Bounds [Pa], finite, minimum < maximum.
    weight : ndarray (m, n_q)
        A, applied to the forces; `balanced_weight` makes newtons and newton metres comparable.
    regularisation : float
        rho, > 0, relative to the mean square of the weighted columns; makes the solution unique.
    preferred_pa : ndarray (n_u,)
        p_0 [Pa].
    start_pa : ndarray (n_u,)
        Start of the search (the last result) [Pa], finite; the result for other input that is not.

    Returns
    -------
    Allocation
    """
    span = maximum_pa - minimum_pa
    x = np.minimum(np.maximum((start_pa - minimum_pa) / span, 0.0), 1.0)
    # Copies as kernels take them, see `soro_core.model.checks.shaped`; a law may give H of another type.
    iterations = kernel.solve(
        np.array(actuation, dtype=np.float64),
        np.array(force),
        (np.array(minimum_pa), span, np.array(preferred_pa)),
        np.array(weight),
        regularisation,
        x,
    )
    # minimum + span * 1 may round to just above the maximum.
    pressure = np.minimum(np.maximum(minimum_pa + span * x, minimum_pa), maximum_pa)
    made = actuation @ pressure
    saturated = (x <= kernel.TOLERANCE) | (x >= 1.0 - kernel.TOLERANCE)
    return Allocation(pressure, made, saturated, abs(iterations), iterations > 0)


def balanced_weight(actuation: Array, fields: StrainFields) -> Array:
    """Return the weight A (n_q, n_q) that expresses every generalised force as a pressure.

    The forces f on the coefficients of one strain are measured by the smallest distributed moment (or force)
    that causes them; its mean square is f' W^-1 f with W of docs/model.md (4), in every basis. The forces of
    each strain are divided by this norm of the strain's rows of H. For a constant strain, that is the row
    divided by its length.
    """
    weight = np.empty_like(fields.root)
    kernel.balance(
        fields.root, fields.index, fields.stretch[fields.first], np.array(actuation, dtype=np.float64), weight
    )
    return weight
