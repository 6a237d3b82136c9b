"""From one rest of an arm to another along a line in its pressures, clear of obstacles, docs/motion.md."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soro_core._box import Box, view
from soro_core._jit import entry, inner
from soro_core.arrays import Array, Integers
from soro_core.model.derivative.equation import equation_derivatives
from soro_core.model.derivative.work import BY_Q, DerivativeWork
from soro_core.model.dynamics import GOOD, check, motion_forces
from soro_core.model.forces.chambers import acting
from soro_core.model.links.articulated import cholesky
from soro_core.model.links.linear import assign, assign_matrix
from soro_core.model.method import kinematics
from soro_core.model.records import CrossSection, Motion
from soro_core.model.tables import Site, Tables
from soro_core.model.work import Work

# Largest weighted change of a last step of Newton; steps with one stiffness, and in all.
TOLERANCE, WITH_ONE, MOST = 1e-7, 4, 16


class Surroundings(NamedTuple):
    """Places along an arm and obstacles, as the kernel reads them."""

    link: Integers
    place: Array
    whole: Integers
    step: Array
    shape: Array
    rest: Array
    """Those of `Site`, a row each of m places."""
    radius: Array
    """Of the section there [m], (m,)."""
    planes: Array
    spheres: Array
    """As in `Obstacles`: (n, 6) and (k, 4)."""
    limit: Array
    """Largest absolute coordinates, (n_q,)."""
    weight: Array
    """What makes a strain of each coordinate, (n_q,)."""


@inner
def _substitute(A: Array, x: Array) -> None:
    """x <- A^-1 x with the factor of `cholesky`."""
    n = x.shape[0]
    for i in range(n):
        for k in range(i):
            x[i] -= A[i, k] * x[k]
        x[i] *= A[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= A[k, i] * x[k]
        x[i] *= A[i, i]


@inner
def _missing(t: Tables, w: Work, rest: Motion, p: Array, gradients: Array, force: Array) -> None:
    """force <- G + dU_e/dq - H p."""
    motion_forces(t, w, t.tip_mass[0], rest, force, gradients)
    for u in range(p.shape[0]):
        pressure = acting(t, u, p[u])
        for c in range(force.shape[0]):
            force[c] -= gradients[u, c] * pressure


@inner
def _stiffness(t: Tables, d: DerivativeWork, none: Array, q: Array, p: Array, factor: Array) -> bool:
    """factor <- that of the stiffness at rest; False where it is not positive definite: no stable rest."""
    equation_derivatives(t, d, p, np.zeros(6), Motion(q, none, none, none))
    assign_matrix(d.equation[BY_Q], factor)
    return cholesky(q.shape[0], factor)


@inner
def _nearest(s: Surroundings, places: Array, before: Array) -> float:
    """Least clearance of the places (m, 3), less what it may be since those before."""
    least = math.inf
    for k in range(places.shape[0]):
        x, y, z = places[k, 0], places[k, 1], places[k, 2]
        moved = (x - before[k, 0]) ** 2 + (y - before[k, 1]) ** 2 + (z - before[k, 2]) ** 2
        for o in range(s.planes.shape[0]):
            n = s.planes[o]
            height = (x - n[0]) * n[3] + (y - n[1]) * n[4] + (z - n[2]) * n[5]
            least = min(least, height - s.radius[k])
        for o in range(s.spheres.shape[0]):
            c = s.spheres[o]
            distance = math.sqrt((x - c[0]) ** 2 + (y - c[1]) ** 2 + (z - c[2]) ** 2)
            around = s.radius[k] + c[3]
            # Half a motion beside its nearest point, a ball is farther by this.
            between = moved / (8.0 * around)
            least = min(least, distance - around - between)
    return least


@entry
def walk(
    box: Box,
    room: Box,
    s: Surroundings,
    line: tuple[Array, Array],
    margin_m: float,
    rows: tuple[Array, Array, Array],
) -> int:
    """Follow the rest of the arm in even steps along a line in pressures; gives how many are clear.

    `line`: pressures at the begin, and their change in a step, (n_u,) [Pa]. `rows`: coordinates (n + 1, n_q),
    the first near the rest at the begin; positions (n + 1, m, 3); clearances (n + 1,). The first row is
    filled as it is, whatever its clearance; -1 if there is no stable rest.
    """
    arm, d = view(box), view(room)
    t, w = arm.tables, arm.work
    begin, change = line
    Q, X, clearance = rows
    n_q, n_u = Q.shape[1], begin.shape[0]
    none, force, p = np.zeros(n_q), np.empty(n_q), np.empty(n_u)
    factor, gradients = np.empty((n_q, n_q)), np.empty((n_u, n_q))
    R, J = np.empty((3, 3)), np.empty((n_q, 6))
    q = Q[0].copy()
    for k in range(Q.shape[0]):
        for u in range(n_u):
            p[u] = begin[u] + k * change[u]
        if k == 0 and not _stiffness(t, d, none, q, p, factor):
            return -1
        moved = math.inf
        for i in range(MOST):
            # The first step, with the stiffness of the rest before, is the change by the pressures.
            if i % WITH_ONE == 1 and not _stiffness(t, d, none, q, p, factor):
                return k - 1
            _missing(t, w, Motion(q, none, none, none), p, gradients, force)
            _substitute(factor, force)
            moved = 0.0
            for c in range(n_q):
                q[c] -= force[c]
                moved = max(moved, abs(force[c]) * s.weight[c])
            if not moved < 1.0 or check(t, q, none) != GOOD:  # NaN too
                return k - 1
            if moved < TOLERANCE and i > 0:
                break
        if not moved < TOLERANCE:
            return k - 1
        for c in range(n_q):
            if not abs(q[c]) <= s.limit[c] and k > 0:
                return k - 1
        for m in range(s.link.shape[0]):
            site = Site(s.link[m], s.place[m], s.whole[m], s.step[m], s.shape[m], s.rest[m])
            kinematics(t, w, site, q, CrossSection(R, X[k, m], J))
        assign(q, Q[k])
        clearance[k] = _nearest(s, X[k], X[max(k - 1, 0)])
        if k > 0 and not clearance[k] >= margin_m:
            return k - 1
    last: int = Q.shape[0] - 1
    return last
