"""The learned force Y_m m + U W phi(q), phi = (1, q / q_scale), docs/control.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soro_core.adaptation.learned import Learned, size_of
from soro_core.adaptation.scales import scales_of
from soro_core.arrays import Array

if TYPE_CHECKING:
    from soro_core.model import SoftArm


class LearnedForce:
    """The learned force of one arm, on the left-hand side of its dynamics.

    Parameters
    ----------
    arm : SoftArm
        Model.
    pieces : int
        Number of pieces into which each link is discretised.
    """

    def __init__(self, arm: SoftArm, pieces: int = 1) -> None:
        self.arm, self.scales = arm, scales_of(arm, pieces)
        self.size = size_of(arm.n_q)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the entries of W, row by row."""
        names = self.arm.robot.coordinate_names
        return tuple(f"{name}/{of}" for name in names for of in ("offset", *(f"by {by}" for by in names)))

    def force(self, learned: Learned, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the learned force (n_q,).

        Parameters
        ----------
        learned : Learned
            The learned model.
        q, qd, qdd : ndarray (n_q,)
            Coordinates, rates, and the acceleration at which the mass is taken.
        """
        return self.with_mass(learned, q, self.arm.tip_mass_force(q, qd, qdd))

    def with_mass(self, learned: Learned, q: Array, by_mass: Array) -> Array:
        """Return the learned force (n_q,), the force Y_m of a mass being known.

        Parameters
        ----------
        learned : Learned
            The learned model.
        q, by_mass : ndarray (n_q,)
            Coordinates, and Y_m, see `SoftArm.tip_mass_force`.
        """
        shape = learned.weights(self.arm.n_q) @ np.concatenate([[1.0], q / self.scales.q])
        return np.asarray(by_mass * learned.mass_kg + self.scales.force * shape)
