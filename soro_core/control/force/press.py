"""A reference that presses: the tip moves along a direction until the force is there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.adaptation.external_force import ExternalForce
from soro_core.arrays import Array
from soro_core.control.reference.trajectory import Hold, Point, Reference

# Deviations of a force, as parts of the wanted one: along the direction, where any may come, and across it.
_ALONG, _ACROSS = 30.0, 0.5


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

    def pressed_n(self, felt: ExternalForce) -> float:
        """Return the force along the direction [N] that is most likely, with an estimated force on the arm.

        What pushes back does so within a cone about the direction. The estimate is very doubtful along the
        backbone, and without the cone that doubt would reach every direction that is not square to it.
        """
        along = np.outer(self.direction, self.direction)
        cone = self.force_n**2 * (_ALONG**2 * along + _ACROSS**2 * (np.eye(3) - along))
        return -float(self.direction @ likely_force(felt.force_n - self.zero_n, felt.covariance, cone))

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
