"""What is found together is what is found alone."""

import numpy as np
import pytest
from hypothesis import given
from sample_arms import SETTINGS, random_robot, random_state, seeds

from soro_core import SoftArm, load_robot
from soro_core.config import find_config

BELLOWS = SoftArm(load_robot(find_config("tue_three_bellow", "robots")))


def assert_close(found, wanted):
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-10 * np.abs(wanted).max() + 1e-14)


@pytest.mark.parametrize("method", ["exact", "mde"])
@SETTINGS
@given(seed=seeds)
def test_the_forces_of_a_motion_come_of_one_pass(method, seed):
    robot = random_robot(seed)
    if method == "exact" and seed % 2:
        places = [0.4 * robot.length, robot.length]
        robot = robot.replace(point_masses=[{"place": place, "mass": 0.1} for place in places])
    arm = SoftArm(robot, method=method)
    q, qd = random_state(robot, seed)
    a = 10.0 * np.random.default_rng(seed).normal(size=arm.n_q)
    found = arm.motion_forces(q, qd, a)
    assert_close(
        found.own, arm.inverse_dynamics(q, qd, qd, a) + arm.elastic_force(q) + arm.damping_force(q, qd)
    )
    assert_close(found.by_mass, arm.mass_regressor(q, qd, qd, a)[:, 0])
    np.testing.assert_array_equal(found.actuation, arm.actuation_matrix(q))


def test_internal_states_move_by_the_midpoint_rule_and_stay_where_they_would_not_be_finite():
    arm, dt = BELLOWS, 0.01
    q, qd, z = np.zeros(arm.n_q), np.linspace(-1.0, 1.0, arm.n_q), np.linspace(-0.1, 0.2, arm.n_internal)
    half = z + 0.5 * dt * arm.internal_rate(q, qd, z)
    wanted = z + dt * arm.internal_rate(q, qd, half)
    np.testing.assert_allclose(arm.internal_midpoint(q, qd, z, dt), wanted, rtol=1e-14)
    np.testing.assert_array_equal(arm.internal_midpoint(q, qd, z, 1e300), z)
