"""What makes one explicit Runge-Kutta method differ from another: its tableau.

Feeds kernels: the cache of soro_core._jit depends on this file too.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


class Tableau(NamedTuple):
    """Butcher's tableau, with the weights of the new state as the last row of the matrix."""

    nodes: Array
    """Places of the stages in the step, (n,)."""
    matrix: Array
    """(n + 1, n)."""
    error: Array
    """Weights of the error: those of the new state less those of a lower order, (n,)."""
    adaptive: bool
    """Whether the error controls the step; else it only stops a run that it shows to be nonsense."""
    same: bool
    """Whether the last stage is the new state, so that the next step finds its first stage done."""
    rtol: float
    """Relative tolerance of the error of one step."""


def tableau(
    nodes: list[float], matrix: list[list[float]], error: list[float], rtol: float | None = None
) -> Tableau:
    """Return a tableau from the rows of its triangle, the weights last; with `rtol` an adaptive one."""
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
