"""Automatic gains: near those that were tuned, the same in every basis, and with the units of the arm."""

import numpy as np
import pytest
from scipy.linalg import eigh

from soro_core import SoftArm, load_robot
from soro_core.adaptation.modes import losses
from soro_core.config import find_config, load, parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.config import Gains
from soro_core.control.gains import gains_of
from soro_core.robot import Discretisation
from soro_core.robot.coordinates import strain_fields
from soro_core.robot.parts import fields
from tests.refused import refused

DELAY_S = 0.026
# The first mode of a finer arm is slower, and its creep damps it more.
FIRST_MODE = 0.25


def shipped(name):
    return load_robot(find_config(name, "robots"))


def automatic(robot, delay_s=DELAY_S, **stated):
    return gains_of(SoftArm(robot), strain_fields(robot), Gains(**stated), 1, delay_s)


def test_they_are_near_those_that_were_tuned_for_the_three_bellow_arm():
    robot = shipped("tue_three_bellow")
    tuned = load(find_config("adaptive_three_bellow", "controllers"), ControllerConfig)
    by_hand = Controller(robot, tuned).gains
    found = Controller(robot, ControllerConfig(law="adaptive")).gains
    assert np.diag(found.k_p) == pytest.approx(np.diag(by_hand.k_p), rel=0.13)
    assert np.diag(found.k_d) == pytest.approx(np.diag(by_hand.k_d), rel=0.13)
    assert found.rate == pytest.approx(by_hand.rate, rel=0.13)


def test_what_is_stated_counts_and_the_rest_is_found():
    robot = shipped("tue_three_bellow")
    found, mixed = automatic(robot), automatic(robot, k_p=(1.0, 2e-6, 2e-6))
    assert np.diag(mixed.k_p) == pytest.approx([1.0, 2e-6, 2e-6])
    assert mixed.k_d.tolist() == found.k_d.tolist()
    assert automatic(robot, lambda_per_s=(3.0, 3.0, 3.0)).rate.tolist() == [3.0, 3.0, 3.0]
    for short in ("auto", {"gains": "auto"}["gains"], {}):
        assert parse({"gains": short}, ControllerConfig, "test").gains == Gains()


def test_a_platform_twice_as_slow_gets_half_the_feedback_and_half_lambda():
    robot = shipped("tue_three_bellow")
    fast, slow = automatic(robot), automatic(robot, 2.0 * DELAY_S)
    assert slow.rate == pytest.approx(0.5 * fast.rate)
    assert slow.k_p[1, 1] == pytest.approx(0.5 * fast.k_p[1, 1])
    assert slow.k_d[1, 1] == pytest.approx(fast.k_d[1, 1])


def test_an_arm_that_damps_itself_less_gets_less_feedback():
    robot = shipped("tue_three_bellow")
    one, less = automatic(robot), automatic(robot.scaled(stiffness=1.0, damping=0.25, gain=1.0))
    assert less.k_p[1, 1] == pytest.approx(0.25 * one.k_p[1, 1], rel=1e-6)
    assert less.k_p[0, 0] < one.k_p[0, 0]
    # And never more than a part of its stiffness.
    more = automatic(robot.scaled(stiffness=1.0, damping=100.0, gain=1.0))
    stiffness = SoftArm(robot).stiffness_matrix(np.zeros(3))[1, 1]
    assert more.k_p[1, 1] == pytest.approx(0.15 * stiffness)


def test_an_arm_ten_times_as_stiff_and_heavy_gets_ten_times_the_gains():
    robot = shipped("asu_two_segment")
    scaled = robot.scaled(stiffness=10.0, damping=10.0, gain=1.0)
    heavy = robot.replace(links=[{**fields(link), "mass": 10.0 * link.mass} for link in scaled.links])
    one, ten = automatic(robot), automatic(heavy)
    assert np.diag(ten.k_p) == pytest.approx(10.0 * np.diag(one.k_p), rel=1e-6)


def test_they_are_the_same_in_every_basis():
    """One link as one piece with a first degree of curvature, against the constant one."""
    robot = shipped("tue_three_bellow")
    constant, linear = Controller(robot), Controller(robot, None, Discretisation(basis="legendre", order=1))
    uniform = linear.fields.uniform
    bend = linear.fields.of("bending_x")
    found = (uniform * bend) @ linear.gains.k_p @ (uniform * bend)
    assert found == pytest.approx(constant.gains.k_p[1, 1], rel=FIRST_MODE)


def test_pieces_share_the_gains_of_their_link():
    robot = shipped("tue_three_bellow")
    one, four = Controller(robot), Controller(robot, None, Discretisation(links=4))
    assert 4.0 * four.gains.k_p[1, 1] == pytest.approx(one.gains.k_p[1, 1], rel=FIRST_MODE)


