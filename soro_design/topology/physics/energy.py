"""Kernel of elements between solid and void, with the air in them; docs/design.md (T6) to (T8).

    phi(u) = kappa s (phi_solid(gamma u) + (1 - gamma^2) phi_small(u)) - (1 - kappa) int p J(u) dV

s says how many times as stiff as the material an element is, phi_solid is the energy of the material and
phi_small that of small strains: void (gamma = 0) is linear and cannot turn inside out (Wang et al. 2014). Air
presses on what is not solid: so a pressure that falls within a wall pushes at its face. The displacements of
an element are u = (u_1x, u_1y, ...).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soro_core._jit import inner, kernel
from soro_core.arrays import Array, Integers
from soro_design.fem.elements.response import cofactor
from soro_design.fem.elements.solid import (
    ElementLaw,
    ElementShape,
    ElementWork,
    add_force,
    add_volume_stiffness,
    fill_gradient,
    make_work,
    respond_element,
)


class ElementScales(NamedTuple):
    """What the densities make of the elements.

    Attributes
    ----------
    kappa, gamma : ndarray, (e,)
        Of (T7).
    stiffer : ndarray, (e,)
        How many times as stiff as the material they are.
    """

    kappa: Array
    gamma: Array
    stiffer: Array


class Elements(NamedTuple):
    """What the kernels read of a grid and its material.

    Attributes
    ----------
    law : ndarray
        Numbers of the material.
    shared : float
        Share of the bulk modulus that acts on the mean of J of an element.
    cells : ndarray of int, (e, a)
        Nodes of the elements.
    kind : ndarray of int, (e,)
        Kind of each element.
    slope, hoop, volume : ndarray, (kinds, g, ...)
        Those of `soro_design.fem.elements.solid.tables`.
    shape : ndarray, (g, a)
        Shape functions at the points of integration.
    small : ndarray, (kinds, a d, a d)
        Stiffness of small strains.
    """

    law: Array
    shared: float
    cells: Integers
    kind: Integers
    slope: Array
    hoop: Array
    volume: Array
    shape: Array
    small: Array


@inner
def _add_air(
    element: ElementShape,
    with_stiffness: bool,
    air: tuple[Array, Array],
    u: Array,
    work: ElementWork,
    to: tuple[Array, Array],
) -> float:
    """Add force and stiffness of -int p J dV to those in `to`; return it.

    `air` has shape functions and pressures of the nodes.
    """
    slope, hoop, volume = element
    shape, p = air
    f, K = to
    energy = 0.0
    for g in range(volume.shape[0]):
        here = 0.0
        for a in range(shape.shape[1]):
            here -= shape[g, a] * p[a] * volume[g]
        fill_gradient(u, slope[g], hoop[g], work.F)
        energy += here * cofactor(work.F, work.H)
        add_force(work.H, slope[g], hoop[g], here, f)
        if with_stiffness:
            add_volume_stiffness(work.F, slope[g], hoop[g], here, K)
    return energy


@kernel
def assemble(
    elements: Elements,
    scale: ElementScales,
    pressure: Array,
    at: tuple[Array, Array],
    force: Array,
    into: tuple[Integers, Array],
) -> tuple[float, float, int]:
    """Add forces (n, d) and stiffness; return the energies of material and air, and -1 or a bad element.

    `scale` is that of the elements; pressure (n,) is that of the nodes; `at`: u (n, d)
    and those before, as in `respond_element`; `into`: position (e, a d, a d) says where in `data` the
    stiffness goes. Without `data` there is none. A bad element has J <= 0 in its solid.
    """
    law, shared, cells, kind, slope, hoop, volume, shape, small = elements
    kappa, gamma, stiffer = scale
    position, data = into
    n, d = slope.shape[2:]
    size = n * d
    of, f, K = ElementLaw(law, shared), np.empty(size), np.empty((size, size))
    of_cell, scaled, earlier = np.empty((n, d)), np.empty((n, d)), np.empty((n, d))
    p, work = np.empty(n), make_work(size)
    u, before = at
    fs, Ks = work.force, work.stiffness
    with_stiffness = data.shape[0] > 0
    stored, by_air = 0.0, 0.0
    for e in range(cells.shape[0]):
        k = kind[e]
        is_wet = False
        for a in range(n):
            p[a] = (1.0 - kappa[e]) * pressure[cells[e, a]]
            is_wet = is_wet or p[a] != 0.0
            for i in range(d):
                of_cell[a, i] = u[cells[e, a], i]
                scaled[a, i] = gamma[e] * u[cells[e, a], i]
                earlier[a, i] = gamma[e] * before[cells[e, a], i]
        solid = kappa[e] * stiffer[e]
        rest = solid * (1.0 - gamma[e] ** 2)
        for i in range(size):
            f[i] = 0.0
            for j in range(size):
                K[i, j] = rest * small[k, i, j]
                f[i] += K[i, j] * of_cell[j // d, j % d]
            stored += 0.5 * f[i] * of_cell[i // d, i % d]
        if gamma[e] > 0.0:
            element = ElementShape(slope[k], hoop[k], volume[k])
            energy = respond_element(of, element, (scaled, earlier), with_stiffness, work)
            if math.isnan(energy):
                return stored, by_air, e
            stored += solid * energy
            for i in range(size):
                f[i] += solid * gamma[e] * fs[i]
                for j in range(i + 1):
                    K[i, j] += solid * gamma[e] ** 2 * Ks[i, j]
        if is_wet:
            element = ElementShape(slope[k], hoop[k], volume[k])
            by_air += _add_air(element, with_stiffness, (shape, p), of_cell, work, (f, K))
        for i in range(size):
            force[cells[e, i // d], i % d] += f[i]
        if with_stiffness:
            for i in range(size):
                for j in range(i + 1):
                    data[position[e, i, j]] += K[i, j]
                    if i != j:
                        data[position[e, j, i]] += K[i, j]
    return stored, by_air, -1


@kernel
def sensitivities(
    elements: Elements,
    scale: ElementScales,
    pressure: Array,
    at: tuple[Array, Array],
    by: tuple[Array, Array],
) -> None:
    """by element (e, 5) and pressure (n,) <- derivatives of energy and of adjoint . force.

    `scale` is that of the elements; pressure (n,) is that of the nodes; `at`: u and adjoint (n, d). The
    columns: 0, 1 the stored energy by kappa s and by gamma; 2 adjoint . force by kappa, as if s were 1; 3 the
    same by gamma; 4 that of 2 without the air. Of the pressure there is only adjoint . force.
    """
    law, shared, cells, kind, slope, hoop, volume, shape, small = elements
    kappa, gamma, stiffer = scale
    u, adjoint = at
    by_element, by_pressure = by
    n, d = slope.shape[2:]
    size = n * d
    of, f, work = ElementLaw(law, shared), np.empty(size), make_work(size)
    fs, Ks = work.force, work.stiffness
    of_cell, scaled, x, y = np.empty((n, d)), np.empty((n, d)), np.empty(size), np.empty(size)
    by_pressure[:] = 0.0
    for e in range(cells.shape[0]):
        k, c = kind[e], gamma[e]
        for a in range(n):
            for i in range(d):
                of_cell[a, i] = x[d * a + i] = u[cells[e, a], i]
                scaled[a, i] = c * of_cell[a, i]
                y[d * a + i] = adjoint[cells[e, a], i]
        quadratic, mixed = 0.0, 0.0
        for i in range(size):
            for j in range(size):
                quadratic += 0.5 * x[i] * small[k, i, j] * x[j]
                mixed += y[i] * small[k, i, j] * x[j]
        energy = (1.0 - c * c) * quadratic
        energy_by_gamma = -2.0 * c * quadratic
        work_done = (1.0 - c * c) * mixed
        work_by_gamma = -2.0 * c * mixed
        if c > 0.0:
            element = ElementShape(slope[k], hoop[k], volume[k])
            energy += respond_element(of, element, (scaled, scaled), True, work)
            for i in range(size):
                energy_by_gamma += fs[i] * x[i]
                work_done += c * y[i] * fs[i]
                work_by_gamma += y[i] * fs[i]
                for j in range(size):
                    entry = Ks[i, j] if j <= i else Ks[j, i]
                    work_by_gamma += c * y[i] * entry * x[j]
        solid = kappa[e] * stiffer[e]
        by_element[e, 0], by_element[e, 1] = energy, solid * energy_by_gamma
        by_element[e, 2], by_element[e, 3] = work_done, solid * work_by_gamma
        by_element[e, 4] = work_done
        for g in range(volume.shape[1]):
            fill_gradient(of_cell, slope[k, g], hoop[k, g], work.F)
            cofactor(work.F, work.H)
            f[:] = 0.0
            add_force(work.H, slope[k, g], hoop[k, g], volume[k, g], f)
            done = 0.0
            for i in range(size):
                done += y[i] * f[i]
            for a in range(n):
                by_pressure[cells[e, a]] -= (1.0 - kappa[e]) * shape[g, a] * done
                by_element[e, 2] += shape[g, a] * pressure[cells[e, a]] * done
