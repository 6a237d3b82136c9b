"""Implicit trapezoidal rule, Newton with the approximate Hessian of [C22, App. C].

Unknown is the velocity at the end: q1 = q0 + h (v0 + v1) / 2, a1 = 2 (v1 - v0) / h - a0, and the residual
is the equation of motion there. Its Jacobian keeps inertia, damping, stiffness and the internal states,
and leaves out the derivatives of M, C and G, which a step small enough to be accurate keeps small.
Internal states follow the same linear velocity exactly (`soro_core.model.internal`), however stiff.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._box import Box, view
from soro_core._jit import inner, kernel
from soro_core.model.chambers import add_pressure_stiffness
from soro_core.model.dynamics import (
    BAD_INPUT,
    GOOD,
    NOT_CONVERGED,
    NOT_FINITE,
    SINGULAR,
    applied_force,
    check,
    finite,
    forward_dynamics,
)
from soro_core.model.elasticity import add_stiffness
from soro_core.model.internal import advance_internal
from soro_core.model.method import factor_system, inverse_dynamics, solve_system
from soro_core.model.tables import Tables
from soro_core.model.work import Work

Array: TypeAlias = NDArray[np.float64]

MAX_ITERATIONS = 30
# Largest error left in q, of its scale (1 for strains, 1 / L for curvatures).
TOLERANCE = 1e-11
# A contraction slower than this is worth a new Jacobian.
SLOW = 0.2


@inner
def jacobian(t: Tables, w: Work, q: Array, pressure: Array, h: float, tangent: Array) -> bool:
    """Factor M + h/2 R + h^2/4 d2U_e/dq2 + h/2 tangent."""
    for b in range(q.shape[0]):
        for d in range(w.block.shape[1]):
            w.block[b, d] = 0.5 * h * t.damping[b, d]
    add_stiffness(t, q, 0.25 * h * h, w.block)
    add_pressure_stiffness(t, q, pressure, 0.25 * h * h, w.block)
    for i in range(t.length.shape[0]):
        for j in range(tangent.shape[0]):
            c = t.internal_coordinate[j]
            if t.offset[i] <= c < t.offset[i + 1]:
                w.block[c, c - t.offset[i]] += 0.5 * h * tangent[j]
    return factor_system(t, w, q)


@inner
def trapezoidal_step(
    t: Tables,
    w: Work,
    system: Work,
    q0: Array,
    v0: Array,
    z0: Array,
    pressure: Array,
    wrench: Array,
    h: float,
    q1: Array,
    v1: Array,
    z1: Array,
) -> int:
    """One step; `pressure` (3, n_u) at start, middle (unused) and end. Writes the new state, gives a code.

    `system` keeps the factors, with the frames that they belong to, while `w` goes on to other states.
    """
    n_q = q0.shape[0]
    a0, a1, r, f = np.empty(n_q), np.empty(n_q), np.empty(n_q), np.empty(n_q)
    tangent = np.empty(z0.shape[0])
    if not (finite(pressure[0]) and finite(pressure[2]) and finite(wrench)):
        return BAD_INPUT
    code = forward_dynamics(t, w, q0, v0, z0, pressure[0], wrench, a0)
    if code != GOOD:
        return code
    for b in range(n_q):
        v1[b] = v0[b]
    factored = False
    before = math.inf
    for _ in range(MAX_ITERATIONS):
        for b in range(n_q):
            q1[b] = q0[b] + 0.5 * h * (v0[b] + v1[b])
            a1[b] = 2.0 / h * (v1[b] - v0[b]) - a0[b]
        code = check(t, q1, v1)
        if code != GOOD:
            return code
        advance_internal(t, z0, v0, v1, h, z1, tangent)
        inverse_dynamics(t, w, t.mass, t.tip_mass, t.gravity, wrench, q1, v1, v1, a1, r)
        applied_force(t, q1, v1, z1, pressure[2], f)
        for b in range(n_q):
            r[b] = f[b] - r[b]
        if not factored:
            if not jacobian(t, system, q1, pressure[2], h, tangent):
                return SINGULAR
            factored = True
        for b in range(n_q):
            r[b] *= 0.5 * h
        solve_system(t, system, r)
        if not finite(r):
            return NOT_FINITE
        change = 0.0
        for i in range(t.length.shape[0]):
            for b in range(t.offset[i], t.offset[i + 1]):
                angular = t.basis[b, 0] != 0.0 or t.basis[b, 1] != 0.0 or t.basis[b, 2] != 0.0
                change = max(change, abs(0.5 * h * r[b]) * (t.length[i] if angular else 1.0))
        for b in range(n_q):
            v1[b] += r[b]
        rate = change / before
        # Converging linearly, the error left is about change * rate / (1 - rate).
        left = change * rate / (1.0 - rate) if 0.0 < rate < 1.0 else change
        if left < TOLERANCE:
            for b in range(n_q):
                q1[b] = q0[b] + 0.5 * h * (v0[b] + v1[b])
            advance_internal(t, z0, v0, v1, h, z1, tangent)
            code = check(t, q1, v1)
            return code if code != GOOD or finite(z1) else NOT_FINITE
        if rate > SLOW and before < math.inf:
            factored = False
        before = change
    return NOT_CONVERGED


@kernel
def trapezoidal_run(
    box: Box, system_box: Box, times: Array, pressure: Array, wrench: Array, q: Array, v: Array, z: Array
) -> tuple[int, int]:
    """Fill q, v, z (n_t, ...) from their first rows; pressure (n_t, 3, n_u). Gives (last good row, code)."""
    arm = view(box)
    t, w, system = arm.tables, arm.work, view(system_box).work
    for k in range(times.shape[0] - 1):
        h = times[k + 1] - times[k]
        code = trapezoidal_step(
            t, w, system, q[k], v[k], z[k], pressure[k], wrench, h, q[k + 1], v[k + 1], z[k + 1]
        )
        if code != GOOD:
            return k, code
    return times.shape[0] - 1, GOOD
