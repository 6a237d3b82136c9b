"""Stiffness of the tip of an arm, from the model at rest."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from soro_core.arrays import Array
from soro_core.model import SoftArm
from soro_core.model.equilibrium.finer_arm import finer_arm
from soro_core.model.equilibrium.rest_forces import RestForces

# Pieces of a link that a force at the tip bends non-uniformly.
_PIECES = 4


class StiffnessAtTip:
    """Stiffness of the tip of one arm; without pressures, that of empty chambers.

    Attributes
    ----------
    chambers : list of slice
        Chambers of each link.
    """

    def __init__(self, arm: SoftArm) -> None:
        self.arm = arm
        ends = np.cumsum([0, *(len(link.chambers) for link in arm.robot.links)]).tolist()
        self.chambers = [slice(a, b) for a, b in pairwise(ends) if b > a]
        # Of varying strain, links bend non-uniformly as they are.
        self._fine = None if arm.robot.varies else finer_arm(arm, _PIECES)

    def compliance(self, q: Array, toward: Array, k_p: Array) -> float:
        """Return how far a force moves the tip along itself, with feedback [m/N].

        Parameters
        ----------
        q : ndarray (n_q,)
            Coordinates of the reference.
        toward : ndarray (3,)
            Direction of the force.
        k_p : ndarray (n_q, n_q)
            Feedback.
        """
        return float(toward @ _compliance(self.arm, q, None, k_p) @ toward)

    def nonuniformity(self, q: Array, toward: Array) -> float:
        """Return the compliance of links bent non-uniformly by a force at the tip, over that of uniform ones.

        Parameters
        ----------
        q : ndarray (n_q,)
        toward : ndarray (3,)
            Direction of the force.
        """
        fine, uniform = self._own(q, None), _compliance(self.arm, q, None)
        return float((toward @ fine @ toward) / (toward @ uniform @ toward))

    def compliances(self, q: Array, k_p: Array, pressure_pa: Array) -> tuple[Array, Array]:
        """Return how far forces move the tip (3, 3) [m/N]: of the arm alone, and with feedback.

        Parameters
        ----------
        q : ndarray (n_q,)
            Coordinates of the reference.
        k_p : ndarray (n_q, n_q)
            Feedback, of the uniform strains that put the tip where it is.
        pressure_pa : ndarray (n_u,)
            Held in the chambers, whose areas change with the strains [Pa].
        """
        own, uniform = self._own(q, pressure_pa), _compliance(self.arm, q, pressure_pa)
        held = np.linalg.pinv(uniform) @ _compliance(self.arm, q, pressure_pa, k_p)
        return own, np.asarray(own @ held)

    def _own(self, q: Array, pressure_pa: Array | None) -> Array:
        """Return the compliance (3, 3) of links that bend non-uniformly."""
        if self._fine is None:
            return _compliance(self.arm, q, pressure_pa)
        arm, spread = self._fine
        return _compliance(arm, spread @ q, pressure_pa)

    def by_common_pressure(self, q: Array) -> Array:
        """Return how far a common pressure of each link with chambers moves the tip (3, n) [m/Pa]."""
        return np.asarray(_slope(self.arm, q) @ self.strain_by_common_pressure(q))

    def strain_by_common_pressure(self, q: Array) -> Array:
        """Return how it changes the coordinates (n_q, n) [1/Pa]."""
        actuation = self.arm.actuation_matrix(q)
        common = np.stack([actuation[:, one].sum(axis=1) for one in self.chambers], axis=1)
        return np.linalg.solve(_stiffness(self.arm, q), common)

    def slope(self, q: Array) -> Array:
        """Return the derivative (3, n_q) of the tip's position in the world."""
        return _slope(self.arm, q)

    def friction(self, play_pa: float) -> float:
        """Return the force [N] at the tip of the straight arm that its friction hides, across the backbone.

        Parameters
        ----------
        play_pa : float
            Play of set point and pressure, its width [Pa].
        """
        q = np.zeros(self.arm.n_q)
        slope, stiffness = _slope(self.arm, q), _stiffness(self.arm, q)
        compliance = slope @ np.linalg.solve(stiffness, slope.T)
        softest = np.linalg.eigh(0.5 * (compliance + compliance.T))[1][:, -1]
        by_force = np.linalg.solve(stiffness, slope.T @ softest) / (softest @ compliance @ softest)
        play = np.abs(by_force @ self.arm.actuation_matrix(q)).sum() * 0.5 * play_pa
        return float(play + np.abs(by_force) @ self._hysteresis())

    def _hysteresis(self) -> Array:
        """Return the largest force (n_q,) of the hysteresis."""
        force, first = np.zeros(self.arm.n_q), 0
        for link in self.arm.robot.links:
            for one in link.hysteresis:
                force[first : first + link.n_q] += np.multiply(one.stiffness, one.range)
            first += link.n_q
        return force


def _slope(arm: SoftArm, q: Array) -> Array:
    """Return the derivative (3, n_q) of the tip's position in the world."""
    pose, jacobian = arm.pose_and_jacobian(q, arm.length)
    return np.asarray(pose[:3, :3] @ jacobian[3:])


def _stiffness(arm: SoftArm, q: Array, pressure_pa: Array | None = None) -> Array:
    """Return the derivative (n_q, n_q) of gravity, elastic force and that of the pressures, 0 without."""
    held = np.zeros(arm.n_u) if pressure_pa is None else pressure_pa
    return RestForces(arm, held).stiffness(q, outside=0.0)


def _compliance(arm: SoftArm, q: Array, pressure_pa: Array | None, k_p: Array | float = 0.0) -> Array:
    """Return the displacement of the tip by a force on it, (3, 3) [m/N]."""
    slope = _slope(arm, q)
    return np.asarray(slope @ np.linalg.solve(_stiffness(arm, q, pressure_pa) + k_p, slope.T))
