"""Compiling ahead, so that no control loop ever does."""

from __future__ import annotations

import numpy as np

from soro_core.integrate.simulate import simulate
from soro_core.integrate.stepper import make_stepper
from soro_core.model import SoftArm


def warm_up(arm: SoftArm, steppers: tuple[str, ...] = ("trapezoidal",)) -> None:
    """Compile (or load from the cache) every kernel that `arm` and the steppers call.

    Parameters
    ----------
    arm : SoftArm
    steppers : tuple of str
        Names out of `soro_core.integrate.STEPPERS`. Those that dissipate (`tr_bdf2`, `tr_bdf2_linear`) share
        one kernel, all other implicit ones another, all explicit ones a third: what one compiles serves the
        rest of its kind.
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
