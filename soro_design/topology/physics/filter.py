"""Density filter and projection: from the design variables to the densities of the elements."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, diags
from scipy.spatial import cKDTree

from soro_core.arrays import Array
from soro_design.topology.physics.grid import Grid


def density_filter(grid: Grid, radius_m: float) -> Any:
    """Return the matrix (e, e) of a weighted mean over the neighbours, docs/design.md (T1).

    Parameters
    ----------
    grid : Grid
        The grid.
    radius_m : float
        Distance at which the weight falls to zero [m].
    """
    centres = grid.centres
    pairs = cKDTree(centres).sparse_distance_matrix(cKDTree(centres), radius_m, output_type="coo_matrix")
    n = len(centres)
    # The distance of an element to itself, 0, is left out of a sparse matrix.
    at = np.arange(n)
    weight = np.concatenate([radius_m - pairs.data, np.full(n, radius_m)])
    is_other = np.concatenate([pairs.row != pairs.col, np.ones(n, dtype=bool)])
    rows, columns = np.concatenate([pairs.row, at]), np.concatenate([pairs.col, at])
    weights = csr_matrix((weight[is_other], (rows[is_other], columns[is_other])), shape=(n, n))
    weights = weights @ diags(grid.volumes)
    return diags(1.0 / np.asarray(weights.sum(axis=1)).ravel()) @ weights


def projection(x: Array, sharpness: float, threshold: float) -> tuple[Array, Array]:
    """Return the smooth step from 0 to 1 at a threshold and its derivative, docs/design.md (T2).

    Parameters
    ----------
    x : ndarray
        Values from 0 to 1.
    sharpness : float
        Slope of the step; 0 leaves the values as they are.
    threshold : float
        Place of the step.
    """
    if sharpness == 0.0:
        return x, np.ones_like(x)
    low, high = np.tanh(sharpness * threshold), np.tanh(sharpness * (1.0 - threshold))
    inner = np.tanh(sharpness * (x - threshold))
    return (low + inner) / (low + high), sharpness * (1.0 - inner**2) / (low + high)


def greyness(density: Array) -> float:
    """Return the mean of 4 rho (1 - rho): 0 of a part without half densities, 1 where all are half."""
    return float(np.mean(4.0 * density * (1.0 - density)))


# Where an element begins to count as solid, and how suddenly.
SOLID_FROM, SOLID_SHARPNESS = 0.01, 500.0


def interpolation(density: Array, penalty: float, void_stiffness: float) -> tuple[Array, Array, Array, Array]:
    """Return kappa, gamma and their derivatives by density.

    Parameters
    ----------
    density : ndarray, (e,)
        Densities of the elements.
    penalty : float
        Exponent of the stiffness.
    void_stiffness : float
        Stiffness of void over that of solid.
    """
    power = density**penalty
    slope = penalty * density ** (penalty - 1.0)
    gamma, by_power = projection(power, SOLID_SHARPNESS, SOLID_FROM)
    rest = 1.0 - void_stiffness
    return void_stiffness + rest * power, gamma, rest * slope, by_power * slope
