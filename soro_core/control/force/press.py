"""A reference that presses: the tip moves along a direction until the force is there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.control.reference.trajectory import Hold, Point, Reference


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

    def pressed_n(self, felt_n: Array) -> float:
        """Return the force along the direction [N] with an estimated force (3,) on the arm."""
        return float(self.direction @ (self.zero_n - felt_n))

    def is_repeated_by(self, other: Reference, t: float) -> bool:
        """Whether `other` presses alike from the same place."""
        return (
            isinstance(other, Press)
            and np.array_equal(self.q, other.q)
            and self.force_n == other.force_n
            and np.array_equal(self.direction, other.direction)
            and np.array_equal(self.zero_n, other.zero_n)
        )
