"""Kernels of the method `exact`: the links in closed form, Gauss-Legendre quadrature for their mass.

Each link is seen from the frame b of its base (`soro_core.model.link`), so nothing of the links before has
to be carried to the nodes.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import inner
from soro_core.model.lie import (
    add_ad,
    add_coad,
    compose,
    dot6,
    exponential,
    stumpff,
    tangent_coefficients,
    to_body,
    wrench_to_parent,
)
from soro_core.model.linear import assign, assign_matrix, clear, clear_matrix
from soro_core.model.link import (
    ad_power_rates,
    ad_powers,
    column_rates_at,
    columns_at,
    momentum,
    node,
    strain_twist,
)
from soro_core.model.tables import Tables

Array: TypeAlias = NDArray[np.float64]


@inner
def inertia(t: Tables, mass: Array, tip_mass: float, q: Array, M: Array) -> None:
    """M <- int J' Mcal J, (n_q, n_q) [C22, 3.16]."""
    n_q = t.basis.shape[0]
    J = np.zeros((n_q, 6))
    NJ = np.empty((n_q, 6))
    F = np.empty((6, 6))
    N = np.empty((6, 6))
    B1 = np.empty((6, 6))
    powers = np.empty((5, 6, 6))
    xi, h, unit = np.empty(6), np.empty(6), np.zeros(6)
    c, a = np.empty(8), np.empty(10)
    R, p = np.empty((3, 3)), np.empty(3)
    clear_matrix(M)
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        m = t.offset[i + 1] - first
        strain_twist(t, i, q, xi)
        ad_powers(t, i, xi, powers)
        z = xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]
        clear_matrix(F)
        clear_matrix(N)
        for k in range(t.nodes.shape[0] + 1):
            s, dm, k2 = node(t, i, k, mass, tip_mass)
            stumpff(z * s * s, c)
            tangent_coefficients(c, a)
            columns_at(m, s, a, powers, B1)
            exponential(xi, s, c, R, p)
            if dm == 0.0:
                continue
            for j in range(m):
                momentum(dm, k2, R, p, B1[j], h)
                for r in range(6):
                    F[j, r] += h[r]
                for e in range(j + 1):
                    M[first + j, first + e] += dot6(B1[e], h)
            if first > 0:
                for j in range(6):
                    unit[j] = 1.0
                    momentum(dm, k2, R, p, unit, h)
                    unit[j] = 0.0
                    for r in range(6):
                        N[j, r] += h[r]
        for b in range(first):
            for r in range(6):
                NJ[b, r] = dot6(N[r], J[b])
            for d in range(b + 1):
                M[b, d] += dot6(NJ[b], J[d])
            for j in range(m):
                M[first + j, b] += dot6(F[j], J[b])
        # B1, R, p are those of the end of the link now.
        for j in range(m):
            assign(B1[j], J[first + j])
        for b in range(first + m):
            to_body(R, p, J[b])
    for b in range(n_q):
        for d in range(b):
            M[d, b] = M[b, d]


