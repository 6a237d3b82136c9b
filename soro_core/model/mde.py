"""Kernels of the method `mde`: the matrix differential equation of [C22, 3.25-3.34], explicit second-order
Ralston.

The state (Phi, p, B1, B2, M, C, G) is integrated along the backbone with n steps a link; with the
corrections of theory.md: Jdot keeps the term -ad_V J, G takes the linear rows of the body Jacobian, its
sign is that of dU_g/dq.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import inner
from soro_core.model.lie import add_ad, add_coad, dot6, to_body, to_parent
from soro_core.model.linear import (
    assign,
    assign_matrix,
    cholesky_solve,
    clear,
    clear_matrix,
    lu_factor,
    lu_solve,
)
from soro_core.model.magnus import strain_at
from soro_core.model.sweep import NO
from soro_core.model.tables import Site, Tables
from soro_core.model.work import Work

Array: TypeAlias = NDArray[np.float64]


@inner
def _frame_rates(xi: Array, R: Array, R_rate: Array, p_rate: Array) -> None:
    """Phi' = Phi [Gamma]x, p' = Phi U [C22, 3.6-3.7]."""
    x, y, z = xi[0], xi[1], xi[2]
    for r in range(3):
        a, b, c = R[r, 0], R[r, 1], R[r, 2]
        R_rate[r, 0] = b * z - c * y
        R_rate[r, 1] = c * x - a * z
        R_rate[r, 2] = a * y - b * x
        p_rate[r] = a * xi[3] + b * xi[4] + c * xi[5]


@inner
def _body_columns(
    n: int, qd: Array, R: Array, p: Array, B1: Array, B2: Array, J: Array, Jd: Array, V: Array
) -> None:
    """J = Ad_g^-1 B1, V = J qd, Jdot = -ad_V J + Ad_g^-1 B2 for the first n coordinates."""
    clear(V)
    for b in range(n):
        for r in range(6):
            J[b, r] = B1[b, r]
            Jd[b, r] = B2[b, r]
        to_body(R, p, J[b])
        to_body(R, p, Jd[b])
        for r in range(6):
            V[r] += J[b, r] * qd[b]
    for b in range(n):
        add_ad(V, J[b], -1.0, Jd[b])


@inner
def _accumulate(
    n: int,
    dm: float,
    k2: float,
    gravity: Array,
    R: Array,
    J: Array,
    Jd: Array,
    V: Array,
    work: Array,
    M: Array,
    C: Array,
    G: Array,
) -> None:
    """M, C, G += those of a slice of mass dm: J' Mcal J, J' (Mcal Jdot + C_V J), -J_v' Phi' gamma dm."""
    momentum, force, column = work[0], work[1], work[2]
    for b in range(n):
        # Mcal (Jdot + ad_V J) - ad_V' Mcal J = Mcal Jdot + C_V J
        for r in range(6):
            column[r] = Jd[b, r]
        add_ad(V, J[b], 1.0, column)
        for r in range(3):
            rotary = dm * k2 * (2.0 if r == 2 else 1.0)
            momentum[r] = rotary * J[b, r]
            momentum[3 + r] = dm * J[b, 3 + r]
            force[r] = rotary * column[r]
            force[3 + r] = dm * column[3 + r]
        add_coad(V, momentum, -1.0, force)
        for d in range(n):
            M[d, b] += dot6(J[d], momentum)
            C[d, b] += dot6(J[d], force)
        for r in range(3):
            pull = R[0, r] * gravity[0] + R[1, r] * gravity[1] + R[2, r] * gravity[2]
            G[b] -= dm * J[b, 3 + r] * pull


@inner
def terms(
    t: Tables,
    mass: Array,
    tip_mass: float,
    gravity: Array,
    q: Array,
    qd: Array,
    M: Array,
    C: Array,
    G: Array,
    J: Array,
) -> None:
    """M, C (n_q, n_q), G (n_q,) and the body Jacobian of the tip, transposed (n_q, 6)."""
    n_q = q.shape[0]
    R, p = np.empty((3, 3)), np.empty(3)
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    B1, B2, Jd = np.zeros((n_q, 6)), np.zeros((n_q, 6)), np.zeros((n_q, 6))
    V, work = np.empty(6), np.zeros((3, 6))
    clear_matrix(M)
    clear_matrix(C)
    clear(G)
    clear_matrix(J)
    for i in range(t.length.shape[0]):
        h = t.length[i] / t.steps
        dm = mass[i] / t.steps
        k2 = 0.25 * t.radius[i] * t.radius[i]
        for k in range(t.steps):
            _ralston(t, i, t.shape[k], h, dm, k2, gravity, q, qd, R, p, B1, B2, J, Jd, V, work, M, C, G)
    _body_columns(n_q, qd, R, p, B1, B2, J, Jd, V)
    if tip_mass > 0.0:
        _accumulate(n_q, tip_mass, 0.0, gravity, R, J, Jd, V, work, M, C, G)


@inner
def _strain(t: Tables, i: int, shape: Array, point: int, q: Array, xi: Array) -> None:
    """xi <- xi_0 + B q of link i at one of the two points of a step."""
    for r in range(6):
        xi[r] = t.reference[i, r]
    strain_at(t, i, shape, point, q, xi)


@inner
def _ralston(
    t: Tables,
    i: int,
    shape: Array,
    h: float,
    dm: float,
    k2: float,
    gravity: Array,
    q: Array,
    qd: Array,
    R: Array,
    p: Array,
    B1: Array,
    B2: Array,
    J: Array,
    Jd: Array,
    V: Array,
    work: Array,
    M: Array,
    C: Array,
    G: Array,
) -> None:
    """One step: y + h (k(s, y) + 3 k(s + 2h/3, y + 2h/3 k)) / 4."""
    n = t.offset[i + 1]
    first = t.offset[i]
    R1, p1, R_mid, p_mid = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    column, xi = np.empty(6), np.empty(6)
    start1, start2 = np.empty((n - first, 6)), np.empty((n - first, 6))
    for stage in range(2):
        weight = 0.25 if stage == 0 else 0.75
        if stage == 0:
            assign_matrix(R, R_mid)
            assign(p, p_mid)
        _body_columns(n, qd, R_mid, p_mid, B1, B2, J, Jd, V)
        _accumulate(n, weight * dm, k2, gravity, R_mid, J, Jd, V, work, M, C, G)
        _strain(t, i, shape, stage, q, xi)
        _frame_rates(xi, R_mid, R1, p1)
        # Only the columns of this link change along it: B1' = Ad_g B, B2' = Ad_g ad_V B.
        for b in range(first, n):
            for r in range(6):
                column[r] = shape[b, stage] * t.basis[b, r]
            to_parent(R_mid, p_mid, column)
            for r in range(6):
                if stage == 0:
                    start1[b - first, r] = B1[b, r] + 0.25 * h * column[r]
                    B1[b, r] += h * 2.0 / 3.0 * column[r]
                else:
                    B1[b, r] = start1[b - first, r] + 0.75 * h * column[r]
            clear(column)
            add_ad(V, t.basis[b], shape[b, stage], column)
            to_parent(R_mid, p_mid, column)
            for r in range(6):
                if stage == 0:
                    start2[b - first, r] = B2[b, r] + 0.25 * h * column[r]
                    B2[b, r] += h * 2.0 / 3.0 * column[r]
                else:
                    B2[b, r] = start2[b - first, r] + 0.75 * h * column[r]
        if stage == 0:
            for r in range(3):
                p_mid[r] = p[r] + h * 2.0 / 3.0 * p1[r]
                p[r] += 0.25 * h * p1[r]
                for d in range(3):
                    R_mid[r, d] = R[r, d] + h * 2.0 / 3.0 * R1[r, d]
                    R[r, d] += 0.25 * h * R1[r, d]
        else:
            for r in range(3):
                p[r] += 0.75 * h * p1[r]
                for d in range(3):
                    R[r, d] += 0.75 * h * R1[r, d]


@inner
def inertia(t: Tables, w: Work, mass: Array, tip_mass: float, q: Array, M: Array) -> None:
    """M <- inertia matrix (n_q, n_q)."""
    terms(t, mass, tip_mass, t.gravity, q, w.rows[0], M, w.matrix[1], w.rows[1], w.dense[0])


@inner
def inertial_force(
    t: Tables,
    w: Work,
    mass: Array,
    tip_mass: float,
    gravity: Array,
    none: Array,
    q: Array,
    qd: Array,
    v: Array,
    a: Array,
    tau: Array,
) -> None:
    """tau <- M(q) a + C(q, qd) v + G(q); `none` (6,) is not needed here."""
    M, C, J = w.matrix[0], w.matrix[1], w.dense[0]
    terms(t, mass, tip_mass, gravity, q, qd, M, C, tau, J)
    for b in range(q.shape[0]):
        for d in range(q.shape[0]):
            tau[b] += M[b, d] * a[d] + C[b, d] * v[d]


@inner
def inverse_dynamics(
    t: Tables, w: Work, wrench: Array, q: Array, qd: Array, a: Array, bodies: float, tau: Array
) -> None:
    """tau <- M a + C qd + G - J_tip' wrench; what `factor_system` needs is left in any case."""
    inertial_force(t, w, t.mass, t.tip_mass, t.gravity, wrench, q, qd, qd, a, tau)
    for b in range(q.shape[0]):
        tau[b] -= dot6(w.dense[0, b], wrench)


