"""Linear stiffness under the pressure of the air: the arch that codes of topology optimisation compare."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import ModelError
from soro_design.fem.solve.dissection import order_among
from soro_design.fem.solve.linear import regular_factors
from soro_design.topology.physics.darcy import Flow, pressures
from soro_design.topology.physics.grid import Evaluation, Grid, assembled


@dataclass(frozen=True, eq=False)
class Compliance:
    """Work of the pressure on a linear part in plane stress, docs/design.md (T5).

    Attributes
    ----------
    grid : Grid
        The grid.
    flow : Flow
        How densities let air through.
    held : ndarray, (n,)
        Given pressures as a share of that of the inlet, else NaN.
    is_held : ndarray of bool, (n, 2)
        Directions in which nodes do not move.
    youngs_modulus_pa, poisson_ratio : float
        Of solid.
    void_stiffness : float
        Stiffness of void over that of solid.
    """

    grid: Grid
    flow: Flow
    held: Array
    is_held: Flags
    youngs_modulus_pa: float
    poisson_ratio: float
    void_stiffness: float

    def evaluate(self, density: Array, penalty: float, pressure_pa: float) -> Evaluation:
        """Return u . K u [J/m] with its gradient.

        Parameters
        ----------
        density : ndarray, (e,)
            Densities of the elements.
        penalty : float
            Exponent of the stiffness.
        pressure_pa : float
            Of the inlet.
        """
        grid = self.grid
        air = pressures(grid, self.flow, density, pressure_pa * self.held)
        cells = grid.mesh.cells
        load = self._load()
        force = np.zeros_like(grid.mesh.points)
        np.add.at(force, cells, (air.at_nodes[cells] @ load.T).reshape(-1, 4, 2))
        one = self._stiffness()
        scale = self.void_stiffness + (1.0 - self.void_stiffness) * density**penalty
        matrix = assembled(grid.vectors, scale[:, None, None] * one)
        free = np.flatnonzero(~self.is_held.ravel())
        order = order_among(grid.order, free)
        solver = regular_factors(matrix[free][:, free].tocsc(), order=order)
        if solver is None:
            raise ModelError("the part is loose: hold it against every motion", "held")
        u = np.zeros_like(force)
        u.ravel()[free] = solver.solve(force.ravel()[free])
        of_cells = u[cells].reshape(len(cells), 8)
        energy = np.einsum("ei,ij,ej->e", of_cells, one, of_cells)
        by_density = -(1.0 - self.void_stiffness) * penalty * density ** (penalty - 1.0) * energy
        gradient = by_density + air.back(grid.gathered(2.0 * of_cells @ load))
        return Evaluation(float(scale @ energy), gradient, np.nan, u, air.at_nodes, 0.0)

    def _load(self) -> Array:
        """Forces (8, 4) of unit pressures of the nodes: -int N dp/dX dV."""
        grid = self.grid
        by_node = -np.einsum("g,ga,gbk->akb", grid.volume[0], grid.shape, grid.slope[0])
        return np.asarray(by_node.reshape(8, 4))

    def _stiffness(self) -> Array:
        """Stiffness (8, 8) of a solid element."""
        nu = self.poisson_ratio
        strain = np.zeros((len(self.grid.shape), 3, 8))
        x, y = np.moveaxis(self.grid.slope[0], 2, 0)
        strain[:, 0, 0::2] = strain[:, 2, 1::2] = x
        strain[:, 1, 1::2] = strain[:, 2, 0::2] = y
        law = np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - nu)]])
        law *= self.youngs_modulus_pa / (1.0 - nu**2)
        return np.asarray(np.einsum("g,gci,cd,gdj->ij", self.grid.volume[0], strain, law, strain))
