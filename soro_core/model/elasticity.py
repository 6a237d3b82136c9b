"""Elastic force as the gradient of a potential, its Hessian, and its features (theory.md section 3).

U = int_0^x k_e(s) s ds + int_0^beta k_b(s) s ds, x = eps L, with k(s) = a1 + a2 (tanh^2(a3 s) - 1); or a
quadratic form of the coordinates from a material. The bending part is written in w = beta^2 / 2, which is
smooth at zero curvature, so that nothing is ever divided by it: dU/dq = k_b(beta) dw/dq.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import inner, kernel
from soro_core.model.linear import clear_matrix
from soro_core.model.tables import DEFORMED, Tables

Array: TypeAlias = NDArray[np.float64]


@inner
def _secant(a1: float, a2: float, a3: float, s: float) -> float:
    th = math.tanh(a3 * s)
    return a1 + a2 * (th * th - 1.0)


@inner
def _secant_slope(a2: float, a3: float, s: float) -> float:
    """k'(s) / s, finite at 0: 2 a2 a3^2 tanh(u) sech^2(u) / u with u = a3 s."""
    u = a3 * s
    th = math.tanh(u)
    ratio = th / u if abs(u) > 1e-4 else 1.0 - u * u / 3.0
    return 2.0 * a2 * a3 * a3 * ratio * (1.0 - th * th)


@inner
def _law_energy(a1: float, a2: float, a3: float, s: float) -> float:
    """int_0^s k(t) t dt = a1 s^2 / 2 - a2 int_0^s sech^2(a3 t) t dt."""
    u = abs(a3 * s)
    if u < 0.05:
        inner = s * s * (0.5 - u * u / 4.0 + u**4 / 9.0 - 17.0 * u**6 / 360.0)
    else:
        log_cosh = u + math.log1p(math.exp(-2.0 * u)) - math.log(2.0)
        inner = (u * math.tanh(u) - log_cosh) / (a3 * a3)
    return 0.5 * a1 * s * s - a2 * inner


@inner
def _bend(t: Tables, i: int, q: Array, local: Array) -> None:
    """local <- eps, kx, ky, w = beta^2 / 2, dw/d(eps, kx, ky), L; absent strains are 0."""
    for r in range(3):
        column = t.columns[i, r]
        local[r] = q[column] if column >= 0 else 0.0
    eps, kx, ky = local[0], local[1], local[2]
    L = t.length[i]
    stretch = 1.0 + eps if t.bend_angle == DEFORMED else 1.0
    k2 = kx * kx + ky * ky
    local[3] = 0.5 * k2 * L * L * stretch * stretch
    local[4] = k2 * L * L * stretch if t.bend_angle == DEFORMED else 0.0
    local[5] = kx * L * L * stretch * stretch
    local[6] = ky * L * L * stretch * stretch
    local[7] = L


@kernel
def elastic_force(t: Tables, q: Array, force: Array) -> None:
    """force <- dU_e/dq (n_q,)."""
    local = np.empty(8)
    for c in range(q.shape[0]):
        force[c] = t.stiffness[c] * q[c]
    for i in range(t.length.shape[0]):
        law = t.law[i]
        if law[0] == 0.0 and law[3] == 0.0:
            continue
        _bend(t, i, q, local)
        x = local[0] * local[7]
        k_b = _secant(law[3], law[4], law[5], math.sqrt(2.0 * local[3]))
        if t.columns[i, 0] >= 0:
            force[t.columns[i, 0]] += _secant(law[0], law[1], law[2], x) * x * local[7]
        for r in range(3):
            if t.columns[i, r] >= 0:
                force[t.columns[i, r]] += k_b * local[4 + r]


@kernel
def elastic_energy(t: Tables, q: Array) -> float:
    """U_e [J]."""
    local = np.empty(8)
    energy = 0.0
    for c in range(q.shape[0]):
        energy += 0.5 * t.stiffness[c] * q[c] * q[c]
    for i in range(t.length.shape[0]):
        law = t.law[i]
        _bend(t, i, q, local)
        energy += _law_energy(law[0], law[1], law[2], local[0] * local[7])
        energy += _law_energy(law[3], law[4], law[5], math.sqrt(2.0 * local[3]))
    return energy


@kernel
def add_stiffness(t: Tables, q: Array, factor: float, K: Array) -> None:
    """K += factor * d2U_e/dq2 (n_q, n_q)."""
    local = np.empty(8)
    hessian = np.empty((3, 3))
    for c in range(q.shape[0]):
        K[c, c] += factor * t.stiffness[c]
    for i in range(t.length.shape[0]):
        law = t.law[i]
        if law[0] == 0.0 and law[3] == 0.0:
            continue
        _bend(t, i, q, local)
        L = local[7]
        x = local[0] * L
        beta = math.sqrt(2.0 * local[3])
        k_b = _secant(law[3], law[4], law[5], beta)
        slope = _secant_slope(law[4], law[5], beta)
        stretch = 1.0
        clear_matrix(hessian)
        if t.bend_angle == DEFORMED:
            stretch = 1.0 + local[0]
            hessian[0, 0] = k_b * (local[1] * local[1] + local[2] * local[2]) * L * L
            for r in range(1, 3):
                hessian[0, r] = k_b * 2.0 * local[r] * L * L * stretch
                hessian[r, 0] = hessian[0, r]
        hessian[1, 1] = k_b * L * L * stretch * stretch
        hessian[2, 2] = hessian[1, 1]
        for r in range(3):
            for d in range(3):
                hessian[r, d] += slope * local[4 + r] * local[4 + d]
        k_e = _secant(law[0], law[1], law[2], x)
        hessian[0, 0] += (k_e + x * x * _secant_slope(law[1], law[2], x)) * L * L
        for r in range(3):
            for d in range(3):
                if t.columns[i, r] >= 0 and t.columns[i, d] >= 0:
                    K[t.columns[i, r], t.columns[i, d]] += factor * hessian[r, d]


@kernel
def elastic_regressor(t: Tables, q: Array, Y: Array) -> None:
    """Y <- columns of dU_e/dq that are linear in (a1, a2, a4, a5) of each link, (n_q, 4 n)."""
    local = np.empty(8)
    clear_matrix(Y)
    for i in range(t.length.shape[0]):
        law = t.law[i]
        if law[0] == 0.0 and law[3] == 0.0:
            continue
        _bend(t, i, q, local)
        x = local[0] * local[7]
        if t.columns[i, 0] >= 0:
            Y[t.columns[i, 0], 4 * i] = x * local[7]
            Y[t.columns[i, 0], 4 * i + 1] = _secant(0.0, 1.0, law[2], x) * x * local[7]
        feature = _secant(0.0, 1.0, law[5], math.sqrt(2.0 * local[3]))
        for r in range(3):
            if t.columns[i, r] >= 0:
                Y[t.columns[i, r], 4 * i + 2] = local[4 + r]
                Y[t.columns[i, r], 4 * i + 3] = feature * local[4 + r]
