"""Derivatives of the equation of motion at one state and acceleration, and what follows from them.

docs/model.md (47). Its left-hand side less its right-hand side, M a + C qd + G + dU_e/dq + R qd + internal -
H p - J_tip' wrench, is zero, so its derivatives are those of the acceleration times -M.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.derivative.chain import inverse_derivatives
from soro_core.model.derivative.work import BY_A, BY_Q, BY_V, DerivativeWork
from soro_core.model.dynamics import GOOD, NOT_FINITE, SINGULAR
from soro_core.model.forces.chambers import acting_rate, add_gradient, add_pressure_stiffness
from soro_core.model.forces.elasticity import add_stiffness
from soro_core.model.forces.tendons import add_tendon_gradients
from soro_core.model.links.articulated import cholesky
from soro_core.model.links.linear import clear, clear_matrix
from soro_core.model.records import Motion
from soro_core.model.tables import Tables


@inner
def equation_derivatives(
    t: Tables, d: DerivativeWork, pressure: Array, wrench: Array, motion: Motion
) -> None:
    """d.equation <- derivatives by a (lower triangle), q and qd; d.actuation <- less that by p.

    That is H, each column by the rate at which its pressure acts: 0 within a dead band.
    """
    q = motion.q
    inverse_derivatives(t, d, wrench, q, motion.qd, motion.a)
    clear_matrix(d.block)
    add_stiffness(t, q, 1.0, d.block)
    add_pressure_stiffness(t, q, pressure, 1.0, d.block)
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            for e in range(t.offset[i + 1] - first):
                d.equation[BY_Q, c, first + e] += d.block[c, e]
                d.equation[BY_V, c, first + e] += t.damping[c, e]
    for u in range(d.actuation.shape[1]):
        clear(d.gradient)
        for i in range(t.length.shape[0]):
            if t.chamber_samples[i, u] > 0:
                add_gradient(t, i, u, q, acting_rate(t, u, pressure[u]), d.gradient)
        for b in range(q.shape[0]):
            d.actuation[b, u] = d.gradient[b]
    add_tendon_gradients(t.tendons, t, q, d.actuation.T)


@inner
def acceleration_derivatives(d: DerivativeWork, by_q: Array, by_qd: Array, by_p: Array) -> int:
    """Fill the derivatives of the acceleration after `equation_derivatives`; gives a code.

    by_q, by_qd (n_q, n_q), by_p (n_q, n_u). Overwrites d.equation[BY_A].
    """
    n_q, n_u = d.actuation.shape
    for b in range(n_q):
        for c in range(n_q):
            by_q[b, c] = -d.equation[BY_Q, b, c]
            by_qd[b, c] = -d.equation[BY_V, b, c]
        for u in range(n_u):
            by_p[b, u] = d.actuation[b, u]
    M = d.equation[BY_A]
    if not cholesky(n_q, M):
        return SINGULAR
    good = _solve(M, by_q) and _solve(M, by_qd) and _solve(M, by_p)
    return GOOD if good else NOT_FINITE


@inner
def _solve(A: Array, X: Array) -> bool:
    """X <- A^-1 X, all columns, with the factor of `cholesky`; False where the result is not finite."""
    n, m = X.shape
    for i in range(n):
        for k in range(i):
            f = A[i, k]
            for c in range(m):
                X[i, c] -= f * X[k, c]
        for c in range(m):
            X[i, c] *= A[i, i]
    total = 0.0
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            f = A[k, i]
            for c in range(m):
                X[i, c] -= f * X[k, c]
        for c in range(m):
            X[i, c] *= A[i, i]
            total += X[i, c]
    return math.isfinite(total)
