"""Directions of q that position measurements do not constrain.

The filter knows such a direction from its model, and calls it certain. What a learner finds in it is then the
model's own error, which the filter follows and the learner finds again. It must not be learned from.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soro_core.arrays import Array
from soro_core.estimation.filter import Filter
from soro_core.estimation.kernel import entries

# Deviation of the positions as a part of the arm's length: far below any sensor's, so that what positions
# show keeps the filter's covariance.
_SEEN_PART = 1e-4


def unmeasured_covariance(filter_: Filter, q: Array, places: Sequence[float], units: Array) -> Array:
    """Return the covariance (n_q, n_q) of what positions leave open: a unit of q in each unseen direction.

    Parameters
    ----------
    filter_ : Filter
    q : ndarray (n_q,)
        Coordinates.
    places : sequence of float
        Places along the arm whose positions are measured [m].
    units : ndarray (n_q, n_q)
        Squared unit of each coordinate on the diagonal: the covariance without any position.
    """
    if filter_.n <= 3 * len(places):  # as many positions as coordinates show them all
        return np.zeros(units.shape)
    covariance = units.copy()
    for place in places:
        variance = (_SEEN_PART * filter_.arm.length) ** 2
        entries.see(filter_.box, filter_.site(place), q, variance, covariance)
    return covariance
