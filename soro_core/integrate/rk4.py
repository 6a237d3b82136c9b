"""Explicit Runge-Kutta of order 4: for soft arms; with a stiff one it diverges and says so."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._box import Box, view
from soro_core._jit import inner, kernel
from soro_core.model.dynamics import BAD_INPUT, GOOD, NOT_FINITE, check, finite, forward_dynamics
from soro_core.model.internal import internal_rate
from soro_core.model.linear import assign
from soro_core.model.tables import Tables
from soro_core.model.work import Work

Array: TypeAlias = NDArray[np.float64]


@inner
def rk4_step(
    t: Tables,
    work: Work,
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
    """One step; `pressure` (3, n_u) at its start, middle and end. Writes the new state, says how it went."""
    n_q, n_z = q0.shape[0], z0.shape[0]
    q, v, z = q0.copy(), v0.copy(), z0.copy()
    a, rate = np.empty(n_q), np.empty(n_z)
    if not (finite(pressure[0]) and finite(pressure[1]) and finite(pressure[2]) and finite(wrench)):
        return BAD_INPUT
    assign(q0, q1)
    assign(v0, v1)
    assign(z0, z1)
    for stage in range(4):
        code = forward_dynamics(t, work, q, v, z, pressure[(stage + 1) // 2], wrench, a)
        if code != GOOD:
            return code
        internal_rate(t, v, z, rate)
        weight = h / 6.0 if stage in (0, 3) else h / 3.0
        ahead = 0.5 * h if stage < 2 else h
        for b in range(n_q):
            q1[b] += weight * v[b]
            v1[b] += weight * a[b]
            q[b] = q0[b] + ahead * v[b]
            v[b] = v0[b] + ahead * a[b]
        for j in range(n_z):
            z1[j] += weight * rate[j]
            z[j] = z0[j] + ahead * rate[j]
    code = check(t, q1, v1)
    return code if code != GOOD or finite(z1) else NOT_FINITE


@kernel
def rk4_run(
    box: Box, system_box: Box, times: Array, pressure: Array, wrench: Array, q: Array, v: Array, z: Array
) -> tuple[int, int]:
    """Fill q, v, z (n_t, ...) from their first rows; pressure (n_t, 3, n_u). Gives (last good row, code)."""
    arm = view(box)
    t, work = arm.tables, arm.work
    for k in range(times.shape[0] - 1):
        h = times[k + 1] - times[k]
        code = rk4_step(t, work, q[k], v[k], z[k], pressure[k], wrench, h, q[k + 1], v[k + 1], z[k + 1])
        if code != GOOD:
            return k, code
    return times.shape[0] - 1, GOOD
