"""Kernels of Gauss-Seidel sweeps over blocks of 3 x 3, the displacements of a node.

All read a matrix by rows of blocks: `start` (n + 1,) of the rows among the blocks, `column` of each block,
rising within a row, and `block` (9 b,), the numbers of the blocks one after another; `inverse` (9 n,) has
those of the inverse diagonal blocks. Most of the time goes into reading `block`, so short numbers pay.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from soro_core._jit import inner, kernel
from soro_core.arrays import Array, Integers

Short = NDArray[np.float32]


@inner
def _times(block: Short, k: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return block k times (x, y, z)."""
    q = 9 * k
    return (
        block[q] * x + block[q + 1] * y + block[q + 2] * z,
        block[q + 3] * x + block[q + 4] * y + block[q + 5] * z,
        block[q + 6] * x + block[q + 7] * y + block[q + 8] * z,
    )


@kernel
def sweep_up(
    start: Integers, column: Integers, block: Short, inverse: Short, right: Array, found: Array
) -> None:
    """found (3 n,) <- one sweep from the first row to the last that starts from 0, for `right` (3 n,)."""
    for i in range(start.shape[0] - 1):
        a, b, c = right[3 * i], right[3 * i + 1], right[3 * i + 2]
        for k in range(start[i], start[i + 1]):
            j = column[k]
            # What follows is still 0.
            if j >= i:
                break
            x, y, z = _times(block, k, found[3 * j], found[3 * j + 1], found[3 * j + 2])
            a, b, c = a - x, b - y, c - z
        found[3 * i], found[3 * i + 1], found[3 * i + 2] = _times(inverse, i, a, b, c)


@kernel
def fill_residual(start: Integers, column: Integers, block: Short, found: Array, residual: Array) -> None:
    """residual (3 n,) <- right hand side less matrix times `found`, right after `sweep_up` from 0.

    What lies on and below the diagonal is met then, so this is what lies above, with the other sign.
    """
    for i in range(start.shape[0] - 1):
        a, b, c = 0.0, 0.0, 0.0
        for k in range(start[i + 1] - 1, start[i] - 1, -1):
            j = column[k]
            if j <= i:
                break
            x, y, z = _times(block, k, found[3 * j], found[3 * j + 1], found[3 * j + 2])
            a, b, c = a - x, b - y, c - z
        residual[3 * i], residual[3 * i + 1], residual[3 * i + 2] = a, b, c


@kernel
def sweep_down(
    start: Integers, column: Integers, block: Short, inverse: Short, right: Array, found: Array
) -> None:
    """found (3 n,) <- one sweep from the last row to the first that starts from it, for `right` (3 n,)."""
    for i in range(start.shape[0] - 2, -1, -1):
        a, b, c = right[3 * i], right[3 * i + 1], right[3 * i + 2]
        for k in range(start[i], start[i + 1]):
            j = column[k]
            if j == i:
                continue
            x, y, z = _times(block, k, found[3 * j], found[3 * j + 1], found[3 * j + 2])
            a, b, c = a - x, b - y, c - z
        found[3 * i], found[3 * i + 1], found[3 * i + 2] = _times(inverse, i, a, b, c)
