"""Kernels that join the terms: the equation of motion by either method (theory.md section 3)."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import inner, kernel
from soro_core.model.chambers import add_pressure_force
from soro_core.model.elasticity import elastic_force
from soro_core.model.internal import add_internal_force
from soro_core.model.linear import cholesky_solve
from soro_core.model.method import inertia, inverse_dynamics, kinematics, potential
from soro_core.model.tables import Tables

Array: TypeAlias = NDArray[np.float64]

# What a kernel says about a state.
GOOD, NOT_FINITE, COLLAPSED, SINGULAR, NOT_CONVERGED, BAD_INPUT = 0, 1, 2, 3, 4, 5


@kernel
def check(t: Tables, q: Array, qd: Array) -> int:
    """GOOD, NOT_FINITE, or COLLAPSED where a link is compressed to nothing (eps <= -1)."""
    for c in range(q.shape[0]):
        if not (math.isfinite(q[c]) and math.isfinite(qd[c])):
            return NOT_FINITE
    for i in range(t.length.shape[0]):
        column = t.columns[i, 0]
        if column >= 0 and q[column] <= -1.0:
            return COLLAPSED
    return GOOD


@kernel
def finite(x: Array) -> bool:
    """True where all entries are numbers."""
    good = True
    for i in range(x.shape[0]):
        good = good and math.isfinite(x[i])
    return good


@kernel
def inertia_matrix(t: Tables, q: Array, M: Array) -> None:
    """M <- inertia matrix (n_q, n_q)."""
    inertia(t, t.mass, t.tip_mass, q, M)


@kernel
def inertial_forces(
    t: Tables,
    masses: Array,
    tip_masses: Array,
    gravity: Array,
    q: Array,
    qd: Array,
    v: Array,
    a: Array,
    forces: Array,
) -> None:
    """forces[k] <- M a[k] + C(q, qd) v[k] + G with the masses of row k; all of shape (n_k, ...).

    One entry for everything linear: C by unit velocities without gravity, regressors by unit masses.
    """
    none = np.zeros(6)
    for k in range(forces.shape[0]):
        inverse_dynamics(t, masses[k], tip_masses[k], gravity, none, q, qd, v[k], a[k], forces[k])


@kernel
def pose_and_jacobian(t: Tables, q: Array, place: float, R: Array, p: Array, J: Array) -> None:
    """Pose (R, p) in the world and body Jacobian, transposed (n_q, 6)."""
    kinematics(t, q, place, R, p, J)


@kernel
def gravitational_energy(t: Tables, q: Array) -> float:
    """U_g [J], zero at the world's origin."""
    return potential(t, q)


@inner
def applied_force(t: Tables, q: Array, qd: Array, z: Array, pressure: Array, force: Array) -> None:
    """force <- H(q) p - dU_e/dq - R qd - internal."""
    elastic_force(t, q, force)
    add_internal_force(t, z, force)
    for b in range(q.shape[0]):
        force[b] = -force[b] - t.damping[b] * qd[b]
    add_pressure_force(t, q, pressure, force)


@kernel
def forward_dynamics(
    t: Tables, q: Array, qd: Array, z: Array, pressure: Array, wrench: Array, qdd: Array
) -> int:
    """qdd <- M^-1 (H p + J_tip' wrench - C qd - G - dU_e/dq - R qd - internal); gives a code."""
    code = check(t, q, qd)
    if code != GOOD:
        return code
    n_q = q.shape[0]
    M, bias = np.empty((n_q, n_q)), np.empty(n_q)
    zero = np.zeros(n_q)
    inertia(t, t.mass, t.tip_mass, q, M)
    inverse_dynamics(t, t.mass, t.tip_mass, t.gravity, wrench, q, qd, qd, zero, bias)
    applied_force(t, q, qd, z, pressure, qdd)
    for b in range(n_q):
        qdd[b] -= bias[b]
    if not cholesky_solve(M, qdd):
        return SINGULAR
    return GOOD if finite(qdd) else NOT_FINITE
