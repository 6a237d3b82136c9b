"""Noise of the filter that follows the scales of the arm."""

import pytest

from soro_core import load_robot
from soro_core.config import find_config, with_changes
from soro_core.estimation import Estimator, EstimatorConfig
from soro_core.estimation.config import ProcessNoise
from soro_core.estimation.noise_scaling import TUNED_FOR, noise_scales, scaled_noise
from soro_core.robot.parts import fields

NAMES = ("process", "learned_process", "initial", "pose")


def shipped(name):
    return load_robot(find_config(name, "robots"))


def test_the_arm_that_they_are_tuned_for_gets_the_defaults_to_the_bit():
    robot = shipped("tue_three_bellow")
    assert vars(noise_scales(robot)) == pytest.approx(vars(TUNED_FOR), rel=1e-3)
    found, default = scaled_noise(EstimatorConfig(), robot), EstimatorConfig()
    assert found == with_changes(default, scale_noise=False)
    assert Estimator(robot).config == found


def test_an_arm_ten_times_as_stiff_is_accelerated_ten_times_as_much():
    robot = shipped("tue_three_bellow")
    stiff = robot.scaled(stiffness=10.0, damping=1.0, gain=1.0)
    found, default = scaled_noise(EstimatorConfig(), stiff), EstimatorConfig()
    for section in ("process", "learned_process"):
        for name, value in getattr(found, section):
            if name != "disturbance_time_s":
                assert value == pytest.approx(10.0 * getattr(getattr(default, section), name), rel=5e-3)
    assert found.initial.curvature_std_per_m == default.initial.curvature_std_per_m
    rate = 10.0**0.5 * default.initial.curvature_rate_std_per_m_s
    assert found.initial.curvature_rate_std_per_m_s == pytest.approx(rate, rel=5e-3)


def test_the_forces_of_a_slow_arm_change_slowly():
    robot = shipped("tue_three_bellow")
    soft = robot.scaled(stiffness=0.1, damping=1.0, gain=1.0)
    found, default = scaled_noise(EstimatorConfig(), soft), EstimatorConfig()
    for name in ("stretch_disturbance", "curvature_disturbance_per_m"):
        expected = 0.1**1.75 * getattr(default.learned_process, name)
        assert getattr(found.learned_process, name) == pytest.approx(expected, rel=5e-3)


def test_a_link_twice_as_long_is_half_as_curved():
    robot = shipped("tue_three_bellow")
    long = robot.replace(links=[{**fields(robot.links[0]), "length": 0.128}])
    found = scaled_noise(EstimatorConfig(), long).initial.curvature_std_per_m
    assert found == pytest.approx(0.5 * EstimatorConfig().initial.curvature_std_per_m, rel=5e-3)


def test_more_links_leave_less_of_the_orientation_to_the_model_error():
    two = scaled_noise(EstimatorConfig(), shipped("asu_two_segment")).pose
    assert two.orientation_model_std_rad == pytest.approx(
        EstimatorConfig().pose.orientation_model_std_rad / 4.0
    )


def test_what_is_stated_stays():
    robot = shipped("asu_two_segment")
    stated = EstimatorConfig(process=ProcessNoise(curvature_acceleration_per_m=7.0))
    found = scaled_noise(stated, robot)
    assert found.process.curvature_acceleration_per_m == 7.0
    assert found.process.stretch_acceleration != EstimatorConfig().process.stretch_acceleration
    unscaled = with_changes(EstimatorConfig(), scale_noise=False)
    assert scaled_noise(unscaled, robot) is unscaled
    assert scaled_noise(found, robot) is found  # once
