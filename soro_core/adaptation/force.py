"""The learned force Y_m m + U W phi(q), phi = (1, q / q_scale), docs/control.md."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.adaptation.learned import Learned, size_of
from soro_core.adaptation.scales import scales_of
from soro_core.robot.coordinates import strain_fields

if TYPE_CHECKING:
    from soro_core.model import SoftArm

Array: TypeAlias = NDArray[np.float64]

# Increment of q for the slope of the weight of the mass, in units of q_scale.
_STEP = 1e-4


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
        self._bends = ~strain_fields(arm.robot).stretch

    def regressor(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Return Phi (n_q, size): the learned force is U Phi theta.

        Parameters
        ----------
        q, qd, qdd : ndarray (n_q,)
            Coordinates, rates, and the acceleration at which the mass is taken.
        """
        n = self.arm.n_q
        rows = np.zeros((n, self.size))
        rows[:, 0] = self.arm.tip_mass_force(q, qd, qdd) / self.scales.force
        rows[:, 1:].reshape(n, n, n + 1)[np.arange(n), np.arange(n)] = self._features(q)
        return rows

    def force(self, learned: Learned, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the learned force (n_q,).

        Parameters
        ----------
        learned : Learned
            The learned model.
        q, qd, qdd : ndarray (n_q,)
            Coordinates, rates, and the acceleration at which the mass is taken.
        """
        shape = learned.weights(self.arm.n_q) @ self._features(q)
        return np.asarray(self.arm.tip_mass_force(q, qd, qdd) * learned.mass_kg + self.scales.force * shape)

    def acceleration(self, learned: Learned, q: Array, qd: Array, alone: Array) -> Array:
        """Return what the learned force adds (n_q,) to the acceleration of the arm.

        Its mass is weighed and accelerated: (M + m J' J)(alone + added) = M alone - Y_m m - U W phi, J of the
        bendings, Y_m without acceleration.

        Parameters
        ----------
        learned : Learned
            The learned model.
        q, qd : ndarray (n_q,)
            Coordinates and rates.
        alone : ndarray (n_q,)
            Acceleration of the arm without the learned force.
        """
        _, loaded, extra = self._inertia(learned, q)
        force = self.force(learned, q, qd, np.zeros_like(q))
        return np.asarray(np.linalg.solve(loaded, -force - extra @ alone))

    def linearise(self, learned: Learned, q: Array, qd: Array) -> tuple[Array, Array]:
        """Return the factor on the derivatives of `alone` and the slope of the rest by q, (n_q, n_q) each.

        Parameters
        ----------
        learned : Learned
            The learned model.
        q, qd : ndarray (n_q,)
            Coordinates and rates. The inertia is held.
        """
        n, zero, scales = self.arm.n_q, np.zeros_like(q), self.scales
        inertia, loaded, _ = self._inertia(learned, q)
        here = self.arm.tip_mass_force(q, qd, zero)
        steps = _STEP * np.diag(scales.q)
        weight = np.stack(
            [(self.arm.tip_mass_force(q + e, qd, zero) - here) / e.sum() for e in steps], axis=1
        )
        shape = scales.force[:, None] * learned.weights(n)[:, 1:] / scales.q
        change = learned.mass_kg * weight + shape
        both = np.linalg.solve(loaded, np.hstack([inertia, -change]))
        return np.asarray(both[:, :n]), np.asarray(both[:, n:])

    def _inertia(self, learned: Learned, q: Array) -> tuple[Array, Array, Array]:
        """Return M, M + m J' J and m J' J of the learned mass; less mass than the file's has no inertia.

        Of the bendings: elongation is so stiff that its acceleration alone, corrected once a step, would
        oscillate, and the load moves slowly along the arm.
        """
        jacobian = self.arm.jacobian(q, self.arm.length)[3:] * self._bends
        extra = max(learned.mass_kg, 0.0) * jacobian.T @ jacobian
        inertia = self.arm.inertia_matrix(q)
        return inertia, inertia + extra, extra

    def _features(self, q: Array) -> Array:
        return np.concatenate([[1.0], q / self.scales.q])
