"""Pressure of the air in a part that is not yet solid or void: Darcy flow with drainage (Kumar et al. 2020).

Void lets the air through, solid hardly does, and drains what comes in: so the pressure falls within a short
way into a wall. docs/design.md (T3) and (T4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError
from soro_design.fem.solve.linear import regular_factors
from soro_design.topology.physics.filter import projection
from soro_design.topology.physics.grid import Grid, assembled


@dataclass(frozen=True)
class Flow:
    """How densities let air through.

    Attributes
    ----------
    threshold, sharpness : float
        Density at which a wall becomes tight, and how suddenly.
    contrast : float
        Conductivity of solid over that of void.
    depth_m : float
        Way into a wall [m] within which the pressure falls to `rest` of that outside.
    rest : float
        That share.
    """

    threshold: float
    sharpness: float
    contrast: float
    depth_m: float
    rest: float = 0.1

    def __post_init__(self) -> None:
        if not (self.depth_m > 0.0 and 0.0 < self.contrast < 1.0 and 0.0 < self.rest < 1.0):
            raise ModelError(f"{self}; allowed: depth above 0, contrast and rest between 0 and 1", "flow")

    def coefficients(self, density: Array) -> tuple[Array, Array, Array, Array]:
        """Return conductivity and drainage [1/m2] of elements, and their derivatives by density."""
        step, slope = projection(density, self.sharpness, self.threshold)
        drain = (np.log(self.rest) / self.depth_m) ** 2 * self.contrast
        return 1.0 - (1.0 - self.contrast) * step, drain * step, (self.contrast - 1.0) * slope, drain * slope


@dataclass(frozen=True, eq=False)
class PressureField:
    """A field of pressure.

    Attributes
    ----------
    at_nodes : ndarray, (n,)
        Pressure of the nodes [Pa].
    """

    at_nodes: Array
    _solver: Any
    _grid: Grid
    _flow: Flow
    _density: Array
    _free: Integers

    def back(self, by_pressure: Array) -> Array:
        """Return the derivative of a number by the densities (e,) from that by the pressures (n,)."""
        adjoint = np.zeros_like(self.at_nodes)
        adjoint[self._free] = self._solver.solve(by_pressure[self._free])
        cells, kind = self._grid.mesh.cells, self._grid.kind
        p, y = self.at_nodes[cells], adjoint[cells]
        by_conductivity = np.einsum("ea,eab,eb->e", y, self._grid.diffusion[kind], p)
        by_drainage = np.einsum("ea,eab,eb->e", y, self._grid.mass[kind], p)
        _, _, conductivity, drainage = self._flow.coefficients(self._density)
        return np.asarray(-conductivity * by_conductivity - drainage * by_drainage)


def pressures(grid: Grid, flow: Flow, density: Array, held_pa: Array) -> PressureField:
    """Return the pressure field of densities.

    Parameters
    ----------
    grid : Grid
        The grid.
    flow : Flow
        How densities let air through.
    density : ndarray, (e,)
        Densities of the elements.
    held_pa : ndarray, (n,)
        Pressure of nodes at the inlet and in the open [Pa], NaN elsewhere.
    """
    conductivity, drainage, _, _ = flow.coefficients(density)
    of_cells = conductivity[:, None, None] * grid.diffusion[grid.kind]
    of_cells += drainage[:, None, None] * grid.mass[grid.kind]
    matrix = assembled(grid.scalars, of_cells)
    free = np.flatnonzero(np.isnan(held_pa))
    if len(free) == len(held_pa):
        raise ModelError("no node has a given pressure; allowed: an inlet and an open edge", "inlet")
    p = np.nan_to_num(held_pa)
    rows = matrix[free]
    solver = regular_factors(rows[:, free].tocsc(), is_solid=grid.mesh.space == "solid")
    if solver is None:
        raise ModelError("the flow has no solution: part of the grid is cut off from every edge", "flow")
    p[free] = solver.solve(-(rows @ p))
    return PressureField(p, solver, grid, flow, density, free)
