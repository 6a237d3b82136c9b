"""One tick: what becomes of a sample, and that the state before it stays as it was."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.estimation import Estimator, EstimatorConfig, ImuSample, PoseSample
from soro_core.estimation import replay as replaying
from soro_core.estimation.filter import Filter
from soro_core.estimation.kernel.advance import ESTIMATE, FOUND, FROZEN, MOVED, POSITION, REFUSED
from soro_core.estimation.kernel.update import FUSED, OUTLIER
from soro_core.estimation.learned_input import LearnedInput

ROBOT = load_robot("tue_three_bellow")
LENGTH, DT = ROBOT.length, 0.005
P = np.array([1e4, 2e4, 0.0])
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def pose(filter_, t_s, move_m=0.0, q=(0.0, 0.0, 0.0)):
    true = filter_.arm.pose(np.array(q), LENGTH)
    return PoseSample(t_s, true[:3, 3] + [move_m, 0.0, 0.0], LEVEL, LENGTH)


@pytest.fixture
def tracking():
    """A filter, its belief after some poses, and the record of the sensor."""
    filter_ = Filter(SoftArm(ROBOT), EstimatorConfig())
    belief, record = filter_.start(), None
    for k in range(1, 41):
        found = filter_.advance(
            belief, np.zeros(3), DT, LearnedInput(), pose(filter_, k * DT, 1e-5 * k), record
        )
        assert (found.ok, found.outcome) == (True, FUSED)
        belief, record = found.belief, found.record
    return filter_, belief, record


def bits(belief):
    return [part.tobytes() for part in belief[:3]]


def test_a_step_with_a_sample_is_the_prediction_and_the_update(tracking):
    filter_, belief, record = tracking
    sample = pose(filter_, 41 * DT, 1e-4)
    once = filter_.advance(belief, P, DT, LearnedInput(), sample, record)
    ahead, _ = filter_.predict(belief, P, DT)
    after = filter_.advance(ahead, P, 0.0, LearnedInput(), sample, record)
    assert bits(once.belief) == bits(after.belief)
    assert once.nis == after.nis
    tip = filter_.arm.pose(once.belief.q, LENGTH)[:3, 3]
    np.testing.assert_allclose(once.record[ESTIMATE : ESTIMATE + 3], tip, rtol=1e-12, atol=1e-12)


def test_an_outlier_leaves_the_prediction_with_a_wider_covariance(tracking):
    filter_, belief, record = tracking
    ahead, _ = filter_.predict(belief, P, DT)
    found = filter_.advance(belief, P, DT, LearnedInput(), pose(filter_, 41 * DT, 0.02), record)
    assert found.outcome == OUTLIER
    assert found.nis > filter_.settings.gates[6]
    assert found.belief.mean.tobytes() == ahead.mean.tobytes()
    factor = EstimatorConfig().outlier_inflation
    np.testing.assert_array_equal(found.belief.covariance, factor * ahead.covariance)
    assert found.record[REFUSED] == 1.0
    # One that is replayed has passed the gate before.
    replayed = filter_.advance(belief, P, DT, LearnedInput(), pose(filter_, 41 * DT, 0.02), record, False)
    assert replayed.outcome == FUSED
    np.testing.assert_array_equal(replayed.record, record)


def test_after_many_outliers_the_belief_is_found_from_the_straight_arm(tracking):
    filter_, belief, record = tracking
    bent = (0.05, 9.0, -6.0)
    true = filter_.arm.pose(np.array(bent), LENGTH)[:3, 3]
    outcomes = []
    for k in range(41, 41 + EstimatorConfig().reacquire_after):
        # The covariance as it was: else the gate opens before the count is full.
        found = filter_.advance(belief, P, DT, LearnedInput(), pose(filter_, k * DT, 1e-4 * k, bent), record)
        outcomes.append(found.outcome)
        record = found.record
    assert outcomes[:-1] == [OUTLIER] * (len(outcomes) - 1)
    assert outcomes[-1] == FOUND
    assert found.nis > filter_.settings.gates[6]  # that of the gate, not of the sample once found
    assert record[REFUSED] == 0.0
    tip = filter_.arm.pose(found.belief.q, LENGTH)[:3, 3]
    assert np.linalg.norm(tip - true - [1e-4 * k, 0.0, 0.0]) < 1e-3


def test_a_repeated_pose_is_refused_once_the_prediction_has_moved(tracking):
    filter_, belief, record = tracking
    same = pose(filter_, 40 * DT, 1e-5 * 40)
    np.testing.assert_array_equal(record[POSITION : POSITION + 3], same.position)
    moved = []
    for k in range(41, 81):
        pressure = 0.02 * (k - 40) * P
        found = filter_.advance(belief, pressure, DT, LearnedInput(), replace(same, stamp_s=k * DT), record)
        ahead, _ = filter_.predict(belief, pressure, DT)
        belief, record = found.belief, found.record
        moved.append(np.linalg.norm(record[MOVED : MOVED + 3]))
        if found.outcome == FROZEN:
            break
    std = EstimatorConfig().pose.position_std_m
    assert found.outcome == FROZEN
    assert max(moved[:-1]) <= std < moved[-1]
    assert bits(belief) == bits(ahead)


def test_a_tick_leaves_the_state_before_it_as_it_was():
    """Late, repeated, frozen and refused samples, and IMUs; a second tick from there gives the same bits."""
    estimator, rng = Estimator(ROBOT), np.random.default_rng(3)
    state, samples = estimator.initial_state(), []
    for k in range(1, 81):
        t = k * DT
        away_m = 0.03 if k % 17 == 0 else 1e-4 * rng.standard_normal()
        samples.append(pose(estimator.filter, t, away_m))
        late = samples[max(0, k - 1 - int(rng.integers(4)))]
        imu = ImuSample(t, 0.01 * rng.standard_normal(3), np.array([0.0, 0.0, 9.81]), None, LENGTH)
        given = state, 1e3 * rng.random(3), [late], [imu] if k % 3 else [], DT
        before = pickle.dumps(state)
        state, estimate = estimator.step(*given)
        assert pickle.dumps(given[0]) == before
        again, estimated = estimator.step(*given)
        assert pickle.dumps(again.belief) == pickle.dumps(state.belief)
        assert again.counts == state.counts
        assert estimated.covariance.tobytes() == estimate.covariance.tobytes()
    assert min(state.counts.accepted, state.counts.outliers, state.counts.stale) > 0


def late_poses(predicted_again, monkeypatch, ticks=40):
    """Beliefs with poses a tick late, and outliers of another place; and the time predicted to each pose."""
    if predicted_again:
        monkeypatch.setattr(replaying, "_predicted", lambda tick, i: None)
    estimator = Estimator(ROBOT, EstimatorConfig(), DT)
    advance, state, times, found = estimator.filter.advance, estimator.initial_state(), [], []

    def advanced(belief, pressure_pa, dt, known, sample, *others):
        if sample.s == LENGTH:
            times.append(dt)
        return advance(belief, pressure_pa, dt, known, sample, *others)

    estimator.filter.advance = advanced
    for k in range(1, ticks + 1):
        late = pose(estimator.filter, state.t_s, 1e-5 * k)
        wrong = replace(pose(estimator.filter, state.t_s + DT, 0.03), s=0.5 * LENGTH)
        state, _ = estimator.step(state, P, [late] + [wrong] * (k > 10 and k % 4 == 0), [], DT)
        found.append(bits(state.belief))
    assert state.counts.outliers > 3
    return found, np.array(times)


def test_a_late_pose_at_the_end_of_a_step_uses_the_prediction_to_there(monkeypatch):
    found, times = late_poses(False, monkeypatch)
    again, longer = late_poses(True, monkeypatch)
    assert found == again
    # What a refused sample has changed is no prediction.
    assert 0.7 < np.mean(times == 0.0) < 0.9
    assert np.mean(longer == 0.0) < 0.1
