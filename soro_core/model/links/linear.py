"""Small dense algebra that writes into given arrays.

LAPACK's call costs more than the work for a few unknowns; and an array assignment compiles a second of
checks of its shapes, where a loop compiles none.
"""

from __future__ import annotations

import math

import numpy as np

from soro_core._jit import inner
from soro_core.arrays import Array, Integers

# A pivot is the difference of an entry and some terms. Below this part of them it is their round-off, and the
# matrix singular. No unit of a row or column changes that part.
ROUND_OFF = 1e-12


@inner
def clear(x: Array) -> None:
    """x <- 0, one index."""
    for i in range(x.shape[0]):
        x[i] = 0.0


@inner
def clear_matrix(A: Array) -> None:
    """A <- 0, two indices."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            A[i, j] = 0.0


@inner
def assign(source: Array, x: Array) -> None:
    """x <- source, one index."""
    for i in range(x.shape[0]):
        x[i] = source[i]


@inner
def assign_matrix(source: Array, A: Array) -> None:
    """A <- source, two indices."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            A[i, j] = source[i, j]


@inner
def cholesky_solve(A: Array, x: Array) -> bool:
    """x <- A^-1 x for a positive definite A, whose lower triangle is overwritten; False if it is not."""
    n = x.shape[0]
    for j in range(n):
        d = A[j, j]
        least = ROUND_OFF * d
        for k in range(j):
            d -= A[j, k] * A[j, k]
        if not 0.0 < d < math.inf or d <= least:
            return False
        d = math.sqrt(d)
        A[j, j] = d
        for i in range(j + 1, n):
            e = A[i, j]
            for k in range(j):
                e -= A[i, k] * A[j, k]
            A[i, j] = e / d
    for i in range(n):
        for k in range(i):
            x[i] -= A[i, k] * x[k]
        x[i] /= A[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= A[k, i] * x[k]
        x[i] /= A[i, i]
    return True


@inner
def lu_factor(A: Array, pivots: Integers) -> bool:
    """A <- L and U with row pivots; False if A is singular or not finite."""
    n = A.shape[0]
    left = np.empty(n)  # of the terms of each pivot: what is little multiplies the round-off behind it
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[best, k]):
                best = i
        pivots[k] = best
        size, terms, doubt = abs(A[best, k]), 0.0, 0.0
        for j in range(k):
            term = abs(A[best, j] * A[j, k])
            terms += term
            doubt += term / left[j]
        if not ROUND_OFF * doubt < size < math.inf:
            return False
        left[k] = 1.0 if size >= terms else size / terms
        if best != k:
            for j in range(n):
                A[k, j], A[best, j] = A[best, j], A[k, j]
        for i in range(k + 1, n):
            A[i, k] /= A[k, k]
            for j in range(k + 1, n):
                A[i, j] -= A[i, k] * A[k, j]
    return True


@inner
def lu_solve(A: Array, pivots: Integers, x: Array) -> None:
    """x <- A^-1 x with the factors of `lu_factor`."""
    n = x.shape[0]
    for k in range(n):
        best = pivots[k]
        x[k], x[best] = x[best], x[k]
    for i in range(n):
        for k in range(i):
            x[i] -= A[i, k] * x[k]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= A[i, k] * x[k]
        x[i] /= A[i, i]


@inner
def lu_solve_rows(A: Array, pivots: Integers, X: Array) -> None:
    """X <- A^-1 X, all columns, with the factors of `lu_factor`."""
    n, m = A.shape[0], X.shape[1]
    for k in range(n):
        best = pivots[k]
        if best != k:
            for c in range(m):
                X[k, c], X[best, c] = X[best, c], X[k, c]
    for i in range(n):
        for k in range(i):
            f = A[i, k]
            for c in range(m):
                X[i, c] -= f * X[k, c]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            f = A[i, k]
            for c in range(m):
                X[i, c] -= f * X[k, c]
        f = 1.0 / A[i, i]
        for c in range(m):
            X[i, c] *= f