@inner
def external_force(t: Tables, w: Work, wrench: Array, q: Array, qd: Array, tau: Array) -> float:
    """tau <- J_tip' wrench: all that can act from outside here, which stores no energy."""
    terms(t, t.mass, t.tip_mass, t.gravity, q, w.rows[0], w.matrix[0], w.matrix[1], tau, w.dense[0])
    for b in range(q.shape[0]):
        tau[b] = dot6(w.dense[0, b], wrench)
    return 0.0


@inner
def acceleration(t: Tables, w: Work, wrench: Array, q: Array, qd: Array, force: Array, qdd: Array) -> bool:
    """qdd <- M^-1 (force + J_tip' wrench - C qd - G); False if M is not positive definite."""
    inverse_dynamics(t, w, wrench, q, qd, w.rows[0], NO, w.rows[1])
    for b in range(q.shape[0]):
        qdd[b] = force[b] - w.rows[1][b]
    return cholesky_solve(w.matrix[0], qdd)


@inner
def factor_system(t: Tables, w: Work, q: Array, qd: Array, by_q: float, by_v: float, secant: float) -> bool:
    """Factor M(q) + w.block for `solve`, after `inverse_dynamics` at q; False if it is singular.

    There is no contact here: the last four do nothing.
    """
    A = w.matrix[2]
    assign_matrix(w.matrix[0], A)
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            for j in range(t.offset[i + 1] - first):
                A[c, first + j] += w.block[c, j]
    return lu_factor(A, w.pivots)


