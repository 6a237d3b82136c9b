"""Tableaus of the explicit Runge-Kutta methods, parameters of one kernel.

Feeds kernels: the cache of soro_core._jit depends on this file too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array


class Tableau(NamedTuple):
    """Butcher tableau; the last row of the matrix holds the weights of the new state."""

    nodes: Array
    """Places of the stages in the step, (n,)."""
    matrix: Array
    """(n + 1, n)."""
    error: Array
    """Weights of the error: those of the new state minus those of a lower order, (n,)."""
    adaptive: bool
    """Whether the error controls the step; else a large error only ends the run."""
    same: bool
    """Whether the last stage is the new state, and so the first stage of the next step."""
    rtol: float
    """Relative tolerance of the error of one step."""


def tableau(
    nodes: list[float], matrix: list[list[float]], error: list[float], rtol: float | None = None
) -> Tableau:
    """Return a tableau.

    Parameters
    ----------
    nodes : list of n float
        Places of the stages in the step.
    matrix : list of n lists of float
        Rows of the triangle from the second stage on, then the weights of the new state.
    error : list of n float
        Weights of the new state minus those of a lower order.
    rtol : float, optional
        Relative tolerance of one step; default none, the method is not adaptive.
    """
    n = len(nodes)
    square = np.zeros((n + 1, n))
    for row, values in zip(square[1:], matrix, strict=True):
        row[: len(values)] = values
    return Tableau(
        np.array(nodes),
        square,
        np.array(error),
        rtol is not None,
        bool(nodes[-1] == 1.0 and (square[n] == square[n - 1]).all()),
        0.0 if rtol is None else rtol,
    )
