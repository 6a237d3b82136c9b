"""Coordinates that no chamber moves: the reference with their shape, and what feedback sees of them."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core import load_robot
from soro_core.config import find_config, parse
from soro_core.control import Controller, ControllerConfig, Point
from soro_core.control.laws.protocol import ArmBelief, Preview
from soro_core.control.reference.underactuation import UnderactuatedReference
from soro_core.model.discretised import discretised
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Discretisation
from soro_core.robot.coordinates import strain_fields

LOAD_KG = 0.02


@pytest.fixture(scope="module")
def bent():
    """Six coordinates and three chambers: the model, the coordinates' limit and their shape."""
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    arm = discretised(robot, Discretisation(basis="legendre", order=1))
    fields = strain_fields(arm.robot)
    return arm, UnderactuatedReference(arm, fields, np.where(fields.stretch, 0.6, 40.0))


def force_of(arm):
    zero = np.zeros(arm.n_q)

    def force(q):
        load = LOAD_KG * arm.tip_mass_force(q, zero, zero)
        return np.asarray(arm.gravity_force(q) + arm.elastic_force(q) + load)

    return force


def uniform_with_tip(arm, tip):
    """Coordinates of uniform strains whose tip is there."""
    q, at = np.zeros(arm.n_q), [0, 2, 4]
    q[at] = [0.05, 0.1, 0.1]
    for _ in range(60):
        pose, jacobian = arm.pose_and_jacobian(q, arm.length)
        q[at] += np.linalg.lstsq((pose[:3, :3] @ jacobian[3:])[:, at], tip - pose[:3, 3], rcond=None)[0]
    return q


def tip_of(arm, q):
    return arm.pose(q, arm.length)[:3, 3]


def settled(arm, underactuated, q, qd=None, ticks=60):
    state = underactuated.initial_state()
    point = Point(q, np.zeros(arm.n_q) if qd is None else qd, np.zeros(arm.n_q))
    for _ in range(ticks):
        state, found, motions = underactuated.step(state, point, force_of(arm), arm.actuation_matrix)
    return found, motions


def test_the_reference_takes_the_shape_in_which_the_loaded_arm_rests(bent):
    """The pressures are known, and the tip of their rest is given with uniform strains."""
    arm, underactuated = bent
    rest = equilibrium(arm, np.array([75e3, 40e3, 30e3]), added_tip_mass=LOAD_KG)
    given = uniform_with_tip(arm, tip_of(arm, rest))
    assert np.linalg.norm(tip_of(arm, given) - tip_of(arm, rest)) < 1e-9
    assert np.abs(given - rest)[[2, 3, 4, 5]].max() > 1.0  # the given strains are not those of the rest
    found, _ = settled(arm, underactuated, given)
    # Within what is given up for coordinates near the reference.
    np.testing.assert_allclose(underactuated.inverse @ found.q, underactuated.inverse @ rest, atol=6e-3)
    assert np.linalg.norm(tip_of(arm, found.q) - tip_of(arm, rest)) < 4e-5


def test_its_rates_are_those_of_the_shape_along_the_given_reference(bent):
    arm, underactuated = bent
    q, qd, h = np.array([0.08, 0, 6.0, 0, -3.0, 0]), np.array([0.02, 0, 5.0, 0, 9.0, 0]), 1e-4
    found, _ = settled(arm, underactuated, q, qd)
    ahead, behind = (settled(arm, underactuated, q + x * qd, qd)[0].q for x in (h, -h))
    rate = underactuated.inverse @ (ahead - behind) / (2.0 * h)
    np.testing.assert_allclose(underactuated.inverse @ found.qd, rate, atol=0.02 * np.abs(rate).max())


def test_a_column_of_the_slope_a_tick_follows_what_is_learned_meanwhile(bent):
    """The slope of the first tick is that of the arm without load."""
    arm, underactuated = bent
    q = np.array([0.08, 0, 6.0, 0, -3.0, 0])
    point = Point(q, np.zeros(6), np.zeros(6))
    state = underactuated.initial_state()
    state, *_ = underactuated.step(
        state, point, lambda x: arm.gravity_force(x) + arm.elastic_force(x), arm.actuation_matrix
    )
    unloaded = state.stiffness
    for _ in range(60):
        state, found, _ = underactuated.step(state, point, force_of(arm), arm.actuation_matrix)
    assert np.abs(state.stiffness - unloaded).max() > 0.02 * np.abs(unloaded).max()
    np.testing.assert_allclose(found.q, settled(arm, underactuated, q)[0].q, rtol=1e-6, atol=1e-9)


