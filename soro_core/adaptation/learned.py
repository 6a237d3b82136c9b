"""The learned model as one vector: what the learner gives to law and filter, and what goes over a topic."""

from __future__ import annotations

import math
from dataclasses import dataclass

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

    def scaled(self, share: float) -> Learned:
        """Return this part of it."""
        return Learned(share * self.theta)
