"""Kernel of elements between solid and void, with the air in them; docs/design.md (T6) to (T8).

    phi(u) = kappa (phi_solid(gamma u) + (1 - gamma^2) phi_small(u)) - int p J(u) dV

phi_solid is the energy of the material and phi_small that of small strains: void (gamma = 0) is linear and
cannot turn inside out (Wang et al. 2014). An element has 8 displacements u = (u_1x, u_1y, ...), and five
numbers of F change with them: F_11, F_12, F_21, F_22, F_33.
"""

from __future__ import annotations

import math

import numpy as np

from soro_core._jit import inner, kernel
from soro_core.fem.response import BULK, Array, Indices, add_volume_curvature, cofactor, respond


@inner
def _fill(slope: Array, u: Array, F: Array) -> None:
    """F <- deformation gradient; slope (5, 8)."""
    F[:] = 0.0
    F[0, 0] = F[1, 1] = F[2, 2] = 1.0
    for i in range(8):
        F[0, 0] += slope[0, i] * u[i]
        F[0, 1] += slope[1, i] * u[i]
        F[1, 0] += slope[2, i] * u[i]
        F[1, 1] += slope[3, i] * u[i]
        F[2, 2] += slope[4, i] * u[i]


@inner
def _add_force(slope: Array, factor: float, P: Array, force: Array) -> None:
    """force += factor P : dF/du."""
    for i in range(8):
        force[i] += factor * (
            P[0, 0] * slope[0, i]
            + P[0, 1] * slope[1, i]
            + P[1, 0] * slope[2, i]
            + P[1, 1] * slope[3, i]
            + P[2, 2] * slope[4, i]
        )


@inner
def _add_stiffness(slope: Array, factor: float, A: Array, K: Array) -> None:
    """K += factor dF/du : A : dF/du, below the diagonal; A (9, 9)."""
    column = np.empty(5)
    for i in range(8):
        for c in range(5):
            m = c if c < 2 else (c + 1 if c < 4 else 8)
            column[c] = factor * (
                A[m, 0] * slope[0, i]
                + A[m, 1] * slope[1, i]
                + A[m, 3] * slope[2, i]
                + A[m, 4] * slope[3, i]
                + A[m, 8] * slope[4, i]
            )
        for j in range(i, 8):
            value = 0.0
            for c in range(5):
                value += slope[c, j] * column[c]
            K[j, i] += value


@inner
def _solid(
    law: Array, is_averaged: bool, slope: Array, volume: Array, u: Array, work: Array, f: Array, K: Array
) -> float:
    """f, K <- force and stiffness (its lower half) of solid; return its energy, or NaN where J <= 0.

    With `is_averaged` the element has one volume ratio, as in `soro_core.fem`. work is (5, 9, 9).
    """
    F, H, P, A = work[0, :3, :3], work[1, :3, :3], work[2, :3, :3], work[3]
    by_volume, cubes = work[4, 0, :8], np.empty((3, 3, 3))
    f[:] = 0.0
    K[:] = 0.0
    by_volume[:] = 0.0
    total, deformed, energy = 0.0, 0.0, 0.0
    for g in range(volume.shape[0]):
        _fill(slope[g], u, F)
        J = cofactor(F, H)
        if not J > 0.0:
            return math.nan
        total += volume[g]
        deformed += J * volume[g]
        if is_averaged:
            _add_force(slope[g], volume[g], H, by_volume)
    bulk, mean_stress = law[BULK], 0.0
    if is_averaged:
        mean_stress = bulk * (deformed / total - 1.0)
        energy += 0.5 * total * mean_stress * (deformed / total - 1.0)
        bulk = 0.0
    for g in range(volume.shape[0]):
        _fill(slope[g], u, F)
        cofactor(F, H)
        energy += volume[g] * respond(law, bulk, F, H, cubes, P, A)
        if is_averaged:
            for i in range(3):
                for j in range(3):
                    P[i, j] += mean_stress * H[i, j]
            add_volume_curvature(F, mean_stress, A)
        _add_force(slope[g], volume[g], P, f)
        _add_stiffness(slope[g], volume[g], A, K)
    if is_averaged:
        for i in range(8):
            for j in range(i, 8):
                K[j, i] += law[BULK] / total * by_volume[i] * by_volume[j]
    return energy


@inner
def _add_air(
    slope: Array, volume: Array, shape: Array, p: Array, u: Array, work: Array, f: Array, K: Array
) -> float:
    """Add force and stiffness of -int p J dV to f, K; return it."""
    F, H, A = work[0, :3, :3], work[1, :3, :3], work[3]
    energy = 0.0
    for g in range(volume.shape[0]):
        here = 0.0
        for a in range(4):
            here -= shape[g, a] * p[a] * volume[g]
        _fill(slope[g], u, F)
        energy += here * cofactor(F, H)
        _add_force(slope[g], here, H, f)
        A[:] = 0.0
        add_volume_curvature(F, here, A)
        _add_stiffness(slope[g], 1.0, A, K)
    return energy


