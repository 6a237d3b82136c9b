"""The learned force Y_m m + U W phi(q) + R_t qd, phi = (1, q / q_scale), docs/control.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soro_core.adaptation.damping import damping_model
from soro_core.adaptation.learned import Learned, first_damping
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
        self.damping = damping_model(arm, pieces)
        self.size = first_damping(arm.n_q) + self.damping.size

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the entries of W, row by row, and of the retardation times."""
        names = self.arm.robot.coordinate_names
        weights = (f"{name}/{of}" for name in names for of in ("offset", *(f"by {by}" for by in names)))
        return (*weights, *self.damping.names)

    def force(self, learned: Learned, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the learned force (n_q,).

        Parameters
        ----------
        learned : Learned
            The learned model.
        q, qd, qdd : ndarray (n_q,)
            Coordinates, rates, and the acceleration at which the mass is taken.
        """
        return self.with_mass(learned, q, qd, self.arm.tip_mass_force(q, qd, qdd))

    def with_mass(self, learned: Learned, q: Array, qd: Array, by_mass: Array) -> Array:
        """Return the learned force (n_q,), the force Y_m of a mass being known.

        Parameters
        ----------
        learned : Learned
            The learned model.
        q, qd, by_mass : ndarray (n_q,)
            Coordinates, rates, and Y_m, see `SoftArm.tip_mass_force`.
        """
        n = self.arm.n_q
        phi = np.ones(n + 1)
        np.divide(q, self.scales.q, out=phi[1:])
        shape = learned.weights(n) @ phi
        losses = self.damping.force(learned.damping_s(n), qd)
        return np.asarray(by_mass * learned.mass_kg + self.scales.force * shape + losses)