def test_a_strain_without_stiffness_needs_stated_gains(monkeypatch):
    robot = shipped("tue_three_bellow")
    monkeypatch.setattr(SoftArm, "stiffness_matrix", lambda arm, q: np.diag([1.3, 2.5e-5, 0.0]))
    with refused("gains", names=("bending_y",)):
        Controller(robot)
    stated = {"law": "adaptive", "gains": {"k_p": [0.4, 1e-6, 1e-6], "k_d": [0.0, 1e-7, 1e-7]}}
    with refused("adaptation.gain", None, names=("bending_y",)):
        Controller(robot, parse(stated, ControllerConfig, "test"))
    stated["adaptation"] = {"gain": [0.05]}
    assert Controller(robot, parse(stated, ControllerConfig, "test")).gains.k_p[1, 1] == 1e-6


def test_feedback_on_a_fast_mode_keeps_to_the_damping_of_this_mode():
    """Two links: their second bending turns by more than a right angle in the delay."""
    one = shipped("tue_three_bellow")
    robot = one.replace(links=(one.links[0], one.links[0]), name="two_links")
    arm, of = SoftArm(robot), strain_fields(robot)
    gains, more = (gains_of(arm, of, Gains(), 1, DELAY_S, (0.5, factor)) for factor in (2.5, 5.0))
    assert more.k_p[1, 1] == pytest.approx(gains.k_p[1, 1])
    square, shapes = eigh(arm.stiffness_matrix(np.zeros(6)), arm.inertia_matrix(np.zeros(6)))
    parts = []
    for rate, shape in zip(np.sqrt(square), shapes.T, strict=True):
        made = abs(shape @ (gains.k_p + gains.k_d * (gains.rate + 1j * rate)) @ shape)
        parts.append(made / (rate * shape @ losses(arm, rate) @ shape))
    assert max(parts) == pytest.approx(1.4, rel=0.01)
    short = SoftArm(one), strain_fields(one)
    twice, once = (gains_of(*short, Gains(), 1, DELAY_S, (1.0, factor)).k_p[1, 1] for factor in (2.0, 1.0))
    assert twice == pytest.approx(2.0 * once)


def adapted(robot, **stated):
    config = parse({"law": "adaptive", "adaptation": stated}, ControllerConfig, "test")
    return Controller(robot, config).law.parameters.config


def test_gain_and_bounds_of_the_adapted_mass_are_near_those_that_were_tuned():
    """They were 0.05, 0 and 0.1 kg; a gain of 0.15 oscillates."""
    found = adapted(shipped("tue_three_bellow"))
    assert (*found.gain, *found.lower, *found.upper) == pytest.approx((0.05, 0.0, 0.1), rel=0.03)


def test_they_scale_with_the_arm_and_count_the_mass_of_the_file():
    robot = shipped("asu_two_segment")
    scaled = robot.scaled(stiffness=10.0, damping=10.0, gain=1.0)
    links = [{**fields(link), "mass": 10.0 * link.mass} for link in scaled.links]
    one, ten = adapted(robot), adapted(robot.replace(links=links))
    # (m^2 / energy) of ten times the mass and the energy.
    assert ten.gain == pytest.approx((10.0 * one.gain[0],))
    assert ten.upper[0] - robot.tip_mass == pytest.approx(10.0 * (one.upper[0] - robot.tip_mass))
    heavy = adapted(robot.replace(tip_mass=robot.tip_mass + 0.2))
    assert heavy.upper[0] == pytest.approx(one.upper[0] + 0.2)


def test_law_composite_follows_the_tracking_error_with_the_same_gain():
    robot = shipped("asu_two_segment")
    composite = Controller(robot, parse({"law": "composite"}, ControllerConfig, "test")).law
    assert composite.learner.mass_rate == pytest.approx(adapted(robot).gain[0])


def test_a_stated_gain_or_bound_counts_and_the_rest_is_found():
    robot = shipped("tue_three_bellow")
    found, mixed = adapted(robot), adapted(robot, upper=[0.04])
    assert (mixed.gain, mixed.lower, mixed.upper) == (found.gain, found.lower, (0.04,))
    assert adapted(robot, gain=[0.02]).gain == (0.02,)


def test_what_the_model_does_not_give_must_be_stated():
    with refused("adaptation", names=("gain", "tip_mass")):
        parse({"adaptation": {"parameters": ["a1"]}}, ControllerConfig, "test")
    with refused("", names=("lower bound of tip_mass",)):
        adapted(shipped("tue_three_bellow"), lower=[0.2])