@kernel
def assemble(
    law: Array,
    is_averaged: bool,
    cells: Indices,
    kind: Indices,
    slope: Array,
    volume: Array,
    shape: Array,
    small: Array,
    kappa: Array,
    gamma: Array,
    pressure: Array,
    position: Indices,
    u: Array,
    force: Array,
    data: Array,
) -> tuple[float, float, int]:
    """Add forces (n, 2) and stiffness; return the energies of material and air, and -1 or a bad element.

    small (kinds, 8, 8) is the stiffness of small strains; kappa, gamma (e,) and pressure (n,) are those of
    elements and nodes; position (e, 8, 8) says where in `data` the stiffness goes. Without `data` there is
    none. A bad element has J <= 0 in its solid.
    """
    f, K, fs, Ks = np.empty(8), np.empty((8, 8)), np.empty(8), np.empty((8, 8))
    of_cell, scaled, p, work = np.empty(8), np.empty(8), np.empty(4), np.empty((5, 9, 9))
    stored, by_air = 0.0, 0.0
    for e in range(cells.shape[0]):
        k = kind[e]
        is_wet = False
        for a in range(4):
            p[a] = pressure[cells[e, a]]
            is_wet = is_wet or p[a] != 0.0
            for i in range(2):
                of_cell[2 * a + i] = u[cells[e, a], i]
                scaled[2 * a + i] = gamma[e] * u[cells[e, a], i]
        rest = kappa[e] * (1.0 - gamma[e] ** 2)
        for i in range(8):
            f[i] = 0.0
            for j in range(8):
                K[i, j] = rest * small[k, i, j]
                f[i] += K[i, j] * of_cell[j]
            stored += 0.5 * f[i] * of_cell[i]
        if gamma[e] > 0.0:
            energy = _solid(law, is_averaged, slope[k], volume[k], scaled, work, fs, Ks)
            if math.isnan(energy):
                return stored, by_air, e
            stored += kappa[e] * energy
            for i in range(8):
                f[i] += kappa[e] * gamma[e] * fs[i]
                for j in range(i + 1):
                    K[i, j] += kappa[e] * gamma[e] ** 2 * Ks[i, j]
        if is_wet:
            by_air += _add_air(slope[k], volume[k], shape, p, of_cell, work, f, K)
        for i in range(8):
            force[cells[e, i // 2], i % 2] += f[i]
        if data.shape[0] > 0:
            for i in range(8):
                for j in range(i + 1):
                    data[position[e, i, j]] += K[i, j]
                    if i != j:
                        data[position[e, j, i]] += K[i, j]
    return stored, by_air, -1


@kernel
def sensitivities(
    law: Array,
    is_averaged: bool,
    cells: Indices,
    kind: Indices,
    slope: Array,
    volume: Array,
    shape: Array,
    small: Array,
    kappa: Array,
    gamma: Array,
    u: Array,
    adjoint: Array,
    by_element: Array,
    by_pressure: Array,
) -> None:
    """by_element (e, 4), by_pressure (n,) <- derivatives of energy and of adjoint . force.

    The columns: of the stored energy by kappa and by gamma, then of adjoint . force by both. Of the pressure
    there is only adjoint . force.
    """
    fs, Ks, work = np.empty(8), np.empty((8, 8)), np.empty((5, 9, 9))
    of_cell, scaled, y = np.empty(8), np.empty(8), np.empty(8)
    F, H, f = work[0, :3, :3], work[1, :3, :3], np.empty(8)
    by_pressure[:] = 0.0
    for e in range(cells.shape[0]):
        k, c = kind[e], gamma[e]
        for a in range(4):
            for i in range(2):
                of_cell[2 * a + i] = u[cells[e, a], i]
                scaled[2 * a + i] = c * u[cells[e, a], i]
                y[2 * a + i] = adjoint[cells[e, a], i]
        quadratic, mixed = 0.0, 0.0
        for i in range(8):
            for j in range(8):
                quadratic += 0.5 * of_cell[i] * small[k, i, j] * of_cell[j]
                mixed += y[i] * small[k, i, j] * of_cell[j]
        energy = (1.0 - c * c) * quadratic
        energy_by_gamma = -2.0 * c * quadratic
        work_done = (1.0 - c * c) * mixed
        work_by_gamma = -2.0 * c * mixed
        if c > 0.0:
            energy += _solid(law, is_averaged, slope[k], volume[k], scaled, work, fs, Ks)
            for i in range(8):
                energy_by_gamma += fs[i] * of_cell[i]
                work_done += c * y[i] * fs[i]
                work_by_gamma += y[i] * fs[i]
                for j in range(8):
                    entry = Ks[i, j] if j <= i else Ks[j, i]
                    work_by_gamma += c * y[i] * entry * of_cell[j]
        by_element[e, 0], by_element[e, 1] = energy, kappa[e] * energy_by_gamma
        by_element[e, 2], by_element[e, 3] = work_done, kappa[e] * work_by_gamma
        for g in range(volume.shape[1]):
            _fill(slope[k, g], of_cell, F)
            cofactor(F, H)
            f[:] = 0.0
            _add_force(slope[k, g], volume[k, g], H, f)
            done = 0.0
            for i in range(8):
                done += y[i] * f[i]
            for a in range(4):
                by_pressure[cells[e, a]] -= shape[g, a] * done