@inner
def inverse_dynamics(
    t: Tables,
    mass: Array,
    tip_mass: float,
    gravity: Array,
    wrench: Array,
    q: Array,
    qd: Array,
    v: Array,
    a: Array,
    tau: Array,
) -> None:
    """tau <- M(q) a + C(q, qd) v + G(q) - J_tip' wrench, by the recursion of Newton and Euler over the links.

    C is that of [C22, 3.16] with the term -ad_V J in Jdot (theory.md section 2), so Mdot - 2C is skew.
    Gravity enters as an acceleration of the base.
    """
    n = t.length.shape[0]
    V, W, A = np.zeros(6), np.zeros(6), np.zeros(6)
    own = np.zeros((n, 6))
    ends = np.empty((n, 6, 6))
    Rs, ps = np.empty((n, 3, 3)), np.empty((n, 3))
    B1, B1_rate = np.empty((6, 6)), np.empty((6, 6))
    powers, rates = np.empty((5, 6, 6)), np.empty((5, 6, 6))
    xi, xi_rate = np.empty(6), np.empty(6)
    Vk, Wk, Ak, h, f = np.empty(6), np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    c, co = np.empty(8), np.empty(10)
    R, p = np.empty((3, 3)), np.empty(3)
    for r in range(3):
        A[3 + r] = -(
            t.base_rotation[0, r] * gravity[0]
            + t.base_rotation[1, r] * gravity[1]
            + t.base_rotation[2, r] * gravity[2]
        )
    clear(tau)
    for i in range(n):
        first = t.offset[i]
        m = t.offset[i + 1] - first
        strain_twist(t, i, q, xi)
        clear(xi_rate)
        for j in range(m):
            for r in range(6):
                xi_rate[r] += t.basis[first + j, r] * qd[first + j]
        ad_powers(t, i, xi, powers)
        ad_power_rates(m, xi, xi_rate, powers, rates)
        z = xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]
        z_rate = 2.0 * (xi[0] * xi_rate[0] + xi[1] * xi_rate[1] + xi[2] * xi_rate[2])
        for k in range(t.nodes.shape[0] + 1):
            s, dm, k2 = node(t, i, k, mass, tip_mass)
            stumpff(z * s * s, c)
            tangent_coefficients(c, co)
            columns_at(m, s, co, powers, B1)
            column_rates_at(m, s, z_rate * s * s, co, powers, rates, B1_rate)
            exponential(xi, s, c, R, p)
            # True twist V, reference twist W = J v, and acceleration A = J a + Jdot v, all in the base
            # frame b.
            for r in range(6):
                Vk[r] = V[r]
                Wk[r] = W[r]
                Ak[r] = A[r]
            for j in range(m):
                x, y, w = qd[first + j], v[first + j], a[first + j]
                for r in range(6):
                    Vk[r] += B1[j, r] * x
                    Wk[r] += B1[j, r] * y
                    Ak[r] += B1[j, r] * w + B1_rate[j, r] * y
            if dm > 0.0:
                # f = N (A + ad_Vb W) - ad_V' N W
                momentum(dm, k2, R, p, Wk, h)
                if k < t.nodes.shape[0]:
                    add_ad(V, Wk, 1.0, Ak)
                    momentum(dm, k2, R, p, Ak, f)
                else:
                    assign(Ak, xi_rate)
                    add_ad(V, Wk, 1.0, xi_rate)
                    momentum(dm, k2, R, p, xi_rate, f)
                add_coad(Vk, h, -1.0, f)
                for r in range(6):
                    own[i, r] += f[r]
                for j in range(m):
                    tau[first + j] += dot6(B1[j], f)
        # To the end of the link: Jdot_next v = Ad^-1 (Jdot v - ad_w J v), w the twist of the end relative
        # to b.
        for r in range(6):
            V[r] = Vk[r] - V[r]
        add_ad(V, Wk, -1.0, Ak)
        for r in range(6):
            V[r] = Vk[r]
            W[r] = Wk[r]
            A[r] = Ak[r]
        to_body(R, p, V)
        to_body(R, p, W)
        to_body(R, p, A)
        assign_matrix(B1, ends[i])
        assign_matrix(R, Rs[i])
        assign(p, ps[i])
    for r in range(6):
        f[r] = -wrench[r]
    for i in range(n - 1, -1, -1):
        wrench_to_parent(Rs[i], ps[i], f)
        first = t.offset[i]
        for j in range(t.offset[i + 1] - first):
            tau[first + j] += dot6(ends[i, j], f)
        for r in range(6):
            f[r] += own[i, r]


@inner
def kinematics(t: Tables, q: Array, place: float, R: Array, p: Array, J: Array) -> None:
    """Pose (R, p) in the world and body Jacobian, transposed (n_q, 6), at `place` metres along the arm."""
    n = t.length.shape[0]
    powers, B1 = np.empty((5, 6, 6)), np.empty((6, 6))
    xi, c, a = np.empty(6), np.empty(8), np.empty(10)
    R1, p1 = np.empty((3, 3)), np.empty(3)
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    clear_matrix(J)
    for i in range(n):
        s = min(place, t.length[i]) if i < n - 1 else place
        strain_twist(t, i, q, xi)
        ad_powers(t, i, xi, powers)
        stumpff((xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]) * s * s, c)
        tangent_coefficients(c, a)
        first = t.offset[i]
        m = t.offset[i + 1] - first
        columns_at(m, s, a, powers, B1)
        exponential(xi, s, c, R1, p1)
        for j in range(m):
            assign(B1[j], J[first + j])
        for b in range(first + m):
            to_body(R1, p1, J[b])
        compose(R, p, R1, p1)
        place -= s
        if place <= 0.0:
            return


@inner
def potential(t: Tables, q: Array) -> float:
    """Gravitational energy -int rho p . gamma [J], zero at the world's origin."""
    xi, c = np.empty(6), np.empty(8)
    R1, p1 = np.empty((3, 3)), np.empty(3)
    R, p = np.empty((3, 3)), np.empty(3)
    assign_matrix(t.base_rotation, R)
    assign(t.base_position, p)
    energy = 0.0
    for i in range(t.length.shape[0]):
        strain_twist(t, i, q, xi)
        z = xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]
        for k in range(t.nodes.shape[0] + 1):
            s, dm, _ = node(t, i, k, t.mass, t.tip_mass)
            stumpff(z * s * s, c)
            exponential(xi, s, c, R1, p1)
            for r in range(3):
                at = p[r] + R[r, 0] * p1[0] + R[r, 1] * p1[1] + R[r, 2] * p1[2]
                energy -= dm * at * t.gravity[r]
        compose(R, p, R1, p1)
    return energy
