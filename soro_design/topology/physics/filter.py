"""Density filter and projection: from the design variables to the densities of the elements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator

from soro_core.arrays import Array
from soro_design.topology.physics.grid import Grid


def density_filter(grid: Grid, radius_m: float) -> LinearOperator:
    """Return the weighted mean (e, e) over the neighbours, docs/design.md (T1), and its transpose.

    Neighbours of all elements lie alike, so their sums are a convolution. It is summed place by place: a
    matrix has 1,800 entries a row where an element is 1/24 of the radius, and Fourier's transform leaves
    rounding where the derivative is 0, which then moves elements that nothing moves.

    Parameters
    ----------
    grid : Grid
        The grid.
    radius_m : float
        Distance at which the weight falls to zero [m].
    """
    reach = [int(radius_m / edge) for edge in grid.edge_m]
    places = np.indices([2 * n + 1 for n in reach]).reshape(len(reach), -1).T
    distance = np.linalg.norm((places - reach) * np.asarray(grid.edge_m), axis=1)
    weights = [(place, radius_m - at) for place, at in zip(places, distance, strict=True) if at < radius_m]

    def summed(x: Array) -> Array:
        around = np.pad(x.reshape(grid.counts), [(n, n) for n in reach])
        found = np.zeros(grid.counts)
        for place, weight in weights:
            found += weight * around[tuple(slice(i, i + n) for i, n in zip(place, grid.counts, strict=True))]
        return found.ravel()

    volumes = grid.volumes
    total = summed(volumes)
    return LinearOperator(
        (len(volumes), len(volumes)),
        matvec=lambda x: summed(volumes * x.ravel()) / total,
        rmatvec=lambda y: volumes * summed(y.ravel() / total),
        dtype=float,
    )


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


def of_each(filters: list[LinearOperator]) -> LinearOperator:
    """Return the operator of fields that stand behind each other, from that (e, e) of each."""
    if len(filters) == 1:
        return filters[0]

    def applied(operators: list[Any]) -> Callable[[Array], Array]:
        return lambda x: np.concatenate(
            [one @ part for one, part in zip(operators, np.split(np.ravel(x), len(operators)), strict=True)]
        )

    n = sum(one.shape[0] for one in filters)
    back = applied([one.T for one in filters])
    return LinearOperator((n, n), matvec=applied(filters), rmatvec=back, dtype=float)


def greyness(density: Array) -> float:
    """Return the mean of 4 rho (1 - rho): 0 of a part without half densities, 1 where all are half."""
    return float(np.mean(4.0 * density * (1.0 - density)))


def stiffening(share: Array, penalty: float, times: float) -> tuple[Array, Array]:
    """Return how many times as stiff as the material elements are, and its derivative by the share.

    Parameters
    ----------
    share : ndarray, (e,)
        Of the stiffer material in each, from 0 to 1.
    penalty : float
        Exponent.
    times : float
        Of an element of the stiffer material alone.
    """
    more = times - 1.0
    return 1.0 + more * share**penalty, more * penalty * share ** (penalty - 1.0)


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
