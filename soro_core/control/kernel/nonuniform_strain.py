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
from soro_core.model.records import Motion
from soro_core.model.tables import Tables
from soro_core.model.work import Work

# Coefficients of each strain: its mean along the link, and the slope.
TERMS = 2
# Increment for difference quotients of the forces, in units of q.
_STEP = 1e-6
# Largest difference of the strains from those of q, in units: a learner at its bound must not fold the arm.
_MOST = 2.0


class StrainedArm(NamedTuple):
    """An arm with one kind of strain, and the units of its coordinates (n,)."""

    tables: Tables
    work: Work
    unit: Array


class ArmPair(NamedTuple):
    """An arm with strains that are constant along its links (n), and with strains that vary (N)."""

    even: StrainedArm
    varying: StrainedArm


class Load(NamedTuple):
    """What acts on the arm: a mass at the tip beyond its own [kg], and pressures (n_u,) [Pa]."""

    mass_kg: float
    pressure: Array


class Ends(NamedTuple):
    """Ends of the links (n_ends,): where q has them and where x has them, and their derivatives."""

    wanted: Array
    found: Array
    by_q: Array
    by_x: Array


@kernel
def make_arm_pair(even: Tables, varying: Tables, unit: Array, varying_unit: Array) -> Box:
    """Both arms in a box, each with a workspace."""
    return Box(
        ArmPair(
            StrainedArm(even, make_work(even), unit), StrainedArm(varying, make_work(varying), varying_unit)
        )
    )


@inner
def force_residual(arm: StrainedArm, motion: Motion, load: Load, H: Array, force: Array) -> None:
    """force <- f + m Y - H p, H <- its transpose (n_u, n)."""
    t = arm.tables
    tip_mass = t.tip_mass[0] + load.mass_kg
    motion_forces(t, arm.work, tip_mass, motion, force, H)
    for u in range(load.pressure.shape[0]):
        for c in range(force.shape[0]):
            force[c] -= H[u, c] * load.pressure[u]


@inner
def _find_slope(arm: StrainedArm, motion: Motion, load: Load, now: Array, column: int, slope: Array) -> None:
    """Find a column of the slope of `force_residual` anew; all if it is negative."""
    q, unit = motion.q, arm.unit
    n = q.shape[0]
    moved, force, H = q.copy(), np.empty(n), np.empty((load.pressure.shape[0], n))
    for k in range(n):
        if column < 0 or k == column % n:
            moved[k] = q[k] + _STEP * unit[k]
            force_residual(arm, Motion(moved, motion.qd, motion.v, motion.a), load, H, force)
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
def _fill_system(pair: ArmPair, slope: Array, H: Array, P: Array, ends: Ends, square: Array) -> None:
    """square (N + n, N + n) <- the system of Newton; rows and columns in units.

    The ends count by the motion of q that they make.
    """
    unit, wide, by_q = pair.even.unit, pair.varying.unit, ends.by_q
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
                square[N + r, c] += unit[r] * by_q[e, r] * ends.by_x[e, c] * wide[c]


@inner
def _fill_right(pair: ArmPair, missed: Array, by_mass: Array, ends: Ends, right: Array) -> None:
    """right (N + n, 2 + n) <- what is missing, and its derivatives by the mass and by q."""
    unit, wide, by_q = pair.even.unit, pair.varying.unit, ends.by_q
    n, N = unit.shape[0], wide.shape[0]
    clear_matrix(right)
    for r in range(N):
        right[r, 0], right[r, 1] = -wide[r] * missed[r], -wide[r] * by_mass[r]
    for r in range(n):
        for e in range(ends.wanted.shape[0]):
            right[N + r, 0] += unit[r] * by_q[e, r] * (ends.wanted[e] - ends.found[e])
            for c in range(n):
                right[N + r, 2 + c] += unit[r] * by_q[e, r] * by_q[e, c]


@entry
def step(
    box: Box,
    motion: tuple[Array, Array, Array],
    mass_kg: float,
    column: int,
    shape: tuple[Array, Array, Array, Array, Array],
    out: tuple[Array, Array, Array],
) -> int:
    """Make one step; gives a code of `soro_core.model.dynamics`.

    `motion` has q, qd and qdd; `shape` deviation, force, moves and slopes of a `NonuniformStrainState`, which
    become those after the step; `column` < 0 at the first tick, which has no force and no slopes yet. out <-
    force, by_mass and by_q of the `NonuniformForce`.
    """
    pair = view(box)
    q, qd, qdd = motion
    deviation, force, moves, slope, even_slope = shape
    unmodelled, by_mass, by_q = out
    even, varying = pair.even, pair.varying
    unit, wide = even.unit, varying.unit
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
    own, by_load, now, wide_load = np.empty(n), np.empty(n), np.empty(N), np.empty(N)
    ends = Ends(np.empty(n_ends), np.empty(n_ends), np.empty((n_ends, n)), np.empty((n_ends, N)))
    even_motion, motion_x, load = Motion(q, qd, qd, qdd), Motion(x, xd, xd, xdd), Load(mass_kg, np.zeros(n_u))
    pressure = load.pressure
    force_residual(even, even_motion, load, here, own)
    tip_mass_force(even.tables, even.work, q, qd, qdd, by_load)
    link_ends(even.tables, even.work, ends.wanted, ends.by_q)
    if not _least_pressures(here, unit, P):
        return SINGULAR
    for c in range(n):
        if column < 0:
            force[c] = own[c]
        for u in range(n_u):
            pressure[u] += P[u, c] * force[c]
    force_residual(varying, motion_x, load, there, now)
    tip_mass_force(varying.tables, varying.work, x, xd, xdd, wide_load)
    link_ends(varying.tables, varying.work, ends.found, ends.by_x)
    _find_slope(varying, motion_x, load, now, column, slope)
    even_now = own.copy()
    for u in range(n_u):
        for c in range(n):
            even_now[c] -= here[u, c] * pressure[u]
    _find_slope(even, even_motion, load, even_now, column, even_slope)

    square, right, pivots = np.empty((N + n, N + n)), np.empty((N + n, 2 + n)), np.empty(N + n, np.int64)
    _fill_system(pair, slope, there, P, ends, square)
    _fill_right(pair, now, wide_load, ends, right)
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
        unmodelled[r], by_mass[r] = force[r] - own[r], right[N + r, 1] / unit[r] - by_load[r]
        for c in range(n):
            by_q[r, c] = right[N + r, 2 + c] / unit[r] - even_slope[r, c]
    return GOOD
