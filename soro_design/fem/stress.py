"""Stress and stretch of the elements of a deformed part, for pictures and files."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core._jit import kernel
from soro_core.arrays import Array, Integers
from soro_design.fem.elements.response import BULK, cofactor, respond
from soro_design.fem.elements.solid import fill_gradient, gather, make_work
from soro_design.fem.part import Part


@dataclass(frozen=True, eq=False)
class Strained:
    """What the elements of a part bear; in a section the third direction is across it or around the axis.

    Attributes
    ----------
    stress : ndarray, (e, 3, 3)
        Cauchy stress [Pa], the mean over the deformed volume.
    gradient : ndarray, (e, 3, 3)
        Deformation gradient, the mean over the undeformed volume.
    volume : ndarray, (e,)
        Deformed volumes [m3]; plane strain is 1 m thick, rings are whole.
    """

    stress: Array
    gradient: Array
    volume: Array

    @property
    def von_mises_pa(self) -> Array:
        """Equivalent stress (e,) [Pa]: that of a bar under the same energy of distortion."""
        mean = np.trace(self.stress, axis1=1, axis2=2) / 3.0
        deviator = self.stress - mean[:, None, None] * np.eye(3)
        return np.asarray(np.sqrt(1.5 * np.einsum("eij,eij->e", deviator, deviator)))

    @property
    def stretch(self) -> Array:
        """Greatest principal stretch (e,)."""
        return np.asarray(np.linalg.svd(self.gradient, compute_uv=False)[:, 0])


def strained(part: Part, u: Array) -> Strained:
    """Return what the elements bear at the displacements `u` (n, d) [m] of the nodes.

    Where an element is turned inside out, its stress is NaN.
    """
    n, cells, law = len(part.mesh.cells), part.mesh.cells, part.material.law
    forces, gradients, volume = np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.zeros(n)
    tables = part.slope, part.hoop, part.volume
    sums = forces, gradients, volume
    _add_up((law, part.shared), cells, tables, np.ascontiguousarray(u), sums)
    undeformed = part.volume.sum(axis=1)
    forces *= part.stiffer[:, None, None]
    return Strained(forces / volume[:, None, None], gradients / undeformed[:, None, None], volume)


@kernel
def _add_up(
    of: tuple[Array, float],
    cells: Integers,
    shapes: tuple[Array, Array, Array],
    u: Array,
    sums: tuple[Array, Array, Array],
) -> None:
    """Add int J sigma dV = int P F^T dV, int F dV and int J dV of each element to zeros.

    The other parameters are those of `soro_design.fem.elements.solid.assemble`.
    """
    law, shared = of
    slope, hoop, volume = shapes
    forces, gradients, deformed = sums
    n, d = slope.shape[2:]
    of_cell, work = np.empty((n, d)), make_work(n * d)
    F, H, P = work.F, work.H, work.P
    for e in range(cells.shape[0]):
        gather(u, cells[e], of_cell)
        undeformed = 0.0
        for g in range(volume.shape[1]):
            fill_gradient(of_cell, slope[e, g], hoop[e, g], F)
            J = cofactor(F, H)
            undeformed += volume[e, g]
            deformed[e] += volume[e, g] * (J if J > 0.0 else np.nan)
        mean_stress = shared * law[BULK] * (deformed[e] / undeformed - 1.0)
        bulk = law[BULK] - shared * law[BULK]
        for g in range(volume.shape[1]):
            fill_gradient(of_cell, slope[e, g], hoop[e, g], F)
            cofactor(F, H)
            respond(law, bulk, (F, H), False, work.products, (P, work.A))
            for i in range(3):
                for j in range(3):
                    gradients[e, i, j] += volume[e, g] * F[i, j]
                    for k in range(3):
                        forces[e, i, j] += volume[e, g] * (P[i, k] + mean_stress * H[i, k]) * F[j, k]
