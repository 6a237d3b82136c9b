"""Kernels that join the terms: the equation of motion by either method, docs/model.md (11)."""

from __future__ import annotations

import math

import numpy as np

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.forces.chambers import actuation, add_pressure_force
from soro_core.model.forces.elasticity import elastic_force
from soro_core.model.forces.internal import add_internal_force
from soro_core.model.links.local import local_strain, n_samples
from soro_core.model.method import acceleration, motion_force
from soro_core.model.records import ArmState, Motion
from soro_core.model.tables import Tables
from soro_core.model.work import Work

# Codes of the kernels.
GOOD, NOT_FINITE, COLLAPSED, SINGULAR, NOT_CONVERGED, BAD_INPUT = 0, 1, 2, 3, 4, 5


@inner
def check(t: Tables, q: Array, qd: Array) -> int:
    """GOOD, NOT_FINITE, or COLLAPSED where a link is compressed to its least elongation or beyond."""
    for c in range(q.shape[0]):
        if not (math.isfinite(q[c]) and math.isfinite(qd[c])):
            return NOT_FINITE
    for i in range(t.length.shape[0]):
        if t.columns[i, 0, 0] == t.columns[i, 0, 1]:
            continue
        for k in range(n_samples(t, i)):
            if not local_strain(t, i, 0, k, q) > t.least[i]:
                return COLLAPSED
    return GOOD


@inner
def motion_forces(t: Tables, w: Work, tip_mass: float, motion: Motion, own: Array, gradients: Array) -> None:
    """own <- M a + C qd + G + dU_e/dq with this mass at the tip, gradients <- H' (n_u, n_q)."""
    motion_force(t, w, np.zeros(6), tip_mass, motion, own)
    q = motion.q
    elastic = np.empty(q.shape[0])
    elastic_force(t, q, elastic)
    for c in range(q.shape[0]):
        own[c] += elastic[c]
    actuation(t, q, gradients)


@inner
def finite(x: Array) -> bool:
    """True where all entries are numbers."""
    good = True
    for i in range(x.shape[0]):
        good = good and math.isfinite(x[i])
    return good


@inner
def add_damping_force(t: Tables, qd: Array, force: Array) -> None:
    """force += R qd."""
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            for d in range(t.offset[i + 1] - first):
                force[c] += t.damping[c, d] * qd[first + d]


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
def forward_dynamics(t: Tables, w: Work, at: ArmState, pressure: Array, wrench: Array, qdd: Array) -> int:
    """qdd <- M^-1 (H p + J_tip' wrench - C qd - G - dU_e/dq - R qd - internal); gives a code."""
    code = check(t, at.q, at.v)
    if code != GOOD:
        return code
    applied_force(t, at.q, at.v, at.z, pressure, w.applied)
    if not acceleration(t, w, wrench, at.q, at.v, qdd):
        return SINGULAR
    return GOOD if finite(qdd) else NOT_FINITE
