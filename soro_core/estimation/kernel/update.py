"""Update with one sample: gate, iterated gain, covariance in Joseph form.

H has columns by q and qd alone, and at most nine rows, so that the Joseph form
(1 - K H) P (1 - K H)' + K V K' is a sum of outer products of K and H P.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array, Integers
from soro_core.estimation.kernel.belief import Belief
from soro_core.estimation.kernel.covariance import symmetric
from soro_core.estimation.kernel.measure import measure
from soro_core.estimation.kernel.motion import limit
from soro_core.estimation.kernel.parts import (
    AFTER,
    BEFORE,
    FIRST_RESIDUAL,
    FIRST_SPREAD,
    NIS,
    NIS_OF_POSITION,
    POSE,
    FilterArm,
    SampleValues,
)
from soro_core.model.dynamics import finite
from soro_core.model.links.linear import assign, lu_factor, lu_solve, lu_solve_rows

# Codes of an update.
FUSED, OUTLIER, FAILED = 0, 1, 2
# Gauss-Newton passes: one is enough for a running filter; they are needed at the start and after a
# re-acquisition, where the measurement is far from linear over the step.
_PASSES = 6
# One is enough where the measurement at the new mean is the linear one within this part of its deviation.
_LINEAR = 0.05


@inner
def _distance(count: int, S: Array, A: Array, pivots: Integers, residual: Array, solved: Array) -> float:
    """residual' S^-1 residual of the first `count` components, inf if S is singular."""
    F, x = A[:count, :count], solved[:count]
    for r in range(count):
        x[r] = residual[r]
        for c in range(count):
            F[r, c] = S[r, c]
    if not lu_factor(F, pivots):
        return math.inf
    lu_solve(F, pivots, x)
    total = 0.0
    for r in range(count):
        total += residual[r] * x[r]
    return total


@inner
def _cross(arm: FilterArm, count: int, covariance: Array) -> None:
    """scratch.crossed <- H P, .shared <- H P H', .innovation <- H P H' + V."""
    w = arm.scratch
    H, m, columns = w.rows, covariance.shape[0], w.rows.shape[1]
    for r in range(count):
        row = w.crossed[r]
        for c in range(m):
            row[c] = 0.0
        for k in range(columns):
            f = H[r, k]
            if f != 0.0:
                for c in range(m):
                    row[c] += f * covariance[k, c]
        for e in range(r + 1):
            x = 0.0
            for k in range(columns):
                x += row[k] * H[e, k]
            w.shared[r, e] = w.shared[e, r] = w.innovation[r, e] = w.innovation[e, r] = x
        w.innovation[r, r] += w.variance[r]


@inner
def _gain(arm: FilterArm, count: int) -> bool:
    """scratch.gain <- K', from S K' = H P; False if S is singular."""
    w = arm.scratch
    F = w.factors[:count, :count]
    for r in range(count):
        for c in range(count):
            F[r, c] = w.innovation[r, c]
        for c in range(w.gain.shape[1]):
            w.gain[r, c] = w.crossed[r, c]
    if not lu_factor(F, w.pivots):
        return False
    lu_solve_rows(F, w.pivots, w.gain[:count])
    return True


@inner
def _join(arm: FilterArm, count: int, covariance: Array, out: Array) -> bool:
    """out <- covariance in Joseph form; False if it is not finite."""
    w = arm.scratch
    K, C, P, m = w.gain, w.crossed, w.spread, covariance.shape[0]
    for i in range(m):
        for j in range(m):
            P[i, j] = covariance[i, j]
        for r in range(count):
            f = K[r, i]
            for j in range(m):
                P[i, j] -= f * C[r, j]
    # C <- H (P - K H P)' less V K': what is left to subtract is its product with K'.
    for i in range(m):
        for r in range(count):
            x = C[r, i] - w.variance[r] * K[r, i]
            for e in range(count):
                x -= w.shared[r, e] * K[e, i]
            w.solved[r] = x
        for r in range(count):
            C[r, i] = w.solved[r]
    for i in range(m):
        for r in range(count):
            f = C[r, i]
            for j in range(m):
                P[i, j] -= f * K[r, j]
    return symmetric(P, out)


@inner
def _linear(arm: FilterArm, count: int, kept: Array) -> bool:
    """Whether the residual is that which the last pass has predicted, in `kept`."""
    w = arm.scratch
    good = True
    for r in range(count):
        good = good and abs(w.residual[r] - kept[r]) <= _LINEAR * math.sqrt(w.variance[r])
    return good


@inner
def fuse(arm: FilterArm, sample: SampleValues, gated: bool, belief: Belief, out: Belief) -> int:
    """Out <- mean and covariance with the sample, gives FUSED; or OUTLIER, FAILED without a result.

    scratch.reported: see `parts`; its last place is that at the last mean.
    """
    s, w = arm.settings, arm.scratch
    prior, covariance, mean, reported = belief.mean, belief.covariance, out.mean, w.reported
    m, n = prior.shape[0], belief.n
    count = measure(arm, sample, prior)
    assign(w.position, reported[BEFORE : BEFORE + 3])
    _cross(arm, count, covariance)
    for r in range(min(count, FIRST_SPREAD - FIRST_RESIDUAL)):
        reported[FIRST_RESIDUAL + r], reported[FIRST_SPREAD + r] = w.residual[r], w.shared[r, r]
    reported[NIS] = _distance(count, w.innovation, w.factors, w.pivots, w.residual, w.solved)
    reported[NIS_OF_POSITION] = math.nan
    if sample.kind == POSE:
        reported[NIS_OF_POSITION] = _distance(3, w.innovation, w.factors, w.pivots, w.residual, w.solved)
    if reported[NIS] < 0.0:
        return FAILED  # a covariance that rounding has made indefinite: its gain would have the wrong sign
    if gated and not reported[NIS] <= s.gates[count]:
        return OUTLIER
    assign(prior, mean)
    for left in range(_PASSES - 1, -1, -1):
        if not _gain(arm, count):
            return FAILED
        for r in range(count):
            x = w.residual[r]
            for k in range(2 * n):
                x += w.rows[r, k] * (mean[k] - prior[k])
            w.solved[r] = x
        for i in range(m):
            x = prior[i]
            for r in range(count):
                x += w.gain[r, i] * w.solved[r]
            w.mean[i] = x
        if not finite(w.mean):
            return FAILED
        limit(arm, w.mean[:n])
        for r in range(count):
            x = w.residual[r]
            for k in range(2 * n):
                x -= w.rows[r, k] * (w.mean[k] - mean[k])
            w.last_residual[r] = x
        assign(w.mean, mean)
        if left == 0:
            break
        # The gain is that of the rows before: these are needed again only if they have changed.
        if measure(arm, sample, mean) != count:
            return FAILED
        if left == _PASSES - 1 and _linear(arm, count, w.last_residual):
            break
        _cross(arm, count, covariance)
    assign(w.position, reported[AFTER : AFTER + 3])
    return FUSED if _join(arm, count, covariance, out.covariance) else FAILED
