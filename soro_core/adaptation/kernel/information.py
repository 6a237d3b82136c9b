"""Information about theta and what it says of theta, compiled (`soro_core.adaptation.learner`).

With the residual r and the regressor Phi of a sample of noise S, both of a low-pass of rate a,

    A' = (a / 2) Phi' S^-1 Phi - forget (A - A_0),    b' = (a / 2) Phi' S^-1 r - forget b,    A theta = b.

What lasts (the damping) is forgotten more slowly than the rest: of the joint density, that of the rest with
what lasts known returns to its prior at one rate, and the marginal one of what lasts at another.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from soro_core._jit import entry, inner
from soro_core.arrays import Array, Integers
from soro_core.model.links.linear import lu_factor, lu_solve_rows

# Information whose condition is worse than this is singular.
_SINGULAR = 1e14


class LearningRule(NamedTuple):
    """How the learner weighs and forgets what it learns; `size` values of n coordinates."""

    low_pass_per_s: float
    """Rate of the low-pass."""
    forget_s: float
    """Time constant with which the information returns to the prior."""
    lasting_s: float
    """The same of what lasts."""
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
    order: Integers
    """Indices of the values, those of what lasts at the end: (size,)."""
    least: Array
    """Bounds of what lasts, (lasting,)."""
    most: Array


RuleFields: TypeAlias = tuple[float, float, float, float, float, Array, Array, Array, Integers, Array, Array]
"""Fields of a `LearningRule`: numba takes a plain tuple from Python faster."""


@entry
def gain(
    fields: RuleFields,
    dt: float,
    covariance: Array,
    sides: tuple[Array, Array],
    information: tuple[Array, Array, Array, Array],
    theta: Array,
) -> bool:
    """Add a sample to information A (size, size) and moment b (size,); theta <- that after it.

    `sides`: residual r and regressor Phi. The noise grows by B P B' of the covariance P of q.
    `information`: A, b, and what they become once a part is forgotten, for the next sample. False if it does
    not determine theta.
    """
    rule = LearningRule(*fields)
    residual, regressor = sides
    A, b, A1, b1 = information
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
    # Samples of a low-pass repeat each other for 2 / its rate. And what fits the model so badly says little
    # about W: an arm that swings after its load has changed.
    part = 0.5 * rule.low_pass_per_s / max(1.0, large)
    for k in range(size):
        for r in range(n):
            weighed = dt * part * solved[r, k]
            for c in range(size):
                A[k, c] += weighed * regressor[r, c]
            b[k] += weighed * residual[r]
    # A load that comes or falls off changes the mass alone.
    moved = dt * max(large - 1.0, 0.0) * rule.walk
    if moved > 0.0:
        _walk(A, b, moved)
    root, L = np.empty(size), np.empty((size + 1, size))
    if not _factor(rule.order, A, b, root, L):
        return False
    _solve(rule, root, L, theta)
    _forget(rule, (dt * (1.0 + large) / rule.forget_s, dt / rule.lasting_s), (A, b, A1, b1), (root, L))
    return True


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
def _factor(order: Integers, A: Array, b: Array, root: Array, L: Array) -> bool:
    """L <- factor of Cholesky of D A D in an order, and below it L^-1 D b; `root` <- the diagonal of D.

    False if A is not finite, or as good as singular.
    """
    size = root.shape[0]
    column = np.empty(size + 1)
    for k in range(size):
        at = order[k]
        if not (0.0 < A[at, at] < math.inf and math.isfinite(b[at])):
            return False
        root[k] = 1.0 / math.sqrt(A[at, at])  # masses and weights have other units
    for k in range(size):
        for c in range(size):
            L[k, c] = root[k] * A[order[k], order[c]] * root[c]
            if not math.isfinite(L[k, c]):
                return False
        L[size, k] = root[k] * b[order[k]]
    for k in range(size):
        if not L[k, k] * _SINGULAR >= 1.0:
            return False
        pivot = math.sqrt(L[k, k])
        for i in range(k, size + 1):
            L[i, k] /= pivot
            column[i] = L[i, k]
        # Column by column, because the compiler makes this loop of rows fast, and none of sums.
        for i in range(k + 1, size + 1):
            for c in range(k + 1, min(i + 1, size)):
                L[i, c] -= column[i] * column[c]
    return True


@inner
def _solve(rule: LearningRule, root: Array, L: Array, theta: Array) -> None:
    """theta <- A^-1 b from `_factor`, or the best one with what lasts held at its bounds."""
    size = root.shape[0]
    n = size - rule.least.shape[0]
    x = L[size].copy()
    # From the last value on, each is the best one with those behind it known.
    for k in range(size - 1, n - 1, -1):
        x[k] = min(max(x[k] / L[k, k], rule.least[k - n] / root[k]), rule.most[k - n] / root[k])
        for c in range(k):
            x[c] -= L[k, c] * x[k]
    _substitute_back(L, n, x)
    for k in range(size):
        theta[rule.order[k]] = root[k] * x[k]


@inner
def _substitute_back(L: Array, n: int, x: Array) -> None:
    """x (n,) <- L'^-1 x with the first n rows of L."""
    for k in range(n - 1, -1, -1):
        x[k] /= L[k, k]
        for c in range(k):
            x[c] -= L[k, c] * x[k]


@inner
def _forget(
    rule: LearningRule,
    parts: tuple[float, float],
    information: tuple[Array, Array, Array, Array],
    factors: tuple[Array, Array],
) -> None:
    """A1, b1 <- A, b of which parts are forgotten: of the rest with what lasts known, and of what lasts.

    With w the rest, d what lasts, X = A_ww^-1 A_wd and x = A_ww^-1 b_w, the marginal information of d is
    J = A_dd - A_dw X, its moment b_d - A_dw x, and to first order in the part

        A_dw' A_ww'^-1 A_wd' = (1 - part) A_dw X - part X' A_0ww X.
    """
    order, prior, lasting = rule.order, rule.prior, rule.least.shape[0]
    part, slow = parts
    A, b, A1, b1 = information
    root, L = factors
    size = root.shape[0]
    n = size - lasting
    for k in range(size):
        for c in range(size):
            A1[k, c] = A[k, c] - part * (A[k, c] - prior[k, c])
        b1[k] = (1.0 - part) * b[k]
    # Rows of X', and of x' at the end, in the units of w; and times A_0ww.
    known, pulled = L[n:, :n].copy(), np.zeros((lasting + 1, n))
    for d in range(lasting + 1):
        _substitute_back(L, n, known[d])
        for k in range(n):
            known[d, k] *= root[k]
        for k in range(n):
            for c in range(n):
                pulled[d, c] += known[d, k] * prior[order[k], order[c]]
    for d in range(lasting):
        i, of = order[n + d], root[n + d]
        for e in range(lasting + 1):
            shared, back = 0.0, 0.0
            for k in range(n):
                shared += L[n + d, k] * L[n + e, k]
                back += known[d, k] * pulled[e, k]
            if e < lasting:
                j, unit = order[n + e], of * root[n + e]
                own = A[i, j] - shared / unit
                A1[i, j] = A[i, j] - slow * (own - prior[i, j]) - part * (shared + back) / unit
            else:
                b1[i] = b[i] - slow * (b[i] - shared / of) - part * (shared + back) / of
