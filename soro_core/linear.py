"""Systems of linear equations that are solved only where a measure says that they can be.

LAPACK reports a singular matrix where a pivot is exactly 0. Whether one is depends on round-off, which each
kernel of the library makes in its own way; elsewhere the solution is finite and means nothing. Here the
reciprocal condition decides.
"""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array

# Reciprocal condition from which a matrix counts as regular: below, round-off decides the solution.
LEAST = 1e-14


def inverse(matrix: Array, least: float = LEAST, of: Array | None = None) -> Array:
    """Return the inverse of a regular matrix.

    Parameters
    ----------
    matrix : ndarray (n, n)
    least : float
        Reciprocal condition, in the norm of column sums, from which it is regular.
    of : ndarray (m, m), optional
        What it is a part of, with whose size it is compared, where all entries have one unit. By default they
        may have several: the measure is that of rows and columns divided by their largest entries.

    Raises
    ------
    LinAlgError
        If it is singular, or not finite.
    """
    found = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    with np.errstate(all="ignore"):  # what is not finite is not regular
        condition = _condition(*_scaled(matrix, found)) if of is None else _condition(of, found)
        if not condition * least <= 1.0:
            raise np.linalg.LinAlgError(f"the matrix is singular: its condition is {condition:.1e}")
    return found


def solve(matrix: Array, right: Array, least: float = LEAST, of: Array | None = None) -> Array:
    """Return the solution x (n, ...) of `matrix` x = `right`.

    Parameters
    ----------
    matrix, least, of : ndarray (n, n), float, ndarray or None
        As in `inverse`, which says what is refused.
    right : ndarray (n, ...)
    """
    inverse(matrix, least, of)
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)


def _condition(matrix: Array, found: Array) -> float:
    """Return the product of the norms of a matrix and an inverse."""
    return float(np.abs(matrix).sum(axis=0).max() * np.abs(found).sum(axis=0).max())


def _scaled(matrix: Array, found: Array) -> tuple[Array, Array]:
    """Return a matrix with its rows and columns scaled to 1, and the inverse that goes with it."""
    rows = np.abs(matrix).max(axis=1)
    matrix = matrix / rows[:, None]
    columns = np.abs(matrix).max(axis=0)
    return matrix / columns, found * columns[:, None] * rows
