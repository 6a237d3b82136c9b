"""Samples of an arm at rest against the model, before it is enabled."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.config import find_config, with_changes
from soro_core.control import Controller, ControllerConfig
from soro_core.control.enable_checks import SensorSample, pressure_findings, resting_arm
from soro_core.control.motion_config import EnableBounds
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.rotation import quaternion_from_matrix, rotation_exp

BOUNDS = EnableBounds()


@pytest.fixture(scope="module")
def robot():
    return load_robot(find_config("tue_three_bellow", "robots"))


@pytest.fixture(scope="module")
def rest(robot):
    return resting_arm(Controller(robot))


def sample(pose, turn=(0.0, 0.0, 0.0), moved=(0.0, 0.0, 0.0), s=0.064):
    """A pose sensor whose frame is turned and moved against the world."""
    frame = rotation_exp(np.array(turn))
    position = frame @ pose[:3, 3] + np.array(moved)
    return SensorSample("sensors/pose0", s, position, quaternion_from_matrix(frame @ pose[:3, :3]))


@pytest.mark.parametrize("load", [0.0, 0.01, 0.02, 0.03])
def test_an_arm_at_rest_under_any_load_fits(robot, rest, load):
    """With 30 g it lies over, in a direction that is not known before."""
    true = SoftArm(robot.replace(tip_mass=load).refine(4))
    bent = np.tile([0.0, -30.0, 10.0], 4)
    pose = true.pose(equilibrium(true, np.zeros(true.n_u), bent), robot.length)
    assert (np.linalg.norm(pose[:2, 3]) > 0.04) == (load > 0.025)
    assert rest.findings([sample(pose)], BOUNDS) == []


def test_a_pose_elsewhere_is_found_with_the_rotation_that_would_fit(robot, rest):
    pose = np.eye(4)
    pose[2, 3] = 0.0637
    (line,) = rest.findings([sample(pose, turn=(np.pi, 0.0, 0.0))], BOUNDS)
    assert "[1.000, 0.000, 0.000, 0.000]" in line
    assert "0 to 102 g" in line
    (line,) = rest.findings([sample(pose, turn=(0.0, 0.0, 0.5 * np.pi))], BOUNDS)
    assert "[0.000, 0.000, -0.707, 0.707]" in line
    (line,) = rest.findings([sample(pose, moved=(0.0, 0.03, 0.0))], BOUNDS)
    assert "30 mm" in line
    assert "no rotation" in line


@pytest.mark.parametrize(
    ("moved", "turn", "fits"), [(9e-3, 0.0, True), (11e-3, 0.0, False), (0.0, 9.0, True), (0.0, 11.0, False)]
)
def test_the_bounds_are_ten_millimetres_and_ten_degrees(robot, rest, moved, turn, fits):
    light = replace(rest, heaviest_kg=0.0)
    pose = light.arm.pose(equilibrium(light.arm, np.zeros(3)), robot.length)
    one = sample(pose, moved=(0.0, 0.0, moved))
    turned = rotation_exp(np.array([0.0, 0.0, np.radians(turn)])) @ pose[:3, :3]
    one = SensorSample(one.name, one.s, one.position, quaternion_from_matrix(turned))
    assert (light.findings([one], BOUNDS) == []) == fits
    wide = with_changes(BOUNDS, distance_m=0.02, angle_deg=20.0)
    assert light.findings([one], wide) == []


def test_a_pose_that_an_arm_is_too_long_for_is_compared_all_the_same():
    """The links of this arm cannot become as short as the search for a shape at the base asks them to."""
    robot = load_robot(find_config("asu_two_segment", "robots"))
    at_base = SensorSample("sensors/pose0", robot.length, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    (line,) = resting_arm(Controller(robot)).findings([at_base], BOUNDS)
    assert line.startswith("sensors/pose0")


def test_every_sensor_has_to_fit(robot, rest):
    zero = equilibrium(rest.arm, np.zeros(3))
    tip, middle = (rest.arm.pose(zero, s) for s in (robot.length, 0.5 * robot.length))
    good = sample(tip)
    lying = sample(middle, turn=(0.5 * np.pi, 0.0, 0.0), s=0.5 * robot.length)
    other = SensorSample("sensors/pose1", lying.s, lying.position, lying.quaternion)
    (line,) = rest.findings([good, other], BOUNDS)
    assert line.startswith("sensors/pose1 is ")
    # An IMU knows where up is, in its own frame.
    upright, over = (
        SensorSample("sensors/imu0", robot.length, up=np.array(up)) for up in ([0, 0.5, 9.8], [0, 9.8, 0])
    )
    assert rest.findings([good, upright], BOUNDS) == []
    (line,) = rest.findings([good, over], BOUNDS)
    assert line.startswith("sensors/imu0 is 90 degrees")
    assert rest.findings([], BOUNDS) == []


@pytest.mark.parametrize(("tilt_deg", "load"), [(0.0, 0.1), (45.0, 0.1), (120.0, 0.1), (0.0, 0.04)])
@pytest.mark.parametrize("part", [1.0, 0.5])
def test_an_arm_that_lies_over_by_more_than_a_right_angle_fits(robot, tilt_deg, load, part):
    """Up to the largest load, with the base upright, leaning or below; at the tip and halfway."""
    base = quaternion_from_matrix(rotation_exp(np.array([np.radians(tilt_deg), 0.0, 0.0])))
    turned = robot.replace(base_quaternion=base)
    true = SoftArm(turned.replace(tip_mass=load).refine(4))
    q = np.zeros(true.n_q)
    for share in np.linspace(0.3, 1.0, 15):  # from a bend to the side, with more and more of the load
        start = q if q.any() else np.tile([0.0, 0.0, -30.0], 4)
        q = equilibrium(true, np.zeros(true.n_u), start, (share - 1.0) * load)
    pose = true.pose(q, part * robot.length)
    one = sample(pose, s=part * robot.length)
    lying = resting_arm(Controller(turned))
    assert lying.findings([one], BOUNDS) == []
    aside = replace(one, position=one.position + np.array([0.0, 0.0, 0.03]))
    assert len(lying.findings([aside], BOUNDS)) == 1


def test_without_a_position_nothing_is_compared(robot, rest):
    """An arm that leans by 13 degrees under 20 g is none with a wrong base."""
    leaning = SensorSample("sensors/imu0", robot.length, up=np.array([0.0, 2.2, 9.5]))
    assert rest.findings([leaning], BOUNDS) == []


def test_the_heaviest_load_is_the_bound_of_the_learned_mass(robot):
    for upper in (0.05, 0.1):
        config = ControllerConfig(law="adaptive")
        config = with_changes(config, adaptation=with_changes(config.adaptation, upper=(upper,)))
        assert resting_arm(Controller(robot, config)).heaviest_kg == upper
    stated = {"parameters": ("a4",), "gain": (4e-3,), "lower": (1e-3,), "upper": (0.1,)}
    config = with_changes(config, adaptation=with_changes(config.adaptation, **stated))
    assert resting_arm(Controller(robot, config)).heaviest_kg == 0.0


@pytest.mark.parametrize(("pressure", "named"), [([0.0, 900.0, -900.0], ""), ([0.0, 5e3, -6e3], "c")])
def test_a_chamber_under_pressure_is_named(pressure, named):
    found = pressure_findings(("a", "b", "c"), np.array(pressure), BOUNDS)
    assert [line.split()[0] for line in found] == ([named] if named else [])
    assert not found or "-6.0 kPa" in found[0]
