"""The learned model as one vector: what the learner gives to law and filter, and what goes over a topic."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.adaptation.scales import Scales
from soro_core.arrays import Array, all_finite
from soro_core.frozen import quick


def first_damping(n_q: int) -> int:
    """Return where the damping begins in the learned values for `n_q` coordinates: behind mass and W."""
    return 1 + n_q * (n_q + 1)


def weights_of(q: Array, force: Array, by_q: Array, scales: Scales) -> Array:
    """Return W (n_q, n_q + 1) of a force (n_q,) at q (n_q,), and its change (n_q, n_q) by q."""
    weights = np.empty((q.size, q.size + 1))
    weights[:, 0] = (force - by_q @ q) / scales.force  # at the origin
    weights[:, 1:] = by_q * scales.q / scales.force[:, None]
    return weights


@quick
@dataclass(frozen=True)
class Learned:
    """The learned model theta.

    Attributes
    ----------
    theta : ndarray (1 + n_q (n_q + 1) + dampings,)
        Mass at the tip beyond the robot file's [kg], then W row by row, without unit, then retardation times
        [s], see `DampingModel`.
    own : ndarray like theta, or None
        The same without the force by which constant strains miss non-uniform ones; None for theta itself.
    doubt : ndarray (n_q, n_q) or None
        Covariance of the learned force near the present coordinates [generalised force, squared]; None where
        it is not known.
    """

    theta: Array
    own: Array | None = None
    doubt: Array | None = None

    @property
    def mass_kg(self) -> float:
        """Mass at the tip beyond that of the robot file [kg]."""
        return float(self.theta[0])

    def weights(self, n_q: int) -> Array:
        """Return W (n_q, n_q + 1); its columns multiply phi = (1, q / q_scale)."""
        return self.theta[1 : first_damping(n_q)].reshape(n_q, n_q + 1)

    def damping_s(self, n_q: int) -> Array:
        """Return the retardation times (dampings,) [s]."""
        return self.theta[first_damping(n_q) :]

    def usable(self, size: int) -> bool:
        """Whether it has so many values, and all are finite."""
        theta, own, doubt = self.theta, self.own, self.doubt
        if theta.shape != (size,) or (own is not None and own.shape != (size,)):
            return False
        if not all(part is None or all_finite(part) for part in (own, doubt)):
            return False
        # The sum of squares says yes at once; it is infinite too where finite values are very large.
        return math.isfinite(theta @ theta) or all(map(math.isfinite, theta.tolist()))

    def with_force(self, q: Array, force: Array, by_q: Array, scales: Scales) -> Learned:
        """Return it with the W of a force; parameters as of `weights_of`."""
        return self.with_weights(weights_of(q, force, by_q, scales))

    def with_weights(self, weights: Array) -> Learned:
        """Return it with others (n_q, n_q + 1) added to W."""
        theta = self.theta.copy()
        theta[1 : 1 + weights.size] += weights.ravel()
        return Learned(theta)

    def scaled(self, share: float) -> Learned:
        """Return this part of it."""
        return Learned(share * self.theta)
