"""What one sample shows: both sides of the equation of `soro_core.adaptation.learner`, compiled."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from soro_core._box import Box, view
from soro_core._jit import entry
from soro_core.arrays import Array, Integers
from soro_core.model.dynamics import GOOD, NOT_FINITE, add_damping_force, check, finite, motion_forces
from soro_core.model.forces.chambers import acting
from soro_core.model.forces.internal import add_internal_force
from soro_core.model.method import tip_mass_force
from soro_core.model.records import Motion


class UnmodelledForce(NamedTuple):
    """A `NonuniformForce`."""

    at: Array
    mass_kg: float
    force: Array
    by_mass: Array
    by_q: Array


UnmodelledFields: TypeAlias = tuple[Array, float, Array, Array, Array]
"""Its fields: numba takes a plain tuple from Python faster."""
MotionFields: TypeAlias = tuple[Array, Array, Array, Array, Array, Array]
"""q, qd, qdd (n,), pressures (n_u,), creep (n_internal,) and the covariance of q (n, n)."""


@entry
def show(
    box: Box,
    motion: MotionFields,
    unmodelled: UnmodelledFields,
    units: tuple[Array, Array, Integers, Array],
    part: float,
    sides: tuple[Array, Array],
    made: tuple[Array, Array],
) -> int:
    """Move residual r / U (n,) and regressor Phi (n, size) a part of the way to those of a sample.

    r = H p - [M qdd + C qd + G + f_e + R qd + creep] - d(q, 0), with the unmodelled force d about a mass
    and coordinates `at`, and U Phi theta = (Y_m + dd/dm) m + U W phi(q) + R_t qd. `units` of force, U, and of
    q, and number and matrix of a `DampingModel`; `sides` are r / U and Phi. `made` <- H' and effective p.
    Gives a code of `soro_core.model.dynamics`.
    """
    arm, d = view(box), UnmodelledForce(*unmodelled)
    q, qd, qdd, pressure, creep, covariance = motion
    force_unit, q_unit, number, damping = units
    residual, regressor = sides
    t, n, n_u = arm.tables, q.shape[0], pressure.shape[0]
    code = check(t, q, qd)
    if code != GOOD:
        return code
    if not (finite(pressure) and finite(creep) and finite(covariance.reshape(n * n))):
        return NOT_FINITE
    H, acting_pa = made
    model, by_mass, missing = np.empty(n), np.empty(n), np.empty(n)
    motion_forces(t, arm.work, t.tip_mass[0], Motion(q, qd, qd, qdd), model, H)
    tip_mass_force(t, arm.work, q, qd, qdd, by_mass)
    add_damping_force(t, qd, model)
    add_internal_force(t, creep, model)
    for u in range(n_u):
        acting_pa[u] = acting(t, u, pressure[u])
    for c in range(n):
        missing[c] = d.mass_kg * d.by_mass[c] - d.force[c] - model[c]
        for e in range(n):
            missing[c] -= d.by_q[c, e] * (q[e] - d.at[e])
        for u in range(n_u):
            missing[c] += H[u, c] * acting_pa[u]
        missing[c] /= force_unit[c]
        by_mass[c] = (by_mass[c] + d.by_mass[c]) / force_unit[c]
    if not (finite(missing) and finite(by_mass)):
        return NOT_FINITE
    for c in range(n):
        residual[c] += part * (missing[c] - residual[c])
        regressor[c, 0] += part * (by_mass[c] - regressor[c, 0])
        first = 1 + c * (n + 1)
        regressor[c, first] += part * (1.0 - regressor[c, first])
        for e in range(n):
            regressor[c, first + 1 + e] += part * (q[e] / q_unit[e] - regressor[c, first + 1 + e])
        for k in range(1 + n * (n + 1), regressor.shape[1]):
            lost = 0.0
            if number[c] == k - 1 - n * (n + 1):
                for e in range(n):
                    lost += damping[c, e] * qd[e] / force_unit[c]
            regressor[c, k] += part * (lost - regressor[c, k])
    return GOOD
