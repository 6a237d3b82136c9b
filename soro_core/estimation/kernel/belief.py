"""Mean and covariance of the filter's state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.linear import assign, assign_matrix


class Belief(NamedTuple):
    """Mean and covariance of (q, qd, disturbance, drift), and the internal states at this mean.

    Attributes
    ----------
    mean : ndarray (m,)
        (q, qd, disturbance, drift); m = 2 n + 2 n_d, n_d is n, or 0 without disturbance.
    internal : ndarray (n_internal,)
        Creep and hysteresis states.
    covariance : ndarray (m, m)
        Covariance of the mean.
    n : int
        Number of coordinates.
    """

    mean: Array
    internal: Array
    covariance: Array
    n: int

    def finite(self) -> bool:
        """Whether all numbers are finite."""
        return all(bool(np.isfinite(part).all()) for part in (self.mean, self.internal, self.covariance))

    @property
    def q(self) -> Array:
        """Coordinates (n,)."""
        return self.mean[: self.n]

    @property
    def qd(self) -> Array:
        """Rates (n,)."""
        return self.mean[self.n : 2 * self.n]

    @property
    def disturbance(self) -> Array:
        """Disturbance, an acceleration of the coordinates (n_d,)."""
        return self.mean[2 * self.n : 3 * self.n]

    @property
    def drift(self) -> Array:
        """Rate of the disturbance (n_d,)."""
        return self.mean[3 * self.n :]


@inner
def assign_belief(belief: Belief, out: Belief) -> None:
    """Out <- belief."""
    assign(belief.mean, out.mean)
    assign(belief.internal, out.internal)
    assign_matrix(belief.covariance, out.covariance)