@inner
def solve(t: Tables, w: Work, x: Array) -> None:
    """x <- (M + block)^-1 x with the factors of `factor_system`."""
    lu_solve(w.matrix[2], w.pivots, x)


@inner
def kinematics(t: Tables, w: Work, site: Site, q: Array, R: Array, p: Array, J: Array) -> None:
    """Pose and body Jacobian, transposed (n_q, 6), at a place, with a shorter last step where needed."""
    n_q = q.shape[0]
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    B1, B2, Jd = np.zeros((n_q, 6)), np.zeros((n_q, 6)), np.zeros((n_q, 6))
    V, work = np.empty(6), np.zeros((3, 6))
    M, C, G, qd = w.matrix[0], w.matrix[1], w.rows[1], w.rows[0]
    g = t.gravity
    for i in range(site.link + 1):
        last = i == site.link
        h = t.length[i] / t.steps
        for k in range(site.whole if last else t.steps):
            _ralston(t, i, t.shape[k], h, 0.0, 0.0, g, q, qd, R, p, B1, B2, J, Jd, V, work, M, C, G)
        if last and site.step > 0.0:
            _ralston(t, i, site.shape, site.step, 0.0, 0.0, g, q, qd, R, p, B1, B2, J, Jd, V, work, M, C, G)
    _body_columns(n_q, qd, R, p, B1, B2, J, Jd, V)


@inner
def potential(t: Tables, w: Work, q: Array) -> float:
    """Gravitational energy [J], integrated with the same steps as the frame."""
    R, p = np.empty((3, 3)), np.empty(3)
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    R1, p1, R2, p2 = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    xi, at, R_mid = np.empty(6), np.empty(3), np.empty((3, 3))
    energy = 0.0
    for i in range(t.length.shape[0]):
        h = t.length[i] / t.steps
        dm = t.mass[i] / t.steps
        for k in range(t.steps):
            _strain(t, i, t.shape[k], 0, q, xi)
            _frame_rates(xi, R, R1, p1)
            for r in range(3):
                at[r] = p[r] + h * 2.0 / 3.0 * p1[r]
                for d in range(3):
                    R_mid[r, d] = R[r, d] + h * 2.0 / 3.0 * R1[r, d]
            _strain(t, i, t.shape[k], 1, q, xi)
            _frame_rates(xi, R_mid, R2, p2)
            for r in range(3):
                energy -= dm * t.gravity[r] * (0.25 * p[r] + 0.75 * at[r])
                p[r] += h * (0.25 * p1[r] + 0.75 * p2[r])
                for d in range(3):
                    R[r, d] += h * (0.25 * R1[r, d] + 0.75 * R2[r, d])
    for r in range(3):
        energy -= t.tip_mass * t.gravity[r] * p[r]
    return energy
