"""Kernel of the elements: energy, forces and stiffness, in plane strain, about an axis and in space.

All three share the deformation gradient F = 1 + sum_a u_a (dN_a/dX)^T; about an axis its last number is
1 + sum_a u_ra N_a / R. docs/design.md (5) to (7).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soro_core._jit import inner, kernel
from soro_core.arrays import Array, Integers
from soro_design.fem.elements.mesh import Mesh
from soro_design.fem.elements.response import BULK, add_volume_curvature, cofactor, respond


class ElementLaw(NamedTuple):
    """Numbers of a material, and the share of its bulk modulus that acts on the mean of J, from 0 to 1."""

    law: Array
    shared: float


class ElementShape(NamedTuple):
    """What `tables` gives of one element."""

    slope: Array
    hoop: Array
    volume: Array


class ElementWork(NamedTuple):
    """Room for the numbers of one element at a time."""

    F: Array
    H: Array
    P: Array
    A: Array
    products: Array
    column: Array
    by_volume: Array
    force: Array
    """Of an element of `size` displacements, (size,), and the lower half of its stiffness, (size, size)."""
    stiffness: Array


def tables(mesh: Mesh, cells: Integers) -> tuple[Array, Array, Array]:
    """Return what the kernel reads of undeformed elements, at their points of integration.

    Parameters
    ----------
    mesh : Mesh
        The mesh.
    cells : ndarray of int, (e, a)
        Its elements, or some of them.

    Returns
    -------
    slope : ndarray, (e, g, a, d)
        Derivatives of the shape functions by X [1/m].
    hoop : ndarray, (e, g, a)
        N / R about an axis [1/m], else 0.
    volume : ndarray, (e, g)
        Volumes [m3]; plane strain is 1 m thick, rings are whole.
    """
    one, at = mesh.element, mesh.points[cells]
    by_xi = np.einsum("ead,gak->egdk", at, one.slope)
    slope = np.einsum("gak,egkd->egad", one.slope, np.linalg.inv(by_xi))
    volume = np.linalg.det(by_xi) * one.weight
    hoop = np.zeros(slope.shape[:3])
    if mesh.space == "axisymmetric":
        radius = at[:, :, 0] @ one.shape.T
        hoop = one.shape[None] / radius[:, :, None]
        volume = volume * 2.0 * np.pi * radius
    return np.ascontiguousarray(slope), hoop, volume


@inner
def make_work(size: int) -> ElementWork:
    """Return room for elements of `size` displacements."""
    return ElementWork(
        np.empty((3, 3)),
        np.empty((3, 3)),
        np.empty((3, 3)),
        np.empty((9, 9)),
        np.empty((5, 3, 3)),
        np.empty(9),
        np.empty(size),
        np.empty(size),
        np.empty((size, size)),
    )


@inner
def gather(u: Array, cell: Integers, of_cell: Array) -> None:
    """of_cell (a, d) <- displacements of the nodes `cell` (a,) of an element."""
    for a in range(cell.shape[0]):
        for k in range(u.shape[1]):
            of_cell[a, k] = u[cell[a], k]


@inner
def fill_gradient(u: Array, slope: Array, hoop: Array, F: Array) -> None:
    """F <- deformation gradient at a point of integration; u (a, d) are those of the element."""
    for i in range(3):
        for j in range(3):
            F[i, j] = 1.0 if i == j else 0.0
    for a in range(u.shape[0]):
        for i in range(u.shape[1]):
            for j in range(u.shape[1]):
                F[i, j] += u[a, i] * slope[a, j]
        F[2, 2] += u[a, 0] * hoop[a]


@inner
def add_force(P: Array, slope: Array, hoop: Array, volume: float, force: Array) -> None:
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
def add_stiffness(A: Array, slope: Array, hoop: Array, volume: float, column: Array, K: Array) -> None:
    """Add int dF : A : dF to the lower half of the stiffness (n d, n d) of the element."""
    n, d = slope.shape
    for a in range(n):
        for k in range(d):
            # Rows of A, which is symmetric: they lie together in memory.
            for m in range(9):
                column[m] = volume * hoop[a] * A[8, m] if k == 0 else 0.0
            for j in range(d):
                along = volume * slope[a, j]
                for m in range(9):
                    column[m] += along * A[3 * k + j, m]
            for b in range(a, n):
                for i in range(d):
                    value = 0.0
                    for j in range(d):
                        value += slope[b, j] * column[3 * i + j]
                    if i == 0:
                        value += hoop[b] * column[8]
                    K[b * d + i, a * d + k] += value


@inner
def add_volume_stiffness(F: Array, slope: Array, hoop: Array, factor: float, K: Array) -> None:
    """Add factor dF : d2J/dF2 : dF to the lower half of the stiffness (n d, n d) of the element.

    In space, of motions of node a along i and b along k it is F_m . (dN_a x dN_b), with rows F_m of F, where
    i, k, m follow upon each other, and minus that where k, i, m do.
    """
    n, d = slope.shape
    for a in range(n):
        for b in range(a, n):
            if d == 3:
                x = slope[a, 1] * slope[b, 2] - slope[a, 2] * slope[b, 1]
                y = slope[a, 2] * slope[b, 0] - slope[a, 0] * slope[b, 2]
                z = slope[a, 0] * slope[b, 1] - slope[a, 1] * slope[b, 0]
                for i in range(3):
                    k, m = (i + 1) % 3, (i + 2) % 3
                    value = factor * (F[m, 0] * x + F[m, 1] * y + F[m, 2] * z)
                    K[b * d + k, a * d + i] += value
                    K[b * d + i, a * d + k] -= value
            else:
                value = factor * F[2, 2] * (slope[a, 0] * slope[b, 1] - slope[a, 1] * slope[b, 0])
                K[b * d + 1, a * d] += value
                K[b * d, a * d + 1] -= value
                # J = F_33 (F_11 F_22 - F_12 F_21), and F_33 moves with x.
                ha, hb = factor * hoop[a], factor * hoop[b]
                for j in range(2):
                    i = 1 - j
                    sign = 1.0 if j == 0 else -1.0
                    # Along x of a with F_1j of b, F_2j of b; and the other way round.
                    K[b * d, a * d] += sign * F[1, i] * (ha * slope[b, j] + hb * slope[a, j])
                    K[b * d + 1, a * d] -= sign * F[0, i] * ha * slope[b, j]
                    K[b * d, a * d + 1] -= sign * F[0, i] * hb * slope[a, j]


@inner
def straight_ratio(u: Array, before: Array, slope: Array, hoop: Array, work: ElementWork) -> float:
    """Return J at u (a, d) along its slope at `before`; F in `work` is that of u."""
    fill_gradient(before, slope, hoop, work.P)
    straight = -2.0 * cofactor(work.P, work.H)  # since H : F = 3 J there
    fill_gradient(u, slope, hoop, work.F)
    for i in range(3):
        for j in range(3):
            straight += work.H[i, j] * work.F[i, j]
    return straight


@inner
def respond_element(
    of: ElementLaw,
    shape: ElementShape,
    at: tuple[Array, Array],
    with_stiffness: bool,
    work: ElementWork,
) -> float:
    """work.force, .stiffness <- those of an element at displacements; return its energy, NaN if J <= 0.

    `at`: u (a, d), and those before, from which the pressure in the stiffness follows a straight line,
    docs/design.md (10a); with u twice the stiffness is exact.
    """
    law, shared = of
    is_averaged = shared > 0.0
    u, before = at
    slope, hoop, volume = shape
    F, H, P, A, by_volume = work.F, work.H, work.P, work.A, work.by_volume
    f, K = work.force, work.stiffness
    f[:] = 0.0
    K[:] = 0.0
    by_volume[:] = 0.0
    total, deformed, straight, energy = 0.0, 0.0, 0.0, 0.0
    for g in range(volume.shape[0]):
        if with_stiffness:
            straight += volume[g] * straight_ratio(u, before, slope[g], hoop[g], work)
        else:
            fill_gradient(u, slope[g], hoop[g], F)
        J = cofactor(F, H)
        if not J > 0.0:
            return math.nan
        total += volume[g]
        deformed += J * volume[g]
        if is_averaged:
            add_force(H, slope[g], hoop[g], volume[g], by_volume)
    bulk, mean_stress, straight_stress = law[BULK], 0.0, 0.0
    if is_averaged:
        mean_stress = shared * bulk * (deformed / total - 1.0)
        straight_stress = shared * bulk * (straight / total - 1.0)
        energy += 0.5 * total * mean_stress * (deformed / total - 1.0)
        bulk -= shared * bulk
    for g in range(volume.shape[0]):
        ratio = 0.0
        if with_stiffness and bulk > 0.0:
            ratio = straight_ratio(u, before, slope[g], hoop[g], work)
        fill_gradient(u, slope[g], hoop[g], F)
        J = cofactor(F, H)
        energy += volume[g] * respond(law, bulk, (F, H), with_stiffness, work.products, (P, A))
        if is_averaged:
            for i in range(3):
                for j in range(3):
                    P[i, j] += mean_stress * H[i, j]
        add_force(P, slope[g], hoop[g], volume[g], f)
        if with_stiffness:
            # The law has the pressure at J, the stiffness that of the straight line.
            add_volume_curvature(F, straight_stress + bulk * (ratio - J), A)
            add_stiffness(A, slope[g], hoop[g], volume[g], work.column, K)
    if with_stiffness and is_averaged:
        for i in range(f.shape[0]):
            for j in range(i + 1):
                # Of two numbers of one node the stiffness above the diagonal is there too.
                K[i, j] += shared * law[BULK] / total * by_volume[i] * by_volume[j]
    return energy


@kernel
def assemble(
    law: tuple[Array, float],
    cells: Integers,
    shapes: tuple[Array, Array, Array],
    at: tuple[Array, Array],
    force: Array,
    into: tuple[Integers, Array],
) -> tuple[float, int]:
    """Add forces (n, d) and, unless `data` is empty, stiffnesses; return the energy, and -1 or a bad element.

    `law`: fields of an `ElementLaw`; `shapes` come from `tables`; `at`: displacements u (n, d), and those
    before as in `respond_element`; `into`: position (e, n d, n d) says where in `data` the stiffness of an
    element goes. A bad element has J <= 0 somewhere.
    """
    of = ElementLaw(*law)
    slope, hoop, volume = shapes
    position, data = into
    n, d = slope.shape[2:]
    size = n * d
    of_cell, of_before, work = np.empty((n, d)), np.empty((n, d)), make_work(size)
    u, before = at
    f, K = work.force, work.stiffness
    energy = 0.0
    with_stiffness = data.shape[0] > 0
    for e in range(cells.shape[0]):
        gather(u, cells[e], of_cell)
        gather(before, cells[e], of_before)
        shape = ElementShape(slope[e], hoop[e], volume[e])
        own = respond_element(of, shape, (of_cell, of_before), with_stiffness, work)
        if math.isnan(own):
            return energy, e
        energy += own
        for a in range(n):
            for k in range(d):
                force[cells[e, a], k] += f[a * d + k]
        if with_stiffness:
            for i in range(size):
                for j in range(i + 1):
                    data[position[e, i, j]] += K[i, j]
                    if i != j:
                        data[position[e, j, i]] += K[i, j]
    return energy, -1
