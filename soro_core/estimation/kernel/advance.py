"""Prediction to the time of a sample, and what becomes of the sample there.

A new one passes the gate. After many outliers in a row the state is more likely wrong than the sensor: the
belief then restarts at the straight arm, from which the iterated update converges. A pose that its sensor
repeats under new stamps is refused once the prediction has moved. A sample that is replayed has passed all
this before.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.estimation.kernel.parts import AFTER, BEFORE, NIS, NIS_OF_POSITION, POSE, FilterArm
from soro_core.estimation.kernel.predict import predict
from soro_core.estimation.kernel.update import FUSED, OUTLIER, fuse
from soro_core.model.dynamics import GOOD, finite
from soro_core.model.links.linear import assign, assign_matrix, clear
from soro_core.model.tables import Site

# What becomes of a sample, beside the codes of an update: refused as frozen; fused after a restart of the
# belief; without a result after one.
FROZEN, FOUND, MISSED = 3, 4, 5
# Record of a sensor: outliers in a row; of its last pose the stamp [s] and the values as they came, the
# estimated position with it, and the motion of the prediction while the sensor has repeated it. That is
# without the jumps of updates: a filter that follows a frozen sensor does not hide its own motion, and one
# that converges does not move.
REFUSED, STAMP, POSITION, QUATERNION, ESTIMATE, MOVED = 0, 1, 2, 5, 9, 12
# Beside: sum of position less estimate over all poses that were fused, and their number.
RESIDUALS, FUSED_POSES = 15, 18
N_RECORD = 19
# Motions are forgotten with this time constant [s]: round-off of an arm at rest must not add up.
_FORGET_S = 0.2
# Times that differ by less [s] are equal: ticks and stamps are sums of periods.
SAME_S = 1e-9


@inner
def _restart(arm: FilterArm, mean: Array, internal: Array, covariance: Array) -> None:
    clear(mean)
    clear(internal)
    assign_matrix(arm.settings.initial, covariance)


@inner
def _step(
    arm: FilterArm, share: float, mean: Array, internal: Array, covariance: Array, pressure: Array, dt: float
) -> int:
    """scratch.prior, .prior_internal, .prior_covariance <- belief after dt; gives a code."""
    w = arm.scratch
    x, z, P = w.prior, w.prior_internal, w.prior_covariance
    if dt <= SAME_S:
        assign(mean, x)
        assign(internal, z)
        assign_matrix(covariance, P)
        return GOOD
    code: int = predict(arm, share, mean, internal, covariance, pressure, dt, x, z, P)
    if code != GOOD:
        good = finite(x) and finite(z)
        for i in range(P.shape[0]):
            good = good and finite(P[i])
        if not good:  # a covariance that outliers have inflated beyond all bounds
            _restart(arm, x, z, P)
    return code


@inner
def _is_frozen(
    arm: FilterArm, first: Array, quaternion: Array, stamp: float, reported: Array, record: Array
) -> bool:
    """Put a pose into the record of its sensor; True if the sensor repeats it while the prediction moves."""
    same = True
    for r in range(3):
        same = same and first[r] == record[POSITION + r]
        record[POSITION + r] = first[r]
    for r in range(4):
        same = same and quaternion[r] == record[QUATERNION + r]
        record[QUATERNION + r] = quaternion[r]
    kept, square = math.exp(-(stamp - record[STAMP]) / _FORGET_S), 0.0
    record[STAMP] = stamp
    for r in range(3):
        predicted = reported[BEFORE + r]
        moved = kept * record[MOVED + r] + predicted - record[ESTIMATE + r] if same else 0.0
        record[MOVED + r], record[ESTIMATE + r] = moved, predicted
        square += moved * moved
    return math.sqrt(square) > arm.settings.frozen_m


@inner
def advance(
    arm: FilterArm,
    share: float,
    mean: Array,
    internal: Array,
    covariance: Array,
    pressure: Array,
    dt: float,
    site: Site,
    kind: int,
    first: Array,
    second: Array,
    quaternion: Array,
    stamp: float,
    is_new: bool,
    record: Array,
    mean1: Array,
    internal1: Array,
    covariance1: Array,
    reported: Array,
) -> tuple[int, int]:
    """mean1, internal1, covariance1 <- belief after dt and the sample of `measure` at the end.

    `record` is that of the sensor, renewed in place. Gives the code of the prediction, and what becomes of
    the sample. `reported`: see `parts`.
    """
    s, w = arm.settings, arm.scratch
    x, P = w.prior, w.prior_covariance
    step = _step(arm, share, mean, internal, covariance, pressure, dt)
    assign(w.prior_internal, internal1)
    code: int = fuse(arm, site, kind, first, second, quaternion, is_new, x, P, mean1, covariance1, reported)
    if is_new and kind == POSE and _is_frozen(arm, first, quaternion, stamp, reported, record):
        assign(x, mean1)
        assign_matrix(P, covariance1)
        return step, FROZEN
    if code == OUTLIER:
        record[REFUSED] += 1.0
        if record[REFUSED] < s.most_refused:
            assign(x, mean1)
            for i in range(x.shape[0]):
                for j in range(x.shape[0]):
                    covariance1[i, j] = s.outlier_inflation * P[i, j]
            return step, OUTLIER
        nis, position_nis = reported[NIS], reported[NIS_OF_POSITION]
        _restart(arm, x, internal1, P)
        code = fuse(arm, site, kind, first, second, quaternion, False, x, P, mean1, covariance1, reported)
        code = FOUND if code == FUSED else MISSED
        reported[NIS], reported[NIS_OF_POSITION] = nis, position_nis
    if code != FUSED and code != FOUND:
        _restart(arm, mean1, internal1, covariance1)
        return step, code
    if is_new:
        record[REFUSED] = 0.0
        for r in range(3):
            record[ESTIMATE + r] = reported[AFTER + r]
        if kind == POSE and code == FUSED:
            record[FUSED_POSES] += 1.0
            for r in range(3):
                record[RESIDUALS + r] += first[r] - reported[AFTER + r]
    return step, code
