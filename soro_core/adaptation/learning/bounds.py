"""The minimum of a quadratic form within bounds."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array

# Values that are held at a bound one after the other; beyond that each is clipped.
_MOST_HELD = 8


def bounded_minimum(information: Array, moment: Array, free: Array, lower: Array, upper: Array) -> Array:
    """Return theta within bounds with a small theta' A theta / 2 - b' theta.

    The value that is farthest out is held at its bound and the others are solved for again, until all are
    within. A held value stays held: the result is the minimum if one bound binds, and near it otherwise.

    Parameters
    ----------
    information, moment : ndarray (size, size), (size,)
        A, positive definite, and b.
    free : ndarray (size,)
        A^-1 b, which is returned where it is within the bounds.
    lower, upper : ndarray (size,)
        Bounds.
    """
    theta, is_free = free, np.ones(free.size, dtype=bool)
    for _ in range(_MOST_HELD):
        within = np.minimum(np.maximum(theta, lower), upper)
        if within.tolist() == theta.tolist():
            return theta
        # Values of several units are compared in what each alone would cost.
        worst = int(np.argmax(np.abs(theta - within) * np.sqrt(np.diag(information))))
        is_free[worst] = False
        held = np.where(is_free, 0.0, within)
        theta = held.copy()
        theta[is_free] = np.linalg.solve(
            information[np.ix_(is_free, is_free)], (moment - information @ held)[is_free]
        )
    return np.asarray(np.minimum(np.maximum(theta, lower), upper))
