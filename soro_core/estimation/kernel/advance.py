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
from soro_core.estimation.kernel.belief import Belief, assign_belief
from soro_core.estimation.kernel.noise import LAST, match_noise
from soro_core.estimation.kernel.parts import (
    AFTER,
    BEFORE,
    NIS,
    NIS_OF_POSITION,
    POSE,
    FilterArm,
    SampleValues,
)
from soro_core.estimation.kernel.predict import predict
from soro_core.estimation.kernel.update import FUSED, OUTLIER, fuse
from soro_core.model.dynamics import GOOD, finite
from soro_core.model.links.linear import assign, assign_matrix, clear

# What becomes of a sample, beside the codes of an update: refused as frozen; fused after a restart of the
# belief; without a result after one.
FROZEN, FOUND, MISSED = 3, 4, 5
# Record of a sensor: outliers in a row; of its last pose the stamp [s] and the values as they came, the
# estimated position with it, and the motion of the prediction while the sensor has repeated it. That is
# without the jumps of updates: a filter that follows a frozen sensor does not hide its own motion, and one
# that converges does not move.
REFUSED, STAMP, POSITION, QUATERNION, ESTIMATE, MOVED = 0, 1, 2, 5, 9, 12
# Behind them those of `noise`.
N_RECORD = LAST + 6
# Motions are forgotten with this time constant [s]: round-off of an arm at rest must not add up.
_FORGET_S = 0.2
# Times that differ by less [s] are equal: ticks and stamps are sums of periods.
SAME_S = 1e-9


@inner
def _restart(arm: FilterArm, belief: Belief) -> None:
    clear(belief.mean)
    clear(belief.internal)
    assign_matrix(arm.settings.initial, belief.covariance)


@inner
def _step(arm: FilterArm, belief: Belief, pressure: Array, dt: float, out: Belief) -> int:
    """Out <- belief after dt; gives a code."""
    if dt <= SAME_S:
        assign_belief(belief, out)
        return GOOD
    code: int = predict(arm, belief, pressure, dt, out)
    if code != GOOD:
        good = finite(out.mean) and finite(out.internal)
        for i in range(out.covariance.shape[0]):
            good = good and finite(out.covariance[i])
        if not good:  # a covariance that outliers have inflated beyond all bounds
            _restart(arm, out)
    return code


@inner
def _repeats(sample: SampleValues) -> tuple[bool, bool]:
    """Tell whether position and orientation of a pose are those of the last one of its sensor."""
    first, quaternion, record = sample.first, sample.quaternion, sample.record
    position = orientation = sample.kind == POSE
    for r in range(3):
        position = position and first[r] == record[POSITION + r]
    for r in range(4):
        orientation = orientation and quaternion[r] == record[QUATERNION + r]
    return position, orientation


@inner
def _is_frozen(arm: FilterArm, sample: SampleValues, same: bool) -> bool:
    """Put a pose into the record of its sensor; True if the sensor repeats it while the prediction moves."""
    first, quaternion, record, reported = sample.first, sample.quaternion, sample.record, arm.scratch.reported
    for r in range(3):
        record[POSITION + r] = first[r]
    for r in range(4):
        record[QUATERNION + r] = quaternion[r]
    kept, square = math.exp(-(sample.stamp - record[STAMP]) / _FORGET_S), 0.0
    record[STAMP] = sample.stamp
    for r in range(3):
        predicted = reported[BEFORE + r]
        moved = kept * record[MOVED + r] + predicted - record[ESTIMATE + r] if same else 0.0
        record[MOVED + r], record[ESTIMATE + r] = moved, predicted
        square += moved * moved
    return math.sqrt(square) > arm.settings.frozen_m


@inner
def advance(
    arm: FilterArm, belief: Belief, pressure: Array, dt: float, sample: SampleValues, out: Belief
) -> tuple[int, int]:
    """Out <- belief after dt and the sample at the end.

    Gives the code of the prediction, and what becomes of the sample. scratch.reported: see `parts`.
    """
    s, w = arm.settings, arm.scratch
    record, reported = sample.record, w.reported
    prior = Belief(w.prior, w.prior_internal, w.prior_covariance, belief.n)
    step = _step(arm, belief, pressure, dt, prior)
    assign(prior.internal, out.internal)
    code: int = fuse(arm, sample, sample.is_new, prior, out)
    if sample.is_new:
        since_s, repeats = sample.stamp - record[STAMP], _repeats(sample)
        if sample.kind == POSE and _is_frozen(arm, sample, repeats[0] and repeats[1]):
            assign_belief(prior, out)
            return step, FROZEN
        match_noise(arm, sample.kind, record, since_s, repeats)
        record[STAMP] = sample.stamp
    if code == OUTLIER:
        record[REFUSED] += 1.0
        if record[REFUSED] < s.most_refused:
            assign(prior.mean, out.mean)
            for i in range(prior.mean.shape[0]):
                for j in range(prior.mean.shape[0]):
                    out.covariance[i, j] = s.outlier_inflation * prior.covariance[i, j]
            return step, OUTLIER
        nis, position_nis = reported[NIS], reported[NIS_OF_POSITION]
        _restart(arm, prior)
        assign(prior.internal, out.internal)
        code = fuse(arm, sample, False, prior, out)
        code = FOUND if code == FUSED else MISSED
        reported[NIS], reported[NIS_OF_POSITION] = nis, position_nis
    if code != FUSED and code != FOUND:
        _restart(arm, out)
        return step, code
    if sample.is_new:
        record[REFUSED] = 0.0
        for r in range(3):
            record[ESTIMATE + r] = reported[AFTER + r]
    return step, code
