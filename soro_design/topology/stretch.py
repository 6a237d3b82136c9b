"""A limit on the stretch of a soft part, as a constraint of the optimisation; docs/design.md (T9a).

Elongations count by their density. The power mean of those in all three principal directions takes the
place of the greatest one: it is smooth, also where two directions change places. It is scaled by the greatest
elongation over it (C. Le, J. Norato, T. Bruns, C. Ha, D. Tortorelli, 2010), so that the limit is that of the
greatest one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_design.fem.solve.stretches import gradients
from soro_design.topology.physics.grid import Evaluation, Grid
from soro_design.topology.physics.stroke import Stroke

POWER = 10.0
# Elements from this density on are of the part; below the other one they are void: its stretch means nothing.
SOLID, FAINT = 0.5, 0.02
# The limit is left out as long as the greatest elongation is below this share of what is allowed.
WATCHED = 0.5


class Stretched(NamedTuple):
    """How far a part is stretched.

    Attributes
    ----------
    greatest : float
        Greatest principal stretch in the elements of the part.
    mean : float
        Power mean of the elongations, by volume and density.
    by_density : ndarray, (e,)
        Derivative of that mean where nothing moves.
    by_u : ndarray, (n, d)
        Its derivative by the displacements [1/m].
    """

    greatest: float
    mean: float
    by_density: Array
    by_u: Array


def stretched(grid: Grid, density: Array, u: Array) -> Stretched:
    """Return how far a part is stretched.

    Parameters
    ----------
    grid : Grid
        The grid.
    density : ndarray, (e,)
        Densities of the elements.
    u : ndarray, (n, d)
        Displacements [m].
    """
    is_there = density >= FAINT
    kind, rho = grid.kind[is_there], density[is_there]
    cells, slope, hoop = grid.mesh.cells[is_there], grid.slope[kind], grid.hoop[kind]
    left, stretch, right = np.linalg.svd(gradients(u[cells], slope, hoop))
    longer = np.maximum(stretch - 1.0, 0.0)
    share = (grid.volume[kind] / grid.volumes.sum())[:, :, None]
    by_element = (share * longer**POWER).sum(axis=(1, 2))
    total = float(rho**POWER @ by_element)
    is_part = rho >= SOLID
    greatest = float(stretch[is_part].max()) if is_part.any() else 1.0
    by_density, of_cells = np.zeros_like(density), np.zeros((*grid.mesh.cells.shape, u.shape[1]))
    if total == 0.0:
        return Stretched(greatest, 0.0, by_density, np.zeros_like(u))
    mean = total ** (1.0 / POWER)
    scale = mean ** (1.0 - POWER)
    by_density[is_there] = scale * rho ** (POWER - 1.0) * by_element
    by_stretch = scale * (rho**POWER)[:, None, None] * share * longer ** (POWER - 1.0)
    by_gradient = np.matmul(left * by_stretch[:, :, None, :], right)
    d = u.shape[1]
    of_cells[is_there] = np.einsum("egid,egad->eai", by_gradient[..., :d, :d], slope)
    of_cells[is_there, :, 0] += np.einsum("eg,ega->ea", by_gradient[..., 2, 2], hoop)
    by_u = np.stack([grid.gathered(of_cells[:, :, i]) for i in range(d)], axis=1)
    return Stretched(greatest, mean, by_density, by_u)


def slope_of_mean(found: Stroke, penalty: float, pressure_pa: float, density: Array, at: Evaluation) -> Array:
    """Return the derivative of the mean of `stretched` by the densities (e,), of a part at rest.

    Parameters
    ----------
    found : Stroke
        What the task is computed with.
    penalty : float
        Exponent of the stiffness.
    pressure_pa : float
        Of the inlet.
    density : ndarray, (e,) or (2 e,)
        Densities of the elements, and their shares of a second material.
    at : Evaluation
        Of the same part.
    """
    n = len(found.grid.kind)
    here = stretched(found.grid, density[:n], at.u)
    # With the exponent 0 the goal is minus the motion of an output: this one has the weights of the mean.
    weights = np.where(found.is_held, 0.0, here.by_u)
    moved = replace(found, output=weights, exponent=0.0).evaluate(density, penalty, pressure_pa, at.u)
    return np.asarray(np.pad(here.by_density, (0, len(density) - n)) - moved.gradient)


def limit_of(greatest: float, limit: float) -> float:
    """Return by how much a stretch is beyond a limit, as a share of the elongation that is allowed."""
    return (greatest - 1.0) / (limit - 1.0) - 1.0
