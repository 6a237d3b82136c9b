"""A base that follows poses: its way is one of a rigid body, and the arm of the twin rides on it."""

import numpy as np
import pytest

from soro_core import BaseState, load_robot, simulate
from soro_core.config import parse
from soro_core.errors import ConfigError, ModelError
from soro_core.rotation import rotation_exp, rotation_log
from soro_core.twin import Twin, TwinConfig
from soro_core.twin.followed_base import AT_REST

TURN = np.array([0.2, -0.1, 0.3])


def by_topic(robot, **keys):
    return Twin(robot, TwinConfig(base_by_topic=True, rate_hz=100.0, refine=1, **keys))


def pose(displacement=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), of=None):
    """Pose of a base that is moved from that of a robot."""
    found = np.eye(4) if of is None else of.copy()
    found[:3, :3] = rotation_exp(np.asarray(turn)) @ found[:3, :3]
    found[:3, 3] += displacement
    return found


def test_the_rates_are_those_of_the_way_and_a_second_pose_bends_it_smoothly():
    way = AT_REST.towards(1.0, np.array([0.01, 0.0, -0.02]), rotation_exp(TURN))
    later = way.towards(1.05, np.array([0.0, 0.03, 0.0]), rotation_exp(-0.2 * TURN))
    h = 1e-5
    for one, t in ((way, 1.001), (way, 1.04), (later, 1.051), (later, 1.2)):
        before, now, after = one(t - h), one(t), one(t + h)
        for place, rate in (("displacement", "velocity"), ("velocity", "acceleration")):
            slope = (getattr(after, place) - getattr(before, place)) / (2.0 * h)
            assert getattr(now, rate) == pytest.approx(slope, abs=1e-5)
        spin = rotation_log(after.rotation @ before.rotation.T) / (2.0 * h)
        assert now.angular_velocity == pytest.approx(spin, abs=1e-5)
        slope = (after.angular_velocity - before.angular_velocity) / (2.0 * h)
        assert now.angular_acceleration == pytest.approx(slope, abs=1e-3)
    for place in ("displacement", "velocity", "rotation", "angular_velocity"):
        assert getattr(later(1.05), place) == pytest.approx(getattr(way(1.05), place), abs=1e-9)
    assert later(1.4).displacement == pytest.approx([0.0, 0.03, 0.0], abs=1e-5)
    assert rotation_log(later(1.4).rotation) == pytest.approx(-0.2 * TURN, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tue_three_bellow", "three_bellow_hanging"])
def test_the_arm_rides_on_its_base_as_the_model_says(name):
    robot = load_robot(name)
    twin = by_topic(robot)
    state, start = twin.initial(), twin.plant.arm.pose(np.zeros(3), 0.0)
    state = twin.at_base(state, pose((0.02, 0.01, 0.0), TURN, start))
    way = state.base
    assert isinstance(way(0.1), BaseState)
    run = simulate(twin.plant.arm, state.arm.q, base=way, t_end=0.3, dt=twin.config.step_s)
    for k in range(31):
        state, seen = twin.observe(state)
        np.testing.assert_allclose(seen.tip[:3, 3], run.tip[4 * k], atol=1e-9)
        state = twin.step_setpoints(state, np.zeros(3))
    rest = twin.observe(twin.initial())[1].tip
    assert np.linalg.norm(seen.tip[:3, 3] - rest[:3, 3]) > 0.01


def test_without_a_pose_the_arm_moves_as_on_a_base_at_rest():
    robot = load_robot("tue_three_bellow")
    still, followed = Twin(robot, TwinConfig(rate_hz=100.0, refine=1)), by_topic(robot)
    tips = []
    for twin in (still, followed):
        state, _ = twin.observe(twin.initial())
        for _ in range(20):
            state, seen = twin.observe(twin.step_setpoints(state, np.array([20e3, 0.0, 0.0])))
        tips.append(seen.tip)
    assert tips[1] == pytest.approx(tips[0], abs=1e-12)


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        (pose((0.3, 0.0, 0.0)), "0.3 m and 0 rad from the last pose.*allowed: at most 0.2 m"),
        (pose(turn=(0.0, 0.6, 0.0)), "0.6 rad from the last pose"),
        (np.full((4, 4), np.nan), "pose of the base"),
        (2.0 * np.eye(4), "rotation"),
        (np.eye(3), "shape"),
    ],
)
def test_what_is_no_pose_of_this_base_is_refused_in_one_line(bad, why):
    twin = by_topic(load_robot("tue_three_bellow"))
    state = twin.initial()
    with pytest.raises(ModelError, match=why) as caught:
        twin.at_base(state, bad)
    assert "\n" not in str(caught.value)


def test_a_base_that_turns_on_and_on_is_refused_before_its_vector_jumps():
    twin = by_topic(load_robot("tue_three_bellow"))
    state = twin.initial()
    for k in range(1, 7):
        state = twin.at_base(state, pose(turn=(0.0, 0.0, 0.49 * k)))
    with pytest.raises(ModelError, match="half a turn from the robot file"):
        twin.at_base(state, pose(turn=(0.0, 0.0, 0.49 * 7)))


def test_the_key_and_what_does_not_go_with_it():
    twin = Twin(load_robot("tue_three_bellow"), TwinConfig())
    with pytest.raises(ModelError, match="base_by_topic: false"):
        twin.at_base(twin.initial(), np.eye(4))
    shake = {"frequency_hz": 2.0, "amplitude_m": [0.01, 0.0, 0.0]}
    imu = {"enabled": True, "rate_hz": 100.0}
    for beside in ({"air": "states"}, {"imu": imu}, {"base_shake": shake}):
        with pytest.raises(ConfigError, match="base_by_topic") as caught:
            parse({"base_by_topic": True, **beside}, TwinConfig, where="twin")
        assert "\n" not in str(caught.value)
