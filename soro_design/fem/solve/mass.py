"""Consistent mass of a part, and its modes about a loaded state, docs/design.md (13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_design.fem.elements.element import mean_products
from soro_design.fem.part import Part
from soro_design.fem.solve.equations import Equations
from soro_design.fem.solve.linear import factorised
from soro_design.fem.solve.states import EquilibriumState

# Modes are searched from this share of the mean stiffness over mass below 0: a free part has some at 0.
BELOW = 1e-9
# Greatest share of the stiffness that may lack symmetry.
SKEW = 1e-8


@dataclass(frozen=True, eq=False)
class VibrationModes:
    """Small vibrations about a state.

    Attributes
    ----------
    squared : ndarray, (m,)
        Squares of angular frequencies [rad2/s2], rising; below 0 where the state is not stable.
    shapes : ndarray, (m, n, d)
        Displacements of the nodes, of modal mass 1 [1/sqrt(kg)].
    """

    squared: Array
    shapes: Array

    @property
    def frequencies_hz(self) -> Array:
        """Frequencies (m,) [Hz]; NaN where the state is not stable."""
        return np.sqrt(np.where(self.squared >= 0.0, self.squared, np.nan)) / (2.0 * np.pi)


def mass_entries(part: Part) -> Array:
    """Return the consistent mass M_ab = int rho N_a N_b dV [kg] as entries in the pattern of the part."""
    shape, d = part.mesh.element.shape, part.mesh.points.shape[1]
    if part.mesh.kind == "tet10":
        each = np.einsum("eg,ab->eab", part.volume, mean_products("tet10"))
    else:
        each = np.einsum("eg,ga,gb->eab", part.volume, shape, shape)
    each *= part.material.density_kg_per_m3
    data = np.zeros(len(part.pattern.keys))
    for k in range(d):
        np.add.at(data, part.pattern.cells[:, k::d, k::d], each)
    return data


def modes(part: Part, state: EquilibriumState | None = None, count: int = 6) -> VibrationModes:
    """Return the lowest modes about a state.

    Parameters
    ----------
    part : Part
    state : EquilibriumState, optional
        In equilibrium; by default the undeformed part without loads.
    count : int
        Number of modes.

    Raises
    ------
    ModelError
        If there are fewer free displacements, no modes are found, or a pressure on an open surface has no
        potential.
    """
    equations = Equations(part)
    free = ~equations.is_held.ravel()
    if not 1 <= count < free.sum():
        raise ModelError(f"count {count}; allowed: 1 to {free.sum() - 1} modes", "count")
    u, load = (np.zeros_like(part.mesh.points), 0.0) if state is None else (state.u, state.load)
    K = part.stiffness(u, load)[free][:, free].tocsc()
    M = part.pattern.matrix(mass_entries(part))[free][:, free].tocsc()
    if abs(K - K.T).max() > SKEW * abs(K).max():
        raise ModelError("state under a pressure on an open surface; allowed: one with a potential", "state")
    shift = -BELOW * float(K.diagonal().sum() / M.diagonal().sum())
    solver = factorised((K - shift * M).tocsc(), is_solid=u.shape[1] == 3)
    if solver is None:
        raise ModelError("state of a singular stiffness; allowed: one near by", "state")
    inverse = LinearOperator(K.shape, solver.solve, dtype=float)
    try:
        found, vectors = eigsh(K, count, M, shift, OPinv=inverse, v0=np.ones(K.shape[0]))
    except ArpackNoConvergence:
        raise ModelError(f"count {count}: not all modes converge; ask for fewer", "count") from None
    order = np.argsort(found)
    shapes = np.zeros((count, u.size))
    shapes[:, free] = vectors.T[order]
    return VibrationModes(found[order], shapes.reshape(count, *u.shape))
