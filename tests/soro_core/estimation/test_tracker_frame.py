"""A tracker has its own frame, and bodies sit beside the backbone: the estimator sees the same arm."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soro_core import load_robot
from soro_core.estimation.estimator import Estimator
from soro_core.estimation.sensors.samples import PoseSample
from soro_core.estimation.sensors.tracker import Tracker
from soro_core.robot import Robot
from soro_core.twin.config import TwinConfig
from soro_core.twin.twin import Twin

TURN, SHIFT = Rotation.from_euler("xyz", [0.4, -0.3, 2.0]), np.array([0.5, -1.0, 0.3])
MOUNT, OFFSET = Rotation.from_euler("xyz", [0.1, 0.2, -1.2]), np.array([0.01, 0.02, -0.005])


def tracked() -> Robot:
    calibration = {
        "tracker_position": tuple(SHIFT),
        "tracker_quaternion": tuple(TURN.as_quat()),
        "bodies": [{"at": 1.0, "offset_m": tuple(OFFSET), "quaternion": tuple(MOUNT.as_quat())}],
    }
    return load_robot("tue_three_bellow").replace(calibration=calibration)


def test_a_tracker_shows_what_the_page_states_and_back() -> None:
    robot = tracked()
    tracker = Tracker.of(robot)
    assert tracker is not None
    section = np.eye(4)
    turn, place = Rotation.from_euler("xyz", [0.3, 0.7, -0.2]), np.array([0.01, -0.02, 0.06])
    section[:3, :3], section[:3, 3] = turn.as_matrix(), place
    shown = tracker.seen(section, robot.length)
    assert shown[:3, 3] == pytest.approx(SHIFT + TURN.apply(place + turn.apply(OFFSET)))
    seen = Rotation.from_matrix(shown[:3, :3])
    assert (seen.inv() * TURN * turn * MOUNT).magnitude() == pytest.approx(0.0, abs=1e-9)
    back = tracker.section(PoseSample(0.0, shown[:3, 3], 2.0 * seen.as_quat(), robot.length))
    assert back.position == pytest.approx(place)
    assert (Rotation.from_quat(back.quaternion).inv() * turn).magnitude() == pytest.approx(0.0, abs=1e-7)
    # A body elsewhere on the arm is not this one.
    assert tracker.seen(section, 0.5 * robot.length)[:3, 3] == pytest.approx(SHIFT + TURN.apply(place))


def test_a_robot_without_frames_has_no_tracker() -> None:
    assert Tracker.of(load_robot("tue_three_bellow")) is None


def test_the_filter_follows_an_arm_through_an_unknown_frame_as_it_does_in_the_world() -> None:
    """Twin and estimator share the calibration. Noise has other directions in the frame of the tracker."""
    plain, robot = load_robot("tue_three_bellow"), tracked()
    in_world, in_frame = (worst_error(one, one) for one in (plain, robot))
    assert in_frame == pytest.approx(in_world, rel=0.3)
    assert worst_error(robot, plain) > 10.0 * in_world


def worst_error(true: Robot, known: Robot) -> float:
    """Largest error [m] of the estimated tip after half a second of a step of pressure."""
    twin = Twin(true, TwinConfig(seed=3, rate_hz=200.0))
    estimator = Estimator(known)
    state, belief = twin.initial(), estimator.initial_state()
    worst = 0.0
    for k in range(200):
        state, seen = twin.observe(state)
        belief, estimate = estimator.step(belief, seen.reading_pa, seen.poses, seen.imus, twin.dt)
        if k >= 100:
            worst = max(worst, float(np.linalg.norm(estimate.tip_pose[:3, 3] - seen.tip[:3, 3])))
        state = twin.step_setpoints(state, np.array([2e4, 0.0, 0.0]))
    return worst
