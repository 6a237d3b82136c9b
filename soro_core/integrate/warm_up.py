"""Compilation of kernels before a control loop starts."""

from __future__ import annotations

import numpy as np

from soro_core.integrate.simulate import simulate
from soro_core.integrate.stepper import make_stepper
from soro_core.model import SoftArm


def warm_up(arm: SoftArm, steppers: tuple[str, ...] = ("trapezoidal",)) -> None:
    """Compile all kernels that `arm` and the steppers call, or load them from the cache.

    Parameters
    ----------
    arm : SoftArm
        Model.
    steppers : tuple of str
        Names in `soro_core.integrate.STEPPERS`. There are three kernels: of the dissipative steppers
        (`tr_bdf2`, `tr_bdf2_linear`), of all other implicit ones, and of all explicit ones.
    """
    q, p = np.zeros(arm.n_q), np.zeros(arm.n_u)
    arm.inertia_matrix(q)
    arm.coriolis_matrix(q, q)
    arm.gravity_force(q)
    arm.elastic_force(q)
    arm.stiffness_matrix(q)
    arm.internal_force(q, np.zeros(arm.n_internal))
    arm.internal_rate(q, q, np.zeros(arm.n_internal))
    arm.pose(q, arm.length)
    arm.forward_dynamics(q, q, p)
    arm.energy(q, q)
    arm.mass_regressor(q, q, q, q)
    arm.elastic_regressor(q)
    for name in steppers:
        stepper = make_stepper(name, arm)
        stepper.step(stepper.initial_state(), p, 1e-6)
        simulate(arm, q, q, t_end=1e-6, dt=1e-6, integrator=name)
