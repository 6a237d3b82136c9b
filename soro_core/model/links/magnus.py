"""A link of varying strain: from node to node by a fourth-order Magnus step, seen from the link's base.

docs/model.md (8), (9): over a sub-interval of length h with the strains xi_1, xi_2 at its Gauss points, g
<- g exp(Omega), Omega = h (xi_1 + xi_2) / 2 + sqrt(3) h^2 / 12 [xi_1, xi_2] ([B09], with the sign of a
product from the right). Its derivative by a coordinate with shape functions f_1, f_2 and unit twist b is
f_1 X_1 + f_2 X_2, X_1 = h b / 2 - c ad_(xi_2) b, X_2 = h b / 2 + c ad_(xi_1) b; all coordinates of one
strain share X_1 and X_2, so the cost of a node hardly grows with the order.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.lie import add_ad, compose, exponential, stumpff, tangent_coefficients, to_parent
from soro_core.model.links.linear import clear
from soro_core.model.records import CrossSection, Motion, SubInterval
from soro_core.model.tables import Tables
from soro_core.model.work import (
    COLUMN_RATE,
    EXPONENT,
    EXPONENT_BY_V,
    EXPONENT_BY_V_RATE,
    EXPONENT_RATE,
    RATE_1,
    RATE_2,
    REFERENCE_1,
    REFERENCE_2,
    SHAPED_1,
    SHAPED_2,
    STEP,
    STEP_TWIST,
    STRAIN_1,
    STRAIN_2,
    SUMMAND,
    SUMMAND_BY_V,
    Work,
)

_COMMUTATOR = math.sqrt(3.0) / 12.0


@inner
def strain_at(t: Tables, i: int, shape: Array, point: int, x: Array, twist: Array) -> None:
    """twist += B x of link i with the shape functions of one point, `shape` (n_q, 2)."""
    for c in range(t.offset[i], t.offset[i + 1]):
        factor = shape[c, point] * x[c]
        for r in range(6):
            twist[r] += t.basis[c, r] * factor


@inner
def _tangent(X: Array, omega: Array, a: Array, powers: Array, out: Array) -> None:
    """out <- sum_n a_n ad_Omega^n X; `powers` (5, 6) keeps ad_Omega^n X."""
    for r in range(6):
        powers[0, r] = X[r]
        out[r] = X[r]
    for n in range(1, 5):
        clear(powers[n])
        add_ad(omega, powers[n - 1], 1.0, powers[n])
        for r in range(6):
            out[r] += a[n] * powers[n, r]


@inner
def magnus_step(t: Tables, w: Work, i: int, step: SubInterval, motion: Motion, at: CrossSection) -> None:
    """Advance pose and columns B1 (m, 6) of a section, and w.vectors[COLUMN_RATE] = d/dt(B1) v."""
    h, shape, rest = step
    q, qd, v, _ = motion
    R, p, B1 = at
    rate = w.vectors[COLUMN_RATE]
    xi1, xi2, xd1, xd2 = w.vectors[STRAIN_1], w.vectors[STRAIN_2], w.vectors[RATE_1], w.vectors[RATE_2]
    eta1, eta2 = w.vectors[REFERENCE_1], w.vectors[REFERENCE_2]
    omega, omega_rate = w.vectors[EXPONENT], w.vectors[EXPONENT_RATE]
    x, x_rate = w.vectors[EXPONENT_BY_V], w.vectors[EXPONENT_BY_V_RATE]  # dOmega/dq v, and its rate
    X, Y, twist = w.vectors[SUMMAND], w.vectors[SUMMAND_BY_V], w.vectors[STEP_TWIST]
    c, a = w.stumpff, w.tangent
    for r in range(6):
        xi1[r] = rest[0, r]
        xi2[r] = rest[1, r]
        xd1[r] = xd2[r] = eta1[r] = eta2[r] = 0.0
    strain_at(t, i, shape, 0, q, xi1)
    strain_at(t, i, shape, 1, q, xi2)
    strain_at(t, i, shape, 0, qd, xd1)
    strain_at(t, i, shape, 1, qd, xd2)
    strain_at(t, i, shape, 0, v, eta1)
    strain_at(t, i, shape, 1, v, eta2)
    k = _COMMUTATOR * h * h
    for r in range(6):
        omega[r] = 0.5 * h * (xi1[r] + xi2[r])
        omega_rate[r] = 0.5 * h * (xd1[r] + xd2[r])
        x[r] = 0.5 * h * (eta1[r] + eta2[r])
        x_rate[r] = 0.0
    add_ad(xi1, xi2, k, omega)
    add_ad(xd1, xi2, k, omega_rate)
    add_ad(xi1, xd2, k, omega_rate)
    add_ad(eta1, xi2, k, x)
    add_ad(xi1, eta2, k, x)
    add_ad(eta1, xd2, k, x_rate)
    add_ad(xd1, eta2, k, x_rate)
    y = omega[0] * omega[0] + omega[1] * omega[1] + omega[2] * omega[2]
    y_rate = 2.0 * (omega[0] * omega_rate[0] + omega[1] * omega_rate[1] + omega[2] * omega_rate[2])
    stumpff(y, c)
    tangent_coefficients(c, a)
    # The part of the rate that this sub-interval adds, in the frame at its start: d/dt(T x).
    powers, rates = w.chain[0], w.chain[1]
    _tangent(x, omega, a, powers, Y)
    for r in range(6):
        rates[0, r] = x_rate[r]
        X[r] = x_rate[r]
    for n in range(1, 5):
        clear(rates[n])
        add_ad(omega_rate, powers[n - 1], 1.0, rates[n])
        add_ad(omega, rates[n - 1], 1.0, rates[n])
        for r in range(6):
            X[r] += a[5 + n] * y_rate * powers[n, r] + a[n] * rates[n, r]
    to_parent(R, p, Y)
    to_parent(R, p, X)
    first = t.offset[i]
    m = t.offset[i + 1] - first
    clear(twist)
    for j in range(m):
        for r in range(6):
            twist[r] += B1[j, r] * qd[first + j]
    for r in range(6):
        rate[r] += X[r]
    add_ad(twist, Y, 1.0, rate)
    _add_columns(t, w, i, step, at)
    R1, p1 = w.frame_rotation[STEP], w.frame_position[STEP]
    exponential(omega, 1.0, c, R1, p1)
    compose(R, p, R1, p1)


@inner
def _add_columns(t: Tables, w: Work, i: int, step: SubInterval, at: CrossSection) -> None:
    """B1 += Ad_g T dOmega/dq, strain by strain; neighbours of one strain share X_1 and X_2."""
    h, shape, _ = step
    R, p, B1 = at
    k = _COMMUTATOR * h * h
    xi1, xi2, omega = w.vectors[STRAIN_1], w.vectors[STRAIN_2], w.vectors[EXPONENT]
    X, Y1, Y2, a = w.vectors[SUMMAND], w.vectors[SHAPED_1], w.vectors[SHAPED_2], w.tangent
    first = t.offset[i]
    for c in range(first, t.offset[i + 1]):
        b = t.basis[c]
        fresh = c == first
        if not fresh:
            for r in range(6):
                fresh = fresh or b[r] != t.basis[c - 1, r]
        if fresh:
            for r in range(6):
                X[r] = 0.5 * h * b[r]
            add_ad(xi2, b, -k, X)
            _tangent(X, omega, a, w.chain[0], Y1)
            to_parent(R, p, Y1)
            for r in range(6):
                X[r] = 0.5 * h * b[r]
            add_ad(xi1, b, k, X)
            _tangent(X, omega, a, w.chain[0], Y2)
            to_parent(R, p, Y2)
        for r in range(6):
            B1[c - first, r] += shape[c, 0] * Y1[r] + shape[c, 1] * Y2[r]
