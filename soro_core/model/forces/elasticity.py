"""Elastic force as the gradient of a potential, its Hessian and its features, docs/model.md (16) to (18)
and (52).

U = int_0^x k_e(s) s ds + int_0^beta k_b(s) s ds, x = eps L, with k(s) = a1 + a2 (tanh^2(a3 s) - 1); or a
quadratic form of the coordinates from a material. Walls that touch at a least elongation add to k_e. The
bending part is written in w = beta^2 / 2, which is smooth at zero curvature, so that nothing is ever divided
by it: dU/dq = k_b(beta) dw/dq.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.model.links.linear import clear_matrix
from soro_core.model.links.local import local_strain, n_samples
from soro_core.model.tables import DEFORMED, Tables

Slope: TypeAlias = tuple[float, float, float]

# Least 1 - u^2 of walls that touch: keeps what is evaluated beyond them finite.
CLOSEST = 1e-12


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
def _touch(wall: float, x: float) -> tuple[float, float]:
    """1 - u^2 and u^2 / (1 - u^2), u = x / (least elongation L): u = 0 in extension, or without walls."""
    if wall == 0.0 or x >= 0.0:
        return 1.0, 0.0
    u2 = wall * x * x
    left = max(1.0 - u2, CLOSEST)
    return left, u2 / left


@inner
def _axial(law: Array, wall: float, x: float) -> float:
    """k_e(x) with that of walls that touch."""
    _, touch = _touch(wall, x)
    secant: float = _secant(law[0], law[1], law[2], x) + (law[0] - law[1]) * touch
    return secant


@inner
def _axial_slope(law: Array, wall: float, x: float) -> float:
    """d(k_e x)/dx, with that of walls that touch."""
    left, touch = _touch(wall, x)
    touching = (law[0] - law[1]) * touch * 2.0 / left
    slope: float = _axial(law, wall, x) + x * x * _secant_slope(law[1], law[2], x) + touching
    return slope


@inner
def _wall_energy(law: Array, wall: float, x: float) -> float:
    """int_0^x of the force of walls that touch: k_e(0) (least L)^2 (-ln(1 - u^2) - u^2) / 2."""
    left, _ = _touch(wall, x)
    return 0.5 * (law[0] - law[1]) * (left - 1.0 - math.log(left)) / wall if left < 1.0 else 0.0


@inner
def _bend(t: Tables, i: int, k: int, q: Array) -> tuple[float, float, float, Slope]:
    """Return x = eps L, stretch, w = beta^2 / 2, and dw/d(eps, kx, ky) of node k."""
    eps, kx, ky = local_strain(t, i, 0, k, q), local_strain(t, i, 1, k, q), local_strain(t, i, 2, k, q)
    L2 = t.length[i] * t.length[i]
    stretch, by_eps = 1.0, 0.0
    k2 = kx * kx + ky * ky
    if t.bend_angle == DEFORMED:
        stretch = 1.0 + eps
        by_eps = k2 * L2 * stretch
    each = L2 * stretch * stretch
    return eps * t.length[i], stretch, 0.5 * k2 * each, (by_eps, kx * each, ky * each)


@inner
def elastic_force(t: Tables, q: Array, force: Array) -> None:
    """force <- dU_e/dq (n_q,)."""
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            force[c] = 0.0
            for d in range(first, t.offset[i + 1]):
                force[c] += t.stiffness[c, d - first] * q[d]
        law = t.law[i]
        if law[0] == 0.0 and law[3] == 0.0:
            continue
        for k in range(n_samples(t, i)):
            x, _, w, slope = _bend(t, i, k, q)
            share = t.law_share[i, k]
            k_b = _secant(law[3], law[4], law[5], math.sqrt(2.0 * w))
            axial = t.axial_share[i, k] * _axial(law, t.wall[i], x) * x * t.length[i]
            for r in range(3):
                f = share * (k_b * slope[r] + (axial if r == 0 else 0.0))
                for c in range(t.columns[i, r, 0], t.columns[i, r, 1]):
                    force[c] += f * t.shape_node[c, k]


@inner
def elastic_energy(t: Tables, q: Array) -> float:
    """U_e [J]."""
    energy = 0.0
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            for d in range(first, t.offset[i + 1]):
                energy += 0.5 * q[c] * t.stiffness[c, d - first] * q[d]
        law = t.law[i]
        if law[0] == 0.0 and law[3] == 0.0:
            continue
        for k in range(n_samples(t, i)):
            x, _, w, _ = _bend(t, i, k, q)
            share = t.law_share[i, k]
            axial = share * t.axial_share[i, k]
            energy += axial * (_law_energy(law[0], law[1], law[2], x) + _wall_energy(law, t.wall[i], x))
            energy += share * _law_energy(law[3], law[4], law[5], math.sqrt(2.0 * w))
    return energy


@inner
def _law_second(t: Tables, i: int, k: int, q: Array, r: int, d: int) -> float:
    """Second derivative of the laws by two of (eps, kx, ky) at a node."""
    law, L = t.law[i], t.length[i]
    x, stretch, w, slope = _bend(t, i, k, q)
    beta = math.sqrt(2.0 * w)
    k_b = _secant(law[3], law[4], law[5], beta)
    second = _secant_slope(law[4], law[5], beta) * slope[r] * slope[d]
    if r > 0 and d == r:
        second += k_b * L * L * stretch * stretch
    if t.bend_angle == DEFORMED:
        if r == 0 and d == 0:
            second += k_b * 2.0 * w / (stretch * stretch)
        elif r == 0 or d == 0:
            second += k_b * 2.0 * slope[r + d] / stretch
    if r == 0 and d == 0:
        second += t.axial_share[i, k] * _axial_slope(law, t.wall[i], x) * L * L
    return second


@inner
def add_stiffness(t: Tables, q: Array, factor: float, K: Array) -> None:
    """K += factor * d2U_e/dq2, the block of each link: row of a coordinate, (n_q, width)."""
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for c in range(first, t.offset[i + 1]):
            for d in range(t.offset[i + 1] - first):
                K[c, d] += factor * t.stiffness[c, d]
        law = t.law[i]
        if law[0] == 0.0 and law[3] == 0.0:
            continue
        for k in range(n_samples(t, i)):
            share = factor * t.law_share[i, k]
            for r in range(3):
                for e in range(3):
                    second = share * _law_second(t, i, k, q, r, e)
                    for c in range(t.columns[i, r, 0], t.columns[i, r, 1]):
                        for d in range(t.columns[i, e, 0], t.columns[i, e, 1]):
                            K[c, d - first] += second * t.shape_node[c, k] * t.shape_node[d, k]


@inner
def elastic_regressor(t: Tables, q: Array, Y: Array) -> None:
    """Y <- columns of dU_e/dq that are linear in (a1, a2, a4, a5) of each link, (n_q, 4 n)."""
    clear_matrix(Y)
    for i in range(t.length.shape[0]):
        law = t.law[i]
        if law[0] == 0.0 and law[3] == 0.0:
            continue
        for k in range(n_samples(t, i)):
            x, _, w, slope = _bend(t, i, k, q)
            share = t.law_share[i, k]
            _, touch = _touch(t.wall[i], x)
            extension = t.axial_share[i, k] * x
            axial = (_secant(0.0, 1.0, law[2], x) - touch) * extension * t.length[i]
            feature = _secant(0.0, 1.0, law[5], math.sqrt(2.0 * w))
            for r in range(3):
                for c in range(t.columns[i, r, 0], t.columns[i, r, 1]):
                    f = share * t.shape_node[c, k]
                    if r == 0:
                        Y[c, 4 * i] += f * (1.0 + touch) * extension * t.length[i]
                        Y[c, 4 * i + 1] += f * axial
                    Y[c, 4 * i + 2] += f * slope[r]
                    Y[c, 4 * i + 3] += f * feature * slope[r]
