"""The twin beside a real arm: nowhere else than the same arm, and as far from another one as it must be."""

import numpy as np
import pytest

from soro_core.config import find_config
from soro_core.errors import ConfigError
from soro_core.robot import load_robot
from soro_core.rotation import quaternion_from_matrix, rotation_exp, rotation_log
from soro_core.twin import Twin, TwinConfig
from soro_core.twin.config import ShadowConfig
from soro_core.twin.shadow import DIFFERENCES, Shadow, ShadowState, beginning, between
from soro_lab.scene import load_scene
from tests.refused import fails

PERIOD_NS = 5_000_000
START_NS = 1_700_000_000_000_000_000  # stamps of a wall clock
CONFIG = ShadowConfig(pressures="measured", refine=1)


@pytest.fixture(scope="module")
def robot():
    return load_robot(find_config("tue_three_bellow", "robots"))


@pytest.fixture(scope="module")
def shadow(robot):
    return Shadow(robot, CONFIG)


def pressures(tick):
    t = tick * PERIOD_NS * 1e-9
    return np.clip(20e3 * np.sin(6.0 * t + np.array([0.0, 2.1, 4.2])) + 20e3 * min(t, 1.0), 0.0, 60e3)


def follow(shadow, ticks, stride=1):
    """States of a shadow that is given the pressures of every so many ticks."""
    state, states = ShadowState(), []
    for tick in range(0, ticks + 1, stride):
        state = shadow.advance(state, START_NS + tick * PERIOD_NS, pressures(tick))
        states.append(state)
    return states


def truth(robot, ticks, **config):
    """Poses of the tip of an arm under the same pressures."""
    twin = Twin(robot, TwinConfig(refine=1, **config))
    state = twin.initial(pressures(0))
    poses = [twin.plant.arm.pose(state.arm.q, robot.length)]
    for tick in range(1, ticks + 1):
        state = twin.step_pressures(state, pressures(tick))
        poses.append(twin.plant.arm.pose(state.arm.q, robot.length))
    return poses


def measured(pose):
    return pose[:3, 3], quaternion_from_matrix(pose[:3, :3])


def test_an_arm_that_is_as_its_model_says_is_where_its_shadow_is(robot, shadow):
    states, poses = follow(shadow, 120), truth(robot, 120)
    for tick in (0, 40, 80, 120):
        stamp = START_NS + tick * PERIOD_NS
        found = shadow.compare(shadow.at(states[tick], stamp), *measured(poses[tick]))
        np.testing.assert_allclose(found.values, 0.0, atol=1e-9)
    assert states[-1].restarts == 0


def test_a_stiffer_arm_differs_by_what_the_two_arms_differ(robot, shadow):
    states, poses = follow(shadow, 120), truth(robot, 120, stiffness_scale=1.3)
    model = truth(robot, 120)
    found = shadow.compare(shadow.at(states[-1], START_NS + 120 * PERIOD_NS), *measured(poses[-1]))
    np.testing.assert_allclose(found.position_m, poses[-1][:3, 3] - model[-1][:3, 3], atol=1e-9)
    assert found.distance_m > 2e-3
    assert found.bending_rad < -0.02  # it bends less
    assert found.rotation_rad >= abs(found.bending_rad) - 1e-9


def test_poses_between_ticks_are_interpolated_and_others_are_not_compared(shadow):
    states = follow(shadow, 150)
    last = START_NS + 150 * PERIOD_NS
    a, b = (shadow.at(states[-1], last - k * PERIOD_NS) for k in (1, 0))
    middle = shadow.at(states[-1], last - PERIOD_NS // 2)
    np.testing.assert_allclose(middle[:3, 3], (a[:3, 3] + b[:3, 3]) / 2, atol=1e-12)
    np.testing.assert_allclose(middle[:3, :3] @ middle[:3, :3].T, np.eye(3), atol=1e-12)
    turned = [rotation_log(a[:3, :3].T @ pose[:3, :3]) for pose in (middle, b)]
    np.testing.assert_allclose(turned[0], turned[1] / 2, atol=1e-12)
    assert np.linalg.norm(turned[1]) > 1e-5
    assert shadow.at(states[-1], last + 1) is None
    assert shadow.at(states[-1], START_NS) is None  # 0.75 s ago, forgotten
    assert len(states[-1].poses) <= 102


def test_pressures_that_come_less_often_go_in_straight_lines():
    steps = between(np.zeros(2), np.array([3.0, 6.0]), 0, 3 * PERIOD_NS + 1, PERIOD_NS)
    np.testing.assert_allclose(steps, [[1, 2], [2, 4], [3, 6]])
    assert between(np.zeros(2), np.ones(2), 0, PERIOD_NS // 3, PERIOD_NS) == []


def test_a_shadow_without_pressures_for_long_starts_anew(shadow):
    (*_, state) = follow(shadow, 20)
    later = shadow.advance(state, state.stamp_ns + 600_000_000, np.full(3, 10e3))
    assert later.restarts == 1
    assert len(later.poses) == 1
    back = shadow.advance(state, START_NS - 1, np.zeros(3))  # somebody set the clock
    assert back.stamp_ns == START_NS - 1


def test_a_buckling_arm_begins_straight(robot):
    twin = Twin(robot, TwinConfig(payload_kg=0.02))
    state = beginning(twin, np.array([300.0, 0.0, 0.0]))
    np.testing.assert_allclose(state.air.pressure_pa, 0.0)


def test_what_is_measured_is_less_what_is_simulated(shadow):
    simulated = np.eye(4)
    quaternion = quaternion_from_matrix(rotation_exp(np.array([0.1, 0.0, 0.0])))
    found = shadow.compare(simulated, np.array([0.003, 0.0, 0.004]), quaternion)
    expected = {"distance": 0.005, "x": 0.003, "y": 0.0, "z": 0.004, "rotation": 0.1, "bending": 0.1}
    assert dict(zip(DIFFERENCES, found.values, strict=True)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"valves": "real", "platform": ""}, ("", "valves: real", "platform")),
        ({"valves": "real", "mode": "lockstep"}, ("", "lockstep", "valves: real")),
        ({"device": "/dev/x"}, ("", "device", "valves: emulated")),
        ({"arm": "real"}, ("", "arm: real", "valves: real")),
        (
            {"valves": "real", "faults": [{"fault": "mute", "chamber": "link0/chamber0"}]},
            ("", "faults", "valves: real"),
        ),
    ],
)
def test_a_scene_says_what_cannot_be_real(changes, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        load_scene("track_circle", changes)


def test_what_is_real_decides_where_twin_and_regulator_have_theirs_from():
    emulated = load_scene("track_circle")
    assert emulated.twin_node("p", "f").pressures == "valves"
    assert emulated.regulator_node("pty").device == "pty"
    real = load_scene("track_circle", {"valves": "real", "device": "/dev/x", "shadow.tolerance_m": 0.01})
    twin = real.twin_node("p", "f")
    assert (twin.pressures, twin.plant_link, twin.fault_link) == ("measured", "", "")
    assert real.regulator_node("pty").device == "/dev/x"
    shadow = load_scene("track_circle", {"valves": "real", "arm": "real"}).shadow_node()
    assert (shadow.pressures, shadow.payload_kg, shadow.tolerance_m) == ("measured", 0.02, 0.02)
