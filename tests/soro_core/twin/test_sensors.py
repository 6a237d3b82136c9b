"""The twin's sensors: rate, delay, noise, losses and outliers, as configured."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from soro_core.estimation.sensors.samples import PoseSample
from soro_core.twin.config import SensorConfig
from soro_core.twin.sensors import SectionMotion, SensorClock, SensorState, measure_imu, measure_pose, sample


def stream(config: SensorConfig, rate_hz: float, ticks: int, seed: int = 0) -> list[list[PoseSample]]:
    """What reaches the reader at each tick."""
    clock, state, rng = SensorClock.of(config, rate_hz), SensorState(), np.random.default_rng(seed)
    seen = []
    for tick in range(ticks):
        t = tick / rate_hz
        state, due = sample(
            config, clock, state, tick, lambda t=t: measure_pose(config, np.eye(4), t, 0.1, rng), rng
        )
        seen.append(list(due))
    return seen


@given(st.sampled_from([1, 2, 4, 5]), st.floats(0, 0.05), st.floats(0, 0.9), st.integers(0, 5))
def test_the_number_of_samples_is_known_beforehand_whatever_is_lost(period, delay_s, drop, seed):
    config = SensorConfig(rate_hz=200.0 / period, delay_s=delay_s, drop=drop)
    clock = SensorClock.of(config, 200.0)
    seen = stream(config, 200.0, 60, seed)
    for tick in range(60):
        assert sum(len(due) for due in seen[: tick + 1]) == clock.published_by(tick)


def test_a_sample_comes_after_its_delay_with_the_stamp_of_its_taking():
    config = SensorConfig(rate_hz=100.0, delay_s=0.012)
    seen = stream(config, 200.0, 40)
    first = next(tick for tick, due in enumerate(seen) if due)
    assert first == 3  # 12 ms are three ticks of 5 ms, rounded up
    assert seen[first][0].stamp_s == 0.0
    assert seen[first + 2][0].stamp_s == pytest.approx(0.01)


def test_a_lost_sample_is_the_last_one_once_more():
    config = SensorConfig(rate_hz=200.0, delay_s=0.0, drop=0.3)
    stamps = [due[0].stamp_s for due in stream(config, 200.0, 2000)]
    repeated = np.mean(np.diff(stamps) == 0.0)
    assert repeated == pytest.approx(0.3, abs=0.03)
    assert min(np.diff(stamps)) >= 0.0


def test_noise_has_the_configured_spread_and_outliers_are_far_off():
    config = SensorConfig(rate_hz=200.0, delay_s=0.0, outlier=0.1)
    samples = [due[0] for due in stream(config, 200.0, 4000)]
    distance = np.array([np.linalg.norm(s.position) for s in samples])
    far = distance > 10 * config.position_noise_m
    assert far.mean() == pytest.approx(0.1, abs=0.02)
    assert np.std([s.position[0] for s, out in zip(samples, far, strict=True) if not out]) == pytest.approx(
        config.position_noise_m, rel=0.05
    )
    turns = [np.linalg.norm(Rotation.from_quat(s.quaternion).as_rotvec()) for s in samples]
    assert np.median(turns) == pytest.approx(1.54 * config.rotation_noise_rad, rel=0.15)  # of 3 dimensions


def test_an_imu_at_rest_feels_gravity_upwards_in_its_own_frame():
    quiet = SensorConfig(rotation_noise_rad=0.0, rate_noise_rad_s=0.0, acceleration_noise_m_s2=0.0)
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5])
    pose = np.eye(4)
    pose[:3, :3] = turn.as_matrix()
    seen = measure_imu(
        quiet, SectionMotion(pose, np.zeros(6)), np.array([0, 0, -9.81]), 0.0, 0.1, np.random.default_rng(0)
    )
    assert turn.apply(seen.linear_acceleration) == pytest.approx([0, 0, 9.81])
    assert Rotation.from_quat(seen.orientation).as_matrix() == pytest.approx(turn.as_matrix())


def test_an_imu_on_a_circle_feels_the_centripetal_acceleration():
    quiet = SensorConfig(rotation_noise_rad=0.0, rate_noise_rad_s=0.0, acceleration_noise_m_s2=0.0)
    # Turning about z at 2 rad/s, 0.5 m from the axis, which lies along -x.
    twist = np.array([0.0, 0.0, 2.0, 0.0, 1.0, 0.0])
    seen = measure_imu(
        quiet, SectionMotion(np.eye(4), twist), np.zeros(3), 0.0, 0.1, np.random.default_rng(0)
    )
    assert seen.linear_acceleration == pytest.approx([-2.0, 0.0, 0.0])