def test_feedback_sees_the_estimated_tip_and_no_motion_that_chambers_lack(bent):
    arm, underactuated = bent
    found, motions = settled(arm, underactuated, np.array([0.08, 0, 6.0, 0, -3.0, 0]))
    estimated = found.q + np.array([0.004, -0.003, 0.4, 1.5, -0.3, 0.8])
    q, qd = motions.within(estimated, np.array([0.1, 0.02, 3.0, -2.0, 1.0, 1.0]))
    assert np.linalg.norm(tip_of(arm, q) - tip_of(arm, estimated)) < 0.03 * np.linalg.norm(
        tip_of(arm, found.q) - tip_of(arm, estimated)
    )
    for motion in (underactuated.inverse @ (q - found.q), underactuated.inverse @ qd):
        part = np.linalg.lstsq(motions.along, motion, rcond=None)[0]
        np.testing.assert_allclose(motions.along @ part, motion, atol=1e-12)
    assert np.abs(q - estimated).max() > 0.5


@pytest.mark.parametrize("order", [0, 1])
def test_an_arm_that_its_chambers_drive_follows_the_given_reference(order):
    """One constant strain each: 3 coordinates and 3 chambers; of order 1: 6."""
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    model = Discretisation(basis="legendre", order=order) if order else Discretisation()
    controller = Controller(robot, parse({"law": "composite"}, ControllerConfig, "test"), model)
    state, zero = controller.initial_state(), np.zeros(controller.arm.n_q)
    q = zero.copy()
    for k in range(400):
        state, command = controller.step(state, q, zero, 0.005 * k, 0.005, np.zeros(3))
        assert command.status.ok
    assert controller.underactuated.exist == (order == 1)
    assert bool(np.any(state.shape.offset)) == (order == 1)
    # What is published is the given reference: uniform strains.
    assert np.abs(command.reference.q[controller.fields.uniform == 0.0]).max(initial=0.0) < 1e-9


def test_a_shape_without_a_balance_holds_the_last_set_points():
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    model = Discretisation(basis="legendre", order=1)
    controller = Controller(robot, parse({"law": "composite"}, ControllerConfig, "test"), model)
    state, zero = controller.initial_state(), np.zeros(controller.arm.n_q)
    for k in range(20):
        state, command = controller.step(state, zero, zero, 0.005 * k, 0.005, np.zeros(3))
    limp = replace(state, shape=replace(state.shape, stiffness=np.zeros((6, 6))))
    after, held = controller.step(limp, zero, zero, 0.1, 0.005, np.zeros(3))
    assert not held.status.ok
    assert "balance" in held.status.message
    assert after is limp
    np.testing.assert_array_equal(held.setpoint_pa, command.setpoint_pa)


def test_without_undriven_coordinates_the_state_is_the_estimated_one():
    controller = Controller(load_robot(find_config("tue_three_bellow", "robots")))
    q, qd = np.array([0.05, 2.0, -1.0]), np.array([0.1, 3.0, 4.0])
    belief = ArmBelief(q, qd, None, False, np.zeros(0), np.zeros(3), np.zeros(3, dtype=bool))
    point = Point(q, qd, qd)
    moved, rate = controller.law.setting.moved(belief, Preview(point, point, 0.02))
    np.testing.assert_array_equal(moved, q + 0.02 * qd)
    np.testing.assert_array_equal(rate, qd)


def test_the_reference_ahead_has_the_shape_of_what_no_chamber_moves():
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    model = Discretisation(basis="legendre", order=1)
    controller, seen = Controller(robot, parse({"law": "composite"}, ControllerConfig, "test"), model), []
    step = controller.law.step

    def noted(state, belief, reference, dt):
        seen.append(reference)
        return step(state, belief, reference, dt)

    controller.law.step = noted
    state, zero = controller.initial_state(), np.zeros(controller.arm.n_q)
    for k in range(20):
        state, _ = controller.step(state, zero, zero, 0.005 * k, 0.005, np.zeros(3))
    last = seen[-1]
    np.testing.assert_allclose(last.at(last.ahead_s).q, last.ahead.q, atol=1e-12)
    np.testing.assert_allclose(last.at(0.0).q, last.now.q, atol=1e-12)
    assert np.abs(state.shape.offset).max() > 1e-3
