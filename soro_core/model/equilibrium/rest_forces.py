"""Forces on an arm at rest, whose sum is zero at an equilibrium."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.model.soft_arm import SoftArm

STEP = 1e-6
# Error of the smallest stiffness by these differences, as a part of those of the coordinates.
NEUTRAL = 1e-8


@dataclass(frozen=True)
class RestForces:
    """An arm and what acts on it at rest.

    Attributes
    ----------
    arm : SoftArm
    pressure_pa : (n_u,)
        Gauge pressures [Pa].
    added_tip_mass : float
        Mass at the tip beside that of the robot [kg].
    wrench : ndarray or callable, optional
        As in `SoftArm.forward_dynamics`, checked; or a function of q that gives it.
    """

    arm: SoftArm
    pressure_pa: Array
    added_tip_mass: float = 0.0
    wrench: Array | Callable[[Array], Array] | None = None

    @property
    def outside(self) -> bool:
        """Whether contact or a held tip acts."""
        return self.arm.robot.contacts is not None or self.arm.robot.tip_constraint is not None

    def unbalanced(self, q: Array, pressures: float = 1.0, outside: float = 1.0) -> Array:
        """Generalised force that something else would have to add.

        Parameters
        ----------
        q : (n_q,)
        pressures, outside : float
            Shares of the pressures and wrenches, and of contact and the held tip, that act.
        """
        arm = self.arm
        force = arm.gravity_force(q) + arm.elastic_force(q)
        force -= pressures * arm.pressure_force(q, self.pressure_pa)
        if self.added_tip_mass:
            none = np.zeros(arm.n_q)
            force += self.added_tip_mass * arm.mass_regressor(q, none, none, none)[:, 0]
        held = arm.external_forces(q).generalised if self.outside else np.zeros(arm.n_q)
        force -= outside * held
        if self.wrench is not None:
            wrench = self.wrench(q) if callable(self.wrench) else self.wrench
            force -= pressures * (arm.external_forces(q, wrench=wrench).generalised - held)
        return np.asarray(force)

    def stiffness(self, q: Array, outside: float = 1.0) -> Array:
        """Derivative (n_q, n_q) of the unbalanced force, by central differences."""
        steps = STEP * np.eye(q.size)
        slopes = [
            (self.unbalanced(q + e, 1.0, outside) - self.unbalanced(q - e, 1.0, outside)) / (2 * STEP)
            for e in steps
        ]
        return np.stack(slopes, axis=1)

    def is_stable(self, q: Array) -> bool:
        """Whether the arm stays at an equilibrium: no direction of negative stiffness.

        An arm that hangs over beside its base may turn about the vertical without any stiffness: it stays.
        """
        matrix = self.stiffness(q)
        unit = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
        scaled = 0.5 * (matrix + matrix.T) / np.outer(unit, unit)
        return bool(np.linalg.eigvalsh(scaled).min() > -NEUTRAL)
