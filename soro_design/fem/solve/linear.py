"""Factors of sparse matrices of symmetric pattern: by SuperLU, or by pardiso where it is there and pays."""

from __future__ import annotations

import contextlib
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
from scipy.sparse import triu
from scipy.sparse.linalg import splu

from soro_core.arrays import Array

# Entries above this share of their column may stay pivots of the diagonal.
PIVOT = 1e-3
# A part that a force moves so many times further than each node alone can move freely.
LOOSE = 1e13
# Rows from which pardiso pays for a solid.
MANY = 15_000
# Greatest share by which a matrix may lack symmetry and still count as symmetric.
SKEW = 1e-13


class Factors(Protocol):
    """A factorised matrix."""

    def solve(self, right: Array) -> Array:
        """Return the solution (n,) for a right hand side (n,)."""


class _SuperLU:
    """Factors by SuperLU, with an ordering for symmetric patterns."""

    def __init__(self, matrix: Any) -> None:
        options = {"SymmetricMode": True}
        self._lu = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=PIVOT, options=options)

    def solve(self, right: Array) -> Array:
        return np.asarray(self._lu.solve(right))


class _Pardiso:
    """Factors by pardiso of the Math Kernel Library, of one half where the matrix is symmetric."""

    def __init__(self, matrix: Any) -> None:
        from pypardiso import PyPardisoSolver

        rows = matrix.tocsr()
        is_symmetric = abs(rows - rows.T).max() <= SKEW * abs(rows).max()
        self._matrix = triu(rows, format="csr") if is_symmetric else rows
        self._solver = PyPardisoSolver(mtype=-2 if is_symmetric else 1)
        # Numbers of our own; nested dissection; refinement; the least pivot 1e-13 of the norm.
        for place, value in ((1, 1), (2, 2), (8, 2), (10, 13)):
            self._solver.set_iparm(place, value)
        self._solver.factorize(self._matrix)

    def solve(self, right: Array) -> Array:
        return np.asarray(self._solver.solve(self._matrix, right))

    def __del__(self) -> None:
        with contextlib.suppress(Exception):
            self._solver.free_memory(everything=True)


def factorised(matrix: Any, is_solid: bool = False) -> Factors | None:
    """Return the factors of a sparse matrix whose pattern is symmetric, or None where a pivot is 0.

    Parameters
    ----------
    matrix : sparse array, (n, n)
        By columns.
    is_solid : bool
        Whether it is that of a solid: then pardiso is used above some size, if it is installed.
    """
    has_pardiso = is_solid and matrix.shape[0] >= MANY and find_spec("pypardiso") is not None
    try:
        return _Pardiso(matrix) if has_pardiso else _SuperLU(matrix)
    # Of SuperLU; that of pardiso is an own kind.
    except RuntimeError:
        return None


def regular_factors(matrix: Any, is_solid: bool = False) -> Factors | None:
    """Return the factors, or None where it is singular, by how far some force moves its rows.

    Of a pivot that is 0, round-off mostly leaves something, and a solution that means nothing. Newton's
    method needs no such measure, because its balance decides. Parameters as in `factorised`.
    """
    factors = factorised(matrix, is_solid)
    if factors is None:
        return None
    scale = np.sqrt(np.abs(matrix.diagonal()))
    force = np.random.default_rng(0).normal(size=len(scale))
    moved = np.linalg.norm(scale * factors.solve(scale * force))
    return factors if moved < LOOSE * np.linalg.norm(force) else None
