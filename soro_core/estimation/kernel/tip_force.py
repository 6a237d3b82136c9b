"""Rest of a finer arm whose tip is where it is measured, and the force there that brings it to it, compiled.

With x the coordinates of the finer arm, f what its motion, weight and elasticity ask for less what pressures
and the learned force give, F the force at the tip and p the position of the measured place, a step solves

    | df/dx   -J_tip' |  | dx |     | -(f - J_tip' F)  |
    | J_place    0    |  | dF |  =  | measured - p(x)  |

and, on the right of the same system, for the derivatives of F (`soro_core.estimation.force.tip_balance`).
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from soro_core._box import Box, view
from soro_core._jit import entry, inner, kernel
from soro_core.arrays import Array
from soro_core.model.derivative.equation import equation_derivatives
from soro_core.model.derivative.work import BY_Q, DerivativeWork, derivative_workspace
from soro_core.model.dynamics import GOOD, NOT_FINITE, SINGULAR, check, motion_forces
from soro_core.model.forces.chambers import acting
from soro_core.model.links.linear import clear_matrix, lu_factor, lu_solve_rows
from soro_core.model.method import kinematics, make_work
from soro_core.model.records import CrossSection, Motion
from soro_core.model.tables import Site, Tables
from soro_core.model.work import Work

# Largest change of a strain in a step, in units of q: a force that comes at once must not fold the arm.
_MOST = 0.5


class FineArm(NamedTuple):
    """An arm of N coordinates whose mean along each piece of a coarse one are the n coordinates of that."""

    tables: Tables
    work: Work
    room: DerivativeWork
    mean: Array
    """(n, N)."""
    spread: Array
    """(N, n), uniform along each piece."""
    force_unit: Array
    """Units of the learned force, (n,)."""
    q_unit: Array
    tip_mass: float
    """That of the robot file [kg]."""


class TipKnown(NamedTuple):
    """What the arm is measured and known to do, after one low-pass."""

    position: Array
    """(3,)."""
    pressure: Array
    """(n_u,)."""
    qd: Array
    """(n,)."""
    qdd: Array
    force: Array
    """Other generalised force on the left-hand side, (n,)."""
    theta: Array
    """Learned mass at the tip [kg] and W."""


TipFields: TypeAlias = tuple[Array, Array, Array, Array, Array, Array]
"""Fields of a `TipKnown`: numba takes a plain tuple from Python faster."""


@kernel
def make_fine_arm(
    t: Tables, mean: Array, spread: Array, force_unit: Array, q_unit: Array, tip_mass: float
) -> Box:
    """The arm in a box, with its workspaces."""
    return Box(FineArm(t, make_work(t), derivative_workspace(t), mean, spread, force_unit, q_unit, tip_mass))


@inner
def _world_columns(arm: FineArm, site: Site, x: Array, p: Array, columns: Array) -> None:
    """p <- position of a place in the world, columns (N, 3) <- its derivative by each coordinate."""
    R, J = np.empty((3, 3)), np.empty((x.shape[0], 6))
    kinematics(arm.tables, arm.work, site, x, CrossSection(R, p, J))
    for c in range(x.shape[0]):
        for r in range(3):
            columns[c, r] = 0.0
            for k in range(3):
                columns[c, r] += R[r, k] * J[c, 3 + k]


@inner
def _learned(arm: FineArm, theta: Array, x: Array, force: Array, K: Array) -> None:
    """force (N,) += U W phi, K += its derivative.

    The strain of a piece meets its own learned stiffness (the diagonal of W), as it meets that of the file;
    all else is that of the mean coordinates.
    """
    n, N = arm.mean.shape
    for a in range(n):
        row = 1 + a * (n + 1)
        value, own = theta[row], theta[row + 1 + a] / arm.q_unit[a]
        for b in range(n):
            q = 0.0
            for c in range(N):
                q += arm.mean[b, c] * x[c]
            value += theta[row + 1 + b] * q / arm.q_unit[b]
            if b == a:
                value -= own * q
        for r in range(N):
            part = arm.mean[a, r] * arm.force_unit[a]
            if part != 0.0:
                force[r] += part * (value + own * x[r])
                K[r, r] += part * own
                for b in range(n):
                    if b != a:
                        slope = part * theta[row + 1 + b] / arm.q_unit[b]
                        for c in range(N):
                            K[r, c] += slope * arm.mean[b, c]


@entry
def step(
    box: Box,
    sites: tuple[tuple[int, float, int, float, Array, Array], tuple[int, float, int, float, Array, Array]],
    fields: TipFields,
    steps: int,
    shape: tuple[Array, Array],
    out: tuple[Array, Array, Array],
) -> int:
    """Make steps of Newton; gives a code of `soro_core.model.dynamics`.

    `sites`: the tip, and the place whose position is measured. `shape`: x (N,) and F (3,), which become those
    after the steps. out <- derivatives of F by the position (3, 3), by a generalised force of the coarse arm
    on the left-hand side (3, n), and by the pressures (3, n_u).
    """
    arm, known = view(box), TipKnown(*fields)
    tip, place, theta = Site(*sites[0]), Site(*sites[1]), known.theta
    x, F = shape
    by_position, by_force, by_pressure = out
    t = arm.tables
    n, N = arm.mean.shape
    n_u = known.pressure.shape[0]
    xd, xdd, unit = np.zeros(N), np.zeros(N), np.zeros(N)
    for r in range(N):
        for c in range(n):
            xd[r] += arm.spread[r, c] * known.qd[c]
            xdd[r] += arm.spread[r, c] * known.qdd[c]
            unit[r] += arm.spread[r, c] * arm.q_unit[c]
    t.tip_mass[0] = arm.tip_mass + theta[0]
    wrench = np.zeros(6)
    f, H, p, q = np.empty(N), np.empty((n_u, N)), np.empty(3), np.empty(3)
    at_tip, at_place, K = np.empty((N, 3)), np.empty((N, 3)), np.empty((N, N))
    width = 4 + n + n_u
    A, B, pivots = np.empty((N + 3, N + 3)), np.empty((N + 3, width)), np.empty(N + 3, np.int64)
    for _ in range(steps):
        code = check(t, x, xd)
        if code != GOOD:
            return code
        motion = Motion(x, xd, xd, xdd)
        motion_forces(t, arm.work, t.tip_mass[0], motion, f, H)
        equation_derivatives(t, arm.room, known.pressure, wrench, motion)
        for r in range(N):
            for c in range(N):
                K[r, c] = arm.room.equation[BY_Q, r, c]
            for a in range(n):
                f[r] += arm.mean[a, r] * known.force[a]
            for u in range(n_u):
                f[r] -= H[u, r] * acting(t, u, known.pressure[u])
        _learned(arm, theta, x, f, K)
        _world_columns(arm, tip, x, q, at_tip)
        _world_columns(arm, place, x, p, at_place)
        clear_matrix(A)
        clear_matrix(B)
        for r in range(N):
            B[r, 0] = -unit[r] * f[r]
            for c in range(N):
                A[r, c] = unit[r] * K[r, c] * unit[c]
            for k in range(3):
                A[r, N + k] = -unit[r] * at_tip[r, k]
                A[N + k, r] = at_place[r, k] * unit[r]
                B[r, 0] += unit[r] * at_tip[r, k] * F[k]
            for a in range(n):
                B[r, 4 + a] = -unit[r] * arm.mean[a, r]
            for u in range(n_u):
                B[r, 4 + n + u] = unit[r] * arm.room.actuation[r, u]
        for k in range(3):
            B[N + k, 0] = known.position[k] - p[k]
            B[N + k, 1 + k] = 1.0
        if not lu_factor(A, pivots):
            return SINGULAR
        lu_solve_rows(A, pivots, B)
        largest = 0.0
        for r in range(N):
            largest = max(largest, abs(B[r, 0]))
        part = min(1.0, _MOST / largest) if largest > 0.0 else 1.0
        total = 0.0
        for r in range(N):
            x[r] += part * unit[r] * B[r, 0]
            total += x[r]
        for k in range(3):
            F[k] += part * B[N + k, 0]
            total += F[k]
        if not math.isfinite(total):
            return NOT_FINITE
    for k in range(3):
        for c in range(3):
            by_position[k, c] = B[N + k, 1 + c]
        for a in range(n):
            by_force[k, a] = B[N + k, 4 + a]
        for u in range(n_u):
            by_pressure[k, u] = B[N + k, 4 + n + u]
    return GOOD
