"""Shapes that no position shows: how an arm shares its bend between two links, with a pose of the tip alone.

The filter knows such a shape from its model, and calls it certain. What a learner finds in it is then the
model's own error, which the filter follows and the learner finds again. It must not be learned from.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.model import SoftArm

Array: TypeAlias = NDArray[np.float64]

# Deviation of the positions as a part of the arm's length: far below any sensor's, so that what positions
# show keeps the filter's covariance.
_SEEN_PART = 1e-4


def unseen_covariance(arm: SoftArm, q: Array, places: Sequence[float], q_scale: Array) -> Array:
    """Return the covariance (n_q, n_q) of what positions leave open: a unit of q in each unseen direction.

    Parameters
    ----------
    arm : SoftArm
    q : ndarray (n_q,)
        Coordinates.
    places : sequence of float
        Places along the arm whose positions are measured [m].
    q_scale : ndarray (n_q,)
        Unit of each coordinate.
    """
    n = arm.n_q
    if n <= 3 * len(places):  # as many positions as coordinates show them all
        return np.zeros((n, n))
    rows = [arm.jacobian(q, place)[3:] * q_scale for place in places]
    seen = np.vstack(rows) if rows else np.zeros((0, n))
    information = np.eye(n) + seen.T @ seen / (_SEEN_PART * arm.length) ** 2
    return np.asarray(np.linalg.inv(information) * np.outer(q_scale, q_scale))
