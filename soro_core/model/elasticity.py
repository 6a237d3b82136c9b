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
def _looks(t: Tables, i: int) -> int:
    """At how many nodes the law of link i is taken: a constant strain is the same everywhere."""
    return t.nodes.shape[0] if t.varying[i] else 1


@inner
def _bend(t: Tables, i: int, k: int, q: Array, local: Array) -> float:
    """local <- eps, kx, ky, w = beta^2 / 2, dw/d(eps, kx, ky), L at node k; gives the weight of the node."""
    for r in range(3):
        local[r] = 0.0
        for c in range(t.columns[i, r, 0], t.columns[i, r, 1]):
            local[r] += t.shape_node[c, k] * q[c]
    eps, kx, ky = local[0], local[1], local[2]
    L = t.length[i]
    stretch = 1.0 + eps if t.bend_angle == DEFORMED else 1.0
    k2 = kx * kx + ky * ky
    local[3] = 0.5 * k2 * L * L * stretch * stretch
    local[4] = k2 * L * L * stretch if t.bend_angle == DEFORMED else 0.0
    local[5] = kx * L * L * stretch * stretch
    local[6] = ky * L * L * stretch * stretch
    local[7] = L
    return t.weights[k] if t.varying[i] else 1.0


@kernel
def elastic_force(t: Tables, q: Array, force: Array) -> None:
    """force <- dU_e/dq (n_q,)."""
    local = np.empty(8)
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            force[c] = 0.0
            for d in range(first, t.offset[i + 1]):
                force[c] += t.stiffness[c, d - first] * q[d]
        law = t.law[i]
        if law[0] == 0.0 and law[3] == 0.0:
            continue
        for k in range(_looks(t, i)):
            weight = _bend(t, i, k, q, local)
            x = local[0] * local[7]
            k_b = _secant(law[3], law[4], law[5], math.sqrt(2.0 * local[3]))
            axial = _secant(law[0], law[1], law[2], x) * x * local[7]
            for r in range(3):
                f = weight * (k_b * local[4 + r] + (axial if r == 0 else 0.0))
                for c in range(t.columns[i, r, 0], t.columns[i, r, 1]):
                    force[c] += f * t.shape_node[c, k]


@kernel
def elastic_energy(t: Tables, q: Array) -> float:
    """U_e [J]."""
    local = np.empty(8)
    energy = 0.0
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            for d in range(first, t.offset[i + 1]):
                energy += 0.5 * q[c] * t.stiffness[c, d - first] * q[d]
        law = t.law[i]
        for k in range(_looks(t, i)):
            weight = _bend(t, i, k, q, local)
            energy += weight * _law_energy(law[0], law[1], law[2], local[0] * local[7])
            energy += weight * _law_energy(law[3], law[4], law[5], math.sqrt(2.0 * local[3]))
    return energy


@inner
def _law_hessian(t: Tables, law: Array, local: Array, hessian: Array) -> None:
    """hessian <- second derivatives of the laws by (eps, kx, ky) at a node, (3, 3)."""
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


@kernel
def add_stiffness(t: Tables, q: Array, factor: float, K: Array) -> None:
    """K += factor * d2U_e/dq2, the block of each link: row of a coordinate, (n_q, width)."""
    local = np.empty(8)
    hessian = np.empty((3, 3))
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            for d in range(t.offset[i + 1] - first):
                K[c, d] += factor * t.stiffness[c, d]
        law = t.law[i]
        if law[0] == 0.0 and law[3] == 0.0:
            continue
        for k in range(_looks(t, i)):
            weight = factor * _bend(t, i, k, q, local)
            _law_hessian(t, law, local, hessian)
            for r in range(3):
                for c in range(t.columns[i, r, 0], t.columns[i, r, 1]):
                    row = weight * t.shape_node[c, k]
                    for e in range(3):
                        for d in range(t.columns[i, e, 0], t.columns[i, e, 1]):
                            K[c, d - first] += row * hessian[r, e] * t.shape_node[d, k]


@kernel
def elastic_regressor(t: Tables, q: Array, Y: Array) -> None:
    """Y <- columns of dU_e/dq that are linear in (a1, a2, a4, a5) of each link, (n_q, 4 n)."""
    local = np.empty(8)
    clear_matrix(Y)
    for i in range(t.length.shape[0]):
        law = t.law[i]
        if law[0] == 0.0 and law[3] == 0.0:
            continue
        for k in range(_looks(t, i)):
            weight = _bend(t, i, k, q, local)
            x = local[0] * local[7]
            axial = _secant(0.0, 1.0, law[2], x) * x * local[7]
            feature = _secant(0.0, 1.0, law[5], math.sqrt(2.0 * local[3]))
            for r in range(3):
                for c in range(t.columns[i, r, 0], t.columns[i, r, 1]):
                    f = weight * t.shape_node[c, k]
                    if r == 0:
                        Y[c, 4 * i] += f * x * local[7]
                        Y[c, 4 * i + 1] += f * axial
                    Y[c, 4 * i + 2] += f * local[4 + r]
                    Y[c, 4 * i + 3] += f * feature * local[4 + r]
