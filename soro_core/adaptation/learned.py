"""The learned model as one vector: what the learner gives to law and filter, and what goes over a topic."""

from __future__ import annotations

import math
from dataclasses import dataclass

from soro_core.adaptation.scales import Scales
from soro_core.arrays import Array


def size_of(n_q: int) -> int:
    """Return the number of learned values for `n_q` coordinates: one mass, and W row by row."""
    return 1 + n_q * (n_q + 1)


@dataclass(frozen=True)
class Learned:
    """The learned model theta.

    Attributes
    ----------
    theta : ndarray (1 + n_q (n_q + 1),)
        Mass at the tip beyond the robot file's [kg], then W row by row, without unit.
    """

    theta: Array

    @property
    def mass_kg(self) -> float:
        """Mass at the tip beyond that of the robot file [kg]."""
        return float(self.theta[0])

    def weights(self, n_q: int) -> Array:
        """Return W (n_q, n_q + 1); its columns multiply phi = (1, q / q_scale)."""
        return self.theta[1:].reshape(n_q, n_q + 1)

    def usable(self, n_q: int) -> bool:
        """Whether it is one of `n_q` coordinates, and finite."""
        theta = self.theta
        if theta.shape != (size_of(n_q),):
            return False
        # The sum of squares says yes at once; it is infinite too where finite values are very large.
        return math.isfinite(theta @ theta) or all(map(math.isfinite, theta.tolist()))

    def with_force(self, q: Array, force: Array, by_q: Array, scales: Scales) -> Learned:
        """Return it with a force (n_q,) at coordinates q (n_q,), and its change (n_q, n_q) by them, in W."""
        theta, n = self.theta.copy(), q.size
        weights = theta[1:].reshape(n, n + 1)
        weights[:, 0] += (force - by_q @ q) / scales.force  # at the origin
        weights[:, 1:] += by_q * scales.q / scales.force[:, None]
        return Learned(theta)

    def scaled(self, share: float) -> Learned:
        """Return this part of it."""
        return Learned(share * self.theta)
