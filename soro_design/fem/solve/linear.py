"""Solutions with sparse matrices of symmetric pattern: SuperLU, pardiso, and multigrid of large solids."""

from __future__ import annotations

import contextlib
import functools
import logging
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
from scipy.sparse import triu
from scipy.sparse.linalg import LinearOperator, gmres, splu

from soro_core.arrays import Array, Integers
from soro_design.fem.solve.multigrid import Multigrid

# Entries above this share of their column may stay pivots of the diagonal.
PIVOT = 1e-3
# A part that a force moves so many times further than each node alone can move freely.
LOOSE = 1e13
# Rows from which pardiso pays for a solid, and from which multigrid does.
MANY, LARGE = 15_000, 20_000
# Most steps of GMRES for a digit of a solution: where it takes more, new factors take less time.
STEPS_A_DIGIT, MOST_DIGITS = 3, 12
# Greatest share by which a matrix may lack symmetry and still count as symmetric.
SKEW = 1e-13


class Factors(Protocol):
    """A factorised matrix, or one that iterations solve."""

    is_direct: bool
    """Whether it is factorised: then a solution takes a small share of the time for the factors."""

    def solve(self, right: Array) -> Array:
        """Return the solution (n,) for a right hand side (n,)."""


class _SuperLU:
    """Factors by SuperLU, in a given order or in one for symmetric patterns."""

    is_direct = True

    def __init__(self, matrix: Any, order: Integers | None) -> None:
        self._order = slice(None) if order is None else order
        kind = "MMD_AT_PLUS_A" if order is None else "NATURAL"
        rows = matrix if order is None else matrix[:, order][order].tocsc()
        options = {"SymmetricMode": True}
        self._lu = splu(rows, permc_spec=kind, diag_pivot_thresh=PIVOT, options=options)

    def solve(self, right: Array) -> Array:
        found = np.empty_like(right)
        found[self._order] = self._lu.solve(right[self._order])
        return found


class _Pardiso:
    """Factors by pardiso of the Math Kernel Library, of one half where the matrix is symmetric."""

    is_direct = True

    def __init__(self, matrix: Any) -> None:
        from pypardiso import PyPardisoSolver

        rows, is_symmetric = matrix.tocsr(), _is_symmetric(matrix)
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


def _is_symmetric(matrix: Any) -> bool:
    # Products from both sides with random numbers: the difference of the matrices takes 20 times as long.
    some = np.random.default_rng(0).normal(size=matrix.shape[0])
    off = np.abs(matrix @ some - matrix.T @ some).max()
    return bool(off <= SKEW * np.abs(matrix.data).max())


@functools.cache
def _advise(rows: int) -> None:
    """Say once that another package is quicker."""
    logging.getLogger("soro_design").warning(
        "soro: %d displacements take long; quicker: pip install 'soro[multigrid]' (or 'soro[pardiso]')",
        rows,
    )


def factorised(
    matrix: Any, is_solid: bool = False, motions: Array | None = None, order: Integers | None = None
) -> Factors | None:
    """Return the factors of a sparse matrix whose pattern is symmetric, or None where a pivot is 0.

    Parameters
    ----------
    matrix : sparse array, (n, n)
        By columns.
    is_solid : bool
        Whether it is that of a solid: then pardiso is used above some size, if it is installed.
    motions : ndarray, (n, 6), optional
        Rigid motions of a solid: then, without pardiso, multigrid is used from some size on, if installed.
    order : ndarray of int, (n,), optional
        Rows in an order that keeps the factors sparse (`soro_design.fem.solve.dissection`), for SuperLU.
    """
    rows = matrix.shape[0]
    try:
        if is_solid and rows >= MANY and find_spec("pypardiso"):
            return _Pardiso(matrix)
        if motions is not None and rows >= LARGE:
            if find_spec("pyamg"):
                return Multigrid(matrix, motions, _is_symmetric(matrix))
            _advise(rows)
        return _SuperLU(matrix, order)
    # Of SuperLU; that of pardiso is an own kind.
    except RuntimeError:
        return None


class KeptFactors:
    """Factors of one matrix, which precondition GMRES for those near by; new ones where that takes long."""

    def __init__(self) -> None:
        self._factors: Factors | None = None

    def solve(
        self, matrix: Any, right: Array, tolerance: float, factorise: Callable[[Any], Factors | None]
    ) -> Array | None:
        """Return the solution (n,), or None where the matrix is singular.

        Parameters
        ----------
        matrix : sparse array, (n, n)
            By columns.
        right : ndarray, (n,)
            Right hand side.
        tolerance : float
            Greatest residual of GMRES over the right hand side; new factors leave what rounding leaves.
        factorise : callable
            From a matrix (n, n) to its factors, or None where a pivot is 0.
        """
        kept = self._factors
        # Where nothing or no number is asked for, no iteration ends.
        if kept is not None and kept.is_direct and tolerance > 0.0 and np.isfinite(right).all():
            product = LinearOperator(matrix.shape, lambda x: matrix @ kept.solve(x), dtype=float)
            most = int(STEPS_A_DIGIT * min(-np.log10(tolerance), MOST_DIGITS))
            found, failed = gmres(product, right, rtol=tolerance, atol=0.0, restart=most, maxiter=1)
            if not failed:
                return np.asarray(kept.solve(found))
        # Large factors go before the next ones come.
        self._factors = kept = None
        self._factors = factorise(matrix)
        return None if self._factors is None else self._factors.solve(right)


def regular_factors(
    matrix: Any, is_solid: bool = False, motions: Array | None = None, order: Integers | None = None
) -> Factors | None:
    """Return the factors, or None where it is singular, by how far some force moves its rows.

    Of a pivot that is 0, round-off mostly leaves something, and a solution that means nothing. Newton's
    method needs no such measure, because its balance decides; parameters as in `factorised`.
    """
    factors = factorised(matrix, is_solid, motions, order)
    if factors is None:
        return None
    scale = np.sqrt(np.abs(matrix.diagonal()))
    force = np.random.default_rng(0).normal(size=len(scale))
    moved = np.linalg.norm(scale * factors.solve(scale * force))
    return factors if moved < LOOSE * np.linalg.norm(force) else None
