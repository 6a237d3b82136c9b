"""Kernel of the elements: energy, forces and stiffness, in plane strain, about an axis and in space.

All three share the deformation gradient F = 1 + sum_a u_a (dN_a/dX)^T; about an axis its last number is
1 + sum_a u_ra N_a / R. docs/design.md (5) to (7).
"""

from __future__ import annotations

import numpy as np

from soro_core._jit import inner, kernel
from soro_core.fem.response import BULK, Array, Indices, add_volume_curvature, cofactor, respond


@inner
def _gradient(u: Array, cell: Indices, slope: Array, hoop: Array, F: Array) -> None:
    """F <- deformation gradient at a point of integration."""
    for i in range(3):
        for j in range(3):
            F[i, j] = 1.0 if i == j else 0.0
    for a in range(cell.shape[0]):
        for i in range(u.shape[1]):
            for j in range(u.shape[1]):
                F[i, j] += u[cell[a], i] * slope[a, j]
        F[2, 2] += u[cell[a], 0] * hoop[a]


@inner
def _add_force(P: Array, slope: Array, hoop: Array, volume: float, force: Array) -> None:
    """Add int P : dF to the forces (n d,) of the element."""
    d = slope.shape[1]
    for a in range(slope.shape[0]):
        for k in range(d):
            value = 0.0
            for j in range(d):
                value += P[k, j] * slope[a, j]
            force[a * d + k] += volume * value
        force[a * d] += volume * P[2, 2] * hoop[a]


@inner
def _add_stiffness(A: Array, slope: Array, hoop: Array, volume: float, column: Array, K: Array) -> None:
    """Add int dF : A : dF to the lower half of the stiffness (n d, n d) of the element."""
    n, d = slope.shape
    for a in range(n):
        for k in range(d):
            for m in range(9):
                value = 0.0
                for j in range(d):
                    value += A[m, 3 * k + j] * slope[a, j]
                if k == 0:
                    value += A[m, 8] * hoop[a]
                column[m] = volume * value
            for b in range(a, n):
                for i in range(d):
                    value = 0.0
                    for j in range(d):
                        value += slope[b, j] * column[3 * i + j]
                    if i == 0:
                        value += hoop[b] * column[8]
                    K[b * d + i, a * d + k] += value


@kernel
def assemble(
    law: Array,
    is_averaged: bool,
    cells: Indices,
    slope: Array,
    hoop: Array,
    volume: Array,
    position: Indices,
    u: Array,
    force: Array,
    data: Array,
) -> tuple[float, int]:
    """Add forces (n, d) and, unless `data` is empty, stiffnesses; return the energy, and -1 or a bad element.

    slope (e, g, a, d), hoop (e, g, a) and volume (e, g) are those of the undeformed mesh; position
    (e, n d, n d) says where in `data` the stiffness of an element goes. With `is_averaged` the element has
    one volume ratio, the mean of J. A bad element has J <= 0 somewhere.
    """
    n_cells, n_points, n, d = slope.shape
    F, H, P, A = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((9, 9))
    work, column = np.empty((3, 3, 3)), np.empty(9)
    f, by_volume, K = np.empty(n * d), np.empty(n * d), np.empty((n * d, n * d))
    energy = 0.0
    with_stiffness = data.shape[0] > 0
    for e in range(n_cells):
        f[:] = 0.0
        by_volume[:] = 0.0
        K[:] = 0.0
        total, deformed = 0.0, 0.0
        for g in range(n_points):
            _gradient(u, cells[e], slope[e, g], hoop[e, g], F)
            J = cofactor(F, H)
            if not J > 0.0:
                return energy, e
            total += volume[e, g]
            deformed += J * volume[e, g]
            if is_averaged:
                _add_force(H, slope[e, g], hoop[e, g], volume[e, g], by_volume)
        bulk, mean_stress = law[BULK], 0.0
        if is_averaged:
            mean_stress = bulk * (deformed / total - 1.0)
            energy += 0.5 * total * mean_stress * (deformed / total - 1.0)
            bulk = 0.0
        for g in range(n_points):
            _gradient(u, cells[e], slope[e, g], hoop[e, g], F)
            cofactor(F, H)
            energy += volume[e, g] * respond(law, bulk, F, H, work, P, A)
            if is_averaged:
                for i in range(3):
                    for j in range(3):
                        P[i, j] += mean_stress * H[i, j]
                add_volume_curvature(F, mean_stress, A)
            _add_force(P, slope[e, g], hoop[e, g], volume[e, g], f)
            if with_stiffness:
                _add_stiffness(A, slope[e, g], hoop[e, g], volume[e, g], column, K)
        for a in range(n):
            for k in range(d):
                force[cells[e, a], k] += f[a * d + k]
        if with_stiffness:
            by_mean = law[BULK] / total if is_averaged else 0.0
            for i in range(n * d):
                for j in range(i + 1):
                    # Of two numbers of one node the stiffness above the diagonal is there too.
                    value = K[i, j] + by_mean * by_volume[i] * by_volume[j]
                    data[position[e, i, j]] += value
                    if i != j:
                        data[position[e, j, i]] += value
    return energy, -1
