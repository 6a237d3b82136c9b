"""Information about theta and what it says of theta, compiled (`soro_core.adaptation.learner`).

With the residual r and the regressor Phi of a sample of noise S, both of a low-pass of rate a,

    A' = (a / 2) Phi' S^-1 Phi - forget (A - A_0),    b' = (a / 2) Phi' S^-1 r - forget b,    A theta = b.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from soro_core._jit import entry, inner
from soro_core.arrays import Array
from soro_core.model.links.linear import lu_factor, lu_solve_rows

# Information whose condition is worse than this is singular.
_SINGULAR = 1e14


class LearningRule(NamedTuple):
    """How the learner weighs and forgets what it learns; `size` values of n coordinates."""

    low_pass_per_s: float
    """Rate of the low-pass."""
    forget_s: float
    """Time constant with which the information returns to the prior."""
    forget_factor: float
    """Most by which a sample that does not fit speeds this up."""
    walk: float
    """Variance a second by which the mass moves where a sample does not fit [kg^2/s]."""
    prior: Array
    """A_0, (size, size)."""
    noise: Array
    """Noise of a sample whose q is known, (n, n)."""
    slope: Array
    """B, slope of the static force by q, in units of force: (n, n)."""


RuleFields: TypeAlias = tuple[float, float, float, float, Array, Array, Array]
"""Fields of a `LearningRule`: numba takes a plain tuple from Python faster."""


@entry
def gain(
    fields: RuleFields,
    dt: float,
    covariance: Array,
    sides: tuple[Array, Array],
    information: tuple[Array, Array],
    theta: Array,
) -> bool:
    """Add a sample to information A (size, size) and moment b (size,); theta <- that after it.

    `sides`: residual r and regressor Phi. The noise grows by B P B' of the covariance P of q. False if the
    information does not determine theta.
    """
    rule = LearningRule(*fields)
    residual, regressor = sides
    A, b = information
    n, size = residual.shape[0], theta.shape[0]
    S, pivots, slope = rule.noise.copy(), np.empty(n, np.int64), rule.slope
    for r in range(n):
        for c in range(n):
            for i in range(n):
                for j in range(n):
                    S[r, c] += slope[r, i] * covariance[i, j] * slope[c, j]
    solved = np.empty((n, size + 1))
    for r in range(n):
        missed = residual[r]
        for k in range(size):
            solved[r, k] = regressor[r, k]
            missed -= regressor[r, k] * theta[k]
        solved[r, size] = missed
    missing = solved[:, size].copy()
    if not lu_factor(S, pivots):
        return False
    lu_solve_rows(S, pivots, solved)
    large = 0.0
    for r in range(n):
        large += missing[r] * solved[r, size] / n
    # Against the noise and the doubt about q: what no position shows is no reason to forget.
    large = min(large, rule.forget_factor)
    forget = (1.0 + large) / rule.forget_s
    # Samples of a low-pass repeat each other for 2 / its rate. And what fits the model so badly says little
    # about W: an arm that swings after its load has changed.
    part = 0.5 * rule.low_pass_per_s / max(1.0, large)
    for k in range(size):
        for c in range(size):
            A[k, c] -= dt * forget * (A[k, c] - rule.prior[k, c])
        b[k] -= dt * forget * b[k]
        for r in range(n):
            weighed = dt * part * solved[r, k]
            for c in range(size):
                A[k, c] += weighed * regressor[r, c]
            b[k] += weighed * residual[r]
    # A load that comes or falls off changes the mass alone.
    moved = dt * max(large - 1.0, 0.0) * rule.walk
    if moved > 0.0:
        _walk(A, b, moved)
    return _solve(A, b, theta)


@inner
def _walk(information: Array, moment: Array, variance: float) -> None:
    """Let the mass have moved by a variance [kg^2]; theta stays."""
    column, first = information[0].copy(), moment[0]
    part = variance / (1.0 + variance * column[0])
    for k in range(column.shape[0]):
        for c in range(column.shape[0]):
            information[k, c] -= part * column[k] * column[c]
        moment[k] -= part * column[k] * first


@inner
def _solve(information: Array, moment: Array, theta: Array) -> bool:
    """theta <- A^-1 b by the factors of Cholesky; False if A is not finite, or as good as singular."""
    size = theta.shape[0]
    root, L, column = np.empty(size), np.empty((size, size)), np.empty(size)
    for k in range(size):
        if not (0.0 < information[k, k] < math.inf and math.isfinite(moment[k])):
            return False
        root[k] = 1.0 / math.sqrt(information[k, k])  # masses and weights have other units
    for k in range(size):
        for c in range(size):
            L[k, c] = root[k] * information[k, c] * root[c]
            if not math.isfinite(L[k, c]):
                return False
    for k in range(size):
        if not L[k, k] * _SINGULAR >= 1.0:
            return False
        pivot = math.sqrt(L[k, k])
        for i in range(k, size):
            L[i, k] /= pivot
            column[i] = L[i, k]
        # Column by column, because the compiler makes this loop of rows fast, and none of sums.
        for i in range(k + 1, size):
            for c in range(k + 1, i + 1):
                L[i, c] -= column[i] * column[c]
    for k in range(size):
        theta[k] = root[k] * moment[k]
        for c in range(k):
            theta[k] -= L[k, c] * theta[c]
        theta[k] /= L[k, k]
    for k in range(size - 1, -1, -1):
        for i in range(k + 1, size):
            theta[k] -= L[i, k] * theta[i]
        theta[k] /= L[k, k]
    for k in range(size):
        theta[k] *= root[k]
    return True
