"""Levels of smoothed aggregation (Vanek, Mandel and Brezina, Computing 56 (1996) 179-196), and their V-cycle.

Nodes are gathered with their neighbours, by pyamg; those that are together move as a rigid body, smoothed by
one step of Jacobi's method. A cycle sweeps once up and once down on each level, by numbers of single
precision, since it only has to be near the inverse (docs/adr, 0077).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import bsr_array, csr_array

from soro_core.arrays import Array, Integers
from soro_design.fem.multigrid.sweeps import Short, fill_residual, sweep_down, sweep_up

# Equations that are solved directly on the coarsest level.
COARSEST = 600
# Numbers of a node, and motions of a rigid body, which are the numbers of a node on coarser levels.
NODE, BODY = 3, 6
# Step of Jacobi's method over the greatest eigenvalue, and products that find it: 20 % of it change little.
STEP, PRODUCTS = 4.0 / 3.0, 10


@dataclass(frozen=True, eq=False)
class Level:
    """Equations of one level and the way to the next coarser one.

    Attributes
    ----------
    start, column : ndarray of int
        First block of each row, and column of each block.
    block, inverse : ndarray, (9 b,) and (9 n / 3,)
        Numbers of the blocks and of the inverse diagonal ones, of single precision.
    down, up : sparse array, (m, n) and (n, m)
        From forces of this level to those of the coarser one, and from its displacements back.
    """

    start: Integers
    column: Integers
    block: Short
    inverse: Short
    down: Any
    up: Any


class Levels:
    """A symmetric stiffness on all levels.

    Parameters
    ----------
    matrix : bsr_array, (n, n)
        In blocks of 3 x 3.
    motions : ndarray, (n, 6)
        Of a rigid body, 0 where a node is held.
    """

    def __init__(self, matrix: Any, motions: Array) -> None:
        self._levels: list[Level] = []
        while matrix.shape[0] > COARSEST:
            level, coarse, motions = _coarsened(matrix, motions, BODY if self._levels else NODE)
            # Bodies apart are not gathered.
            if coarse.shape[0] >= matrix.shape[0]:
                break
            self._levels.append(level)
            matrix = coarse
        # Nodes that are gathered and all held do not move: rows of 0.
        self._inverse = np.linalg.pinv(matrix.toarray(), hermitian=True)

    def cycle(self, right: Array, depth: int = 0) -> Array:
        """Return what is near the solution (n,) for a right hand side (n,) of a level, the finest by default.

        It is linear in `right`, and symmetric: what `sweep_down` does mirrors `sweep_up`.
        """
        if depth == len(self._levels):
            return np.asarray(self._inverse @ right)
        level = self._levels[depth]
        found, residual = np.empty_like(right), np.empty_like(right)
        sweep_up(level.start, level.column, level.block, level.inverse, right, found)
        fill_residual(level.start, level.column, level.block, found, residual)
        found += level.up @ self.cycle(level.down @ residual, depth + 1)
        sweep_down(level.start, level.column, level.block, level.inverse, right, found)
        return found


def _coarsened(matrix: Any, motions: Array, size: int) -> tuple[Level, Any, Array]:
    """Return a level, and the matrix and the motions of a rigid body of the coarser one.

    `size`: numbers of a node.
    """
    from pyamg.aggregation.aggregate import standard_aggregation
    from pyamg.aggregation.tentative import fit_candidates

    matrix.sort_indices()
    nodes = matrix.tobsr(blocksize=(size, size))
    joined = csr_array((np.ones(len(nodes.indices)), nodes.indices, nodes.indptr))
    rigid, motions = fit_candidates(standard_aggregation(joined)[0], motions)
    rigid = rigid.tobsr(blocksize=(NODE, BODY))
    inverse = _inverse_diagonal(matrix)
    each = np.arange(len(inverse) + 1)
    # The product with a few columns first: that of two large matrices is slow.
    bent = bsr_array((inverse, each[:-1], each), shape=matrix.shape) @ (matrix @ rigid)
    up = (rigid - STEP / _greatest(matrix, inverse) * bent).tobsr(blocksize=(NODE, BODY))
    down = up.T.tobsr(blocksize=(BODY, NODE))
    block, inverse_block = (a.astype(np.float32).ravel() for a in (matrix.data, inverse))
    level = Level(matrix.indptr, matrix.indices, block, inverse_block, down, up)
    return level, (down @ (matrix @ up)).tobsr(blocksize=(NODE, NODE)), motions


def _inverse_diagonal(matrix: Any) -> Array:
    """Return the inverse diagonal blocks (n / 3, 3, 3), with 0 where nothing moves."""
    n = len(matrix.indptr) - 1
    row = np.repeat(np.arange(n), np.diff(matrix.indptr))
    is_diagonal = row == matrix.indices
    found = np.zeros((n, NODE, NODE))
    found[row[is_diagonal]] = matrix.data[is_diagonal]
    return np.asarray(np.linalg.pinv(found, hermitian=True), dtype=float)


def _greatest(matrix: Any, inverse: Array) -> float:
    """Return about the greatest eigenvalue of a matrix over its diagonal blocks.

    From the same random numbers each time, so that solutions are the same to the last bit.
    """
    found = np.random.default_rng(0).normal(size=matrix.shape[0])
    for _ in range(PRODUCTS):
        product = matrix @ (found / np.linalg.norm(found))
        found = np.einsum("nij,nj->ni", inverse, product.reshape(-1, NODE)).ravel()
    return float(np.linalg.norm(found))
