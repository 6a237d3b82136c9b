"""One step of Newton for the non-uniform strain (`soro_core.control.nonuniform_strain`), compiled.

With x the coordinates of strains that vary, f + m Y - H p what a force misses, and e(x) = e_1(q) the ends of
the links, the step solves for the changes of x and of the force F = H_1(q) p

    | slope    -H P      |  | dx |     | -(f + m Y - H p)  |
    | e_1q' e_x    0     |  | dF |  =  | e_1q' (e_1 - e)   |,    p = P F the least pressures of a force,

and, on the right of the same system, for their derivatives by m and by q.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core._box import Box, view
from soro_core._jit import entry, inner, kernel
from soro_core.arrays import Array
from soro_core.model.dynamics import GOOD, SINGULAR, check, motion_forces
from soro_core.model.exact import link_ends, tip_mass_force
from soro_core.model.links.linear import clear_matrix, lu_factor, lu_solve_rows
from soro_core.model.method import make_work
from soro_core.model.tables import Tables
from soro_core.model.work import Arm

# Coefficients of each strain: its mean along the link, and the slope.
TERMS = 2
# Increment for difference quotients of the forces, in units of q.
_STEP = 1e-6
# Largest difference of the strains from those of q, in units: a learner at its bound must not fold the arm.
_MOST = 2.0


class ArmPair(NamedTuple):
    """An arm with strains that are constant along its links, and with strains that vary."""

    even: Arm
    varying: Arm
    unit: Array
    """Units of the coordinates of the even arm (n,)."""
    varying_unit: Array
    """And of the varying one (N,)."""


@kernel
def make_arm_pair(even: Tables, varying: Tables, unit: Array, varying_unit: Array) -> Box:
    """Both arms in a box, each with a workspace."""
    return Box(ArmPair(Arm(even, make_work(even)), Arm(varying, make_work(varying)), unit, varying_unit))


@inner
def force_residual(
    arm: Arm, mass_kg: float, q: Array, qd: Array, qdd: Array, pressure: Array, H: Array, force: Array
) -> None:
    """force <- f + m Y - H p, H <- its transpose (n_u, n)."""
    motion_forces(arm.tables, arm.work, arm.tables.tip_mass[0] + mass_kg, q, qd, qdd, force, H)
    for u in range(pressure.shape[0]):
        for c in range(q.shape[0]):
            force[c] -= H[u, c] * pressure[u]


@inner
def _find_slope(
    arm: Arm,
    unit: Array,
    mass_kg: float,
    q: Array,
    qd: Array,
    qdd: Array,
    pressure: Array,
    now: Array,
    column: int,
    slope: Array,
) -> None:
    """Find a column of the slope of `force_residual` anew; all if it is negative."""
    n = q.shape[0]
    moved, force, H = q.copy(), np.empty(n), np.empty((pressure.shape[0], n))
    for k in range(n):
        if column < 0 or k == column % n:
            moved[k] = q[k] + _STEP * unit[k]
            force_residual(arm, mass_kg, moved, qd, qdd, pressure, H, force)
            moved[k] = q[k]
            for c in range(n):
                slope[c, k] = (force[c] - now[c]) / (_STEP * unit[k])


@inner
def _least_pressures(H: Array, unit: Array, P: Array) -> bool:
    """P (n_u, n) <- least pressures by the force that they make; False if they do not make each force."""
    n, n_u = unit.shape[0], H.shape[0]
    square, right, pivots = np.empty((n, n)), np.zeros((n, n)), np.empty(n, np.int64)
    for a in range(n):
        right[a, a] = unit[a]
        for b in range(n):
            square[a, b] = 0.0
            for u in range(n_u):
                square[a, b] += unit[a] * H[u, a] * H[u, b] * unit[b]
    if not lu_factor(square, pivots):
        return False
    lu_solve_rows(square, pivots, right)
    for u in range(n_u):
        for b in range(n):
            P[u, b] = 0.0
            for a in range(n):
                P[u, b] += unit[a] * H[u, a] * right[a, b]
    return True


@inner
def _fill_system(
    unit: Array, wide: Array, slope: Array, H: Array, P: Array, by_q: Array, by_x: Array, square: Array
) -> None:
    """square (N + n, N + n) <- the system of Newton; rows and columns in units.

    The ends count by the motion of q that they make.
    """
    n, N = unit.shape[0], wide.shape[0]
    clear_matrix(square)
    for r in range(N):
        for c in range(N):
            square[r, c] = wide[r] * slope[r, c] * wide[c]
        for c in range(n):
            for u in range(H.shape[0]):
                square[r, N + c] -= wide[r] * H[u, r] * P[u, c] / unit[c]
    for r in range(n):
        for c in range(N):
            for e in range(by_q.shape[0]):
                square[N + r, c] += unit[r] * by_q[e, r] * by_x[e, c] * wide[c]


@inner
def _fill_right(
    unit: Array,
    wide: Array,
    missed: Array,
    load: Array,
    by_q: Array,
    wanted: Array,
    found: Array,
    right: Array,
) -> None:
    """right (N + n, 2 + n) <- what is missing, and its derivatives by the mass and by q."""
    n, N = unit.shape[0], wide.shape[0]
    clear_matrix(right)
    for r in range(N):
        right[r, 0], right[r, 1] = -wide[r] * missed[r], -wide[r] * load[r]
    for r in range(n):
        for e in range(wanted.shape[0]):
            right[N + r, 0] += unit[r] * by_q[e, r] * (wanted[e] - found[e])
            for c in range(n):
                right[N + r, 2 + c] += unit[r] * by_q[e, r] * by_q[e, c]


@entry
def step(
    box: Box,
    q: Array,
    qd: Array,
    qdd: Array,
    mass_kg: float,
    column: int,
    deviation: Array,
    force: Array,
    moves: Array,
    slope: Array,
    even_slope: Array,
    unmodelled: Array,
    by_mass: Array,
    by_q: Array,
) -> int:
    """Make one step; gives a code of `soro_core.model.dynamics`.

    `deviation`, `force`, `moves` and the slopes are the state, and become that after the step; `column` < 0
    at the first tick, which has no force and no slopes yet. unmodelled, by_mass, by_q <- `NonuniformForce`.
    """
    bend = view(box)
    even, varying, unit, wide = bend.even, bend.varying, bend.unit, bend.varying_unit
    n, N, n_u = q.shape[0], wide.shape[0], even.tables.axial_gain.shape[1]
    n_ends = 3 * even.tables.length.shape[0]
    x, xd, xdd = deviation.copy(), np.zeros(N), np.zeros(N)
    for i in range(n):
        x[TERMS * i] += q[i]
    for r in range(N):
        for c in range(n):
            xd[r] += moves[r, c] * qd[c]
            xdd[r] += moves[r, c] * qdd[c]
    code = check(even.tables, q, qd)
    if code == GOOD:
        code = check(varying.tables, x, xd)
    if code != GOOD:
        return code

    here, there, P = np.empty((n_u, n)), np.empty((n_u, N)), np.empty((n_u, n))
    own, load, now, wide_load = np.empty(n), np.empty(n), np.empty(N), np.empty(N)
    wanted, found = np.empty(n_ends), np.empty(n_ends)
    ends_by_q, ends_by_x = np.empty((n_ends, n)), np.empty((n_ends, N))
    pressure = np.zeros(n_u)
    force_residual(even, mass_kg, q, qd, qdd, pressure, here, own)
    tip_mass_force(even.tables, even.work, q, qd, qdd, load)
    link_ends(even.tables, even.work, wanted, ends_by_q)
    if not _least_pressures(here, unit, P):
        return SINGULAR
    for c in range(n):
        if column < 0:
            force[c] = own[c]
        for u in range(n_u):
            pressure[u] += P[u, c] * force[c]
    force_residual(varying, mass_kg, x, xd, xdd, pressure, there, now)
    tip_mass_force(varying.tables, varying.work, x, xd, xdd, wide_load)
    link_ends(varying.tables, varying.work, found, ends_by_x)
    _find_slope(varying, wide, mass_kg, x, xd, xdd, pressure, now, column, slope)
    even_now = own.copy()
    for u in range(n_u):
        for c in range(n):
            even_now[c] -= here[u, c] * pressure[u]
    _find_slope(even, unit, mass_kg, q, qd, qdd, pressure, even_now, column, even_slope)

    square, right, pivots = np.empty((N + n, N + n)), np.empty((N + n, 2 + n)), np.empty(N + n, np.int64)
    _fill_system(unit, wide, slope, there, P, ends_by_q, ends_by_x, square)
    _fill_right(unit, wide, now, wide_load, ends_by_q, wanted, found, right)
    if not lu_factor(square, pivots):
        return SINGULAR
    lu_solve_rows(square, pivots, right)

    for r in range(N):
        most = _MOST * wide[r]
        deviation[r] = min(max(deviation[r] + wide[r] * right[r, 0], -most), most)
        for c in range(n):
            moves[r, c] = wide[r] * right[r, 2 + c]
    for r in range(n):
        force[r] += right[N + r, 0] / unit[r]
        unmodelled[r], by_mass[r] = force[r] - own[r], right[N + r, 1] / unit[r] - load[r]
        for c in range(n):
            by_q[r, c] = right[N + r, 2 + c] / unit[r] - even_slope[r, c]
    return GOOD
