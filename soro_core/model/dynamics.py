"""Kernels that join the terms: the equation of motion by either method (theory.md section 3)."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import Box, entry, inner, kernel
from soro_core.model.chambers import add_pressure_force
from soro_core.model.elasticity import elastic_force
from soro_core.model.internal import add_internal_force
from soro_core.model.linear import clear
from soro_core.model.method import (
    acceleration,
    inertia,
    inverse_dynamics,
    kinematics,
    make_work,
    potential,
)
from soro_core.model.tables import Site, Tables
from soro_core.model.work import Work

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
        first, behind = t.columns[i, 0, 0], t.columns[i, 0, 1]
        if first == behind:
            continue
        for k in range(t.nodes.shape[0] if t.varying[i] else 1):
            stretch = 1.0
            for c in range(first, behind):
                stretch += t.shape_node[c, k] * q[c]
            if not stretch > 0.0:
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
def make_box(t: Tables) -> Box:
    """Tables and workspace of an arm for the entries below: one object instead of forty arrays a call."""
    return Box(t, make_work(t))


@entry
def inertia_matrix(box: Box, q: Array, M: Array) -> None:
    """M <- inertia matrix (n_q, n_q)."""
    t, w = box.tables, box.work
    inertia(t, w, t.mass, t.tip_mass, q, M)


@entry
def inertial_forces(
    box: Box,
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
    t, w = box.tables, box.work
    none = np.zeros(6)
    for k in range(forces.shape[0]):
        inverse_dynamics(t, w, masses[k], tip_masses[k], gravity, none, q, qd, v[k], a[k], forces[k])


@entry
def pose_and_jacobian(box: Box, site: Site, q: Array, R: Array, p: Array, J: Array) -> None:
    """Pose (R, p) in the world and body Jacobian, transposed (n_q, 6)."""
    kinematics(box.tables, box.work, site, q, R, p, J)


@entry
def gravitational_energy(box: Box, q: Array) -> float:
    """U_g [J], zero at the world's origin."""
    return potential(box.tables, box.work, q)


@entry
def accelerations(box: Box, q: Array, qd: Array, z: Array, pressure: Array, wrench: Array, qdd: Array) -> int:
    """`forward_dynamics` for a caller in Python."""
    return forward_dynamics(box.tables, box.work, q, qd, z, pressure, wrench, qdd)


@inner
def add_damping_force(t: Tables, qd: Array, force: Array) -> None:
    """force += R qd."""
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            for d in range(t.offset[i + 1] - first):
                force[c] += t.damping[c, d] * qd[first + d]


@kernel
def damping_force(t: Tables, qd: Array, force: Array) -> None:
    """force <- R qd."""
    clear(force)
    add_damping_force(t, qd, force)


@inner
def applied_force(t: Tables, q: Array, qd: Array, z: Array, pressure: Array, force: Array) -> None:
    """force <- H(q) p - dU_e/dq - R qd - internal."""
    elastic_force(t, q, force)
    add_internal_force(t, z, force)
    add_damping_force(t, qd, force)
    for b in range(q.shape[0]):
        force[b] = -force[b]
    add_pressure_force(t, q, pressure, force)


@inner
def forward_dynamics(
    t: Tables, w: Work, q: Array, qd: Array, z: Array, pressure: Array, wrench: Array, qdd: Array
) -> int:
    """qdd <- M^-1 (H p + J_tip' wrench - C qd - G - dU_e/dq - R qd - internal); gives a code."""
    code = check(t, q, qd)
    if code != GOOD:
        return code
    force = w.rows[2]
    applied_force(t, q, qd, z, pressure, force)
    if not acceleration(t, w, wrench, q, qd, force, qdd):
        return SINGULAR
    return GOOD if finite(qdd) else NOT_FINITE
