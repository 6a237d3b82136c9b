"""A reference that presses: the tip moves along a direction until the force is there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.adaptation.external_force import ExternalForce
from soro_core.arrays import Array
from soro_core.control.reference.trajectory import Hold, Point, Reference

# Deviations of a force, as parts of the wanted one: along the direction, where any may come, across it, and
# across it in the mean of some time.
_ALONG, _ACROSS, _SLOW_ACROSS = 30.0, 0.5, 1.0


@dataclass(frozen=True)
class Press(Reference):
    """A set point whose tip the force loop moves along `direction`; across it the tip stays.

    Attributes
    ----------
    q : ndarray (n_q,)
        Where the press begins.
    direction : ndarray (3,)
        Unit vector in the world, towards what is pressed on.
    force_n : float
        Force along it [N], above 0.
    zero_n : ndarray (3,)
        Estimated force on the arm that counts as none [N].
    """

    q: Array
    direction: Array
    force_n: float
    zero_n: Array

    @property
    def end_s(self) -> float:
        """It rests, but for the force."""
        return -math.inf

    def sample(self, t: float) -> Point:
        """Return where it begins, at rest."""
        return Hold(self.q).sample(t)

    def pressed_n(self, felt: ExternalForce, aside: Array) -> tuple[float, Array]:
        """Return the most likely force along the direction [N], and that across it, with an estimated one.

        What pushes back does so within a cone about the direction. The estimate is very doubtful along the
        backbone, and without the cone that doubt would reach every direction that is not square to it.

        Parameters
        ----------
        felt : ExternalForce
            On the arm.
        aside : ndarray (3,)
            The force across, as it is known by now [N]; the one that is returned does not depend on it.
        """
        along, push = np.outer(self.direction, self.direction), self.zero_n - felt.force_n
        beside = np.eye(3) - along

        def likely(mean: Array, spread: float) -> Array:
            cone = self.force_n**2 * (_ALONG**2 * along + spread**2 * beside)
            return mean + likely_force(push - mean, felt.covariance, cone)

        return float(self.direction @ likely(aside, _ACROSS)), beside @ likely(np.zeros(3), _SLOW_ACROSS)

    def is_repeated_by(self, other: Reference, t: float) -> bool:
        """Whether `other` presses alike from the same place."""
        return (
            isinstance(other, Press)
            and np.array_equal(self.q, other.q)
            and self.force_n == other.force_n
            and np.array_equal(self.direction, other.direction)
            and np.array_equal(self.zero_n, other.zero_n)
        )


def likely_force(force_n: Array, covariance: Array, before: Array) -> Array:
    """Return the force (3,) [N] that is most likely with an estimate and with what is expected before it.

    Parameters
    ----------
    force_n : ndarray (3,)
        Estimate [N].
    covariance, before : ndarray (3, 3)
        Its covariance, and that of the forces that may come, about 0 [N^2].
    """
    return np.asarray(before @ np.linalg.solve(before + covariance, force_n))
