"""The law `counterbalance`: what it asks for of an encoder's angle, and what it refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest

from soro_core import load_robot
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.laws import MeasuredJoint
from soro_core.errors import ConfigError

WRIST = {"point": [0.0, 0.0, 0.0], "axis": [0.0, 1.0, 0.0], "limits_rad": [-0.8, 0.6]}
DT, WEIGHT = 0.005, 0.353
STILL = np.zeros(2)


def controller_of(robot="wrist_muscle", joint="bodies/hand/joint", **options):
    keys = {
        "law": "counterbalance",
        "law_options": {"hinge": WRIST, **options},
        "joint": joint,
        "reference": {"kind": "hold"},
        "pressures": {"play_pa": 0.0},
        "probe_at_enable": "off",
    }
    return Controller(load_robot(robot), parse(keys, ControllerConfig, "test"))


def test_the_set_point_balances_what_was_weighed_at_each_angle():
    """A hand that stands still level shows the moment of its pressure; turned, it gets that of its weight."""
    controller = controller_of()
    moments = controller.law.limb.moments
    level, per_pa = moments.at(0.0)
    held = (-WEIGHT - level) / per_pa
    state, t, angle = controller.initial_state(np.array([held])), 0.0, 0.0
    for target, until_s in ((0.0, 4.0), (0.4, 5.0), (-0.4, 6.0)):
        while t < until_s:
            angle += min(max(target - angle, -2.0 * DT), 2.0 * DT)
            given = state, STILL, STILL, t, DT, np.array([held])
            state, command = controller.step(*given, joint=MeasuredJoint(angle, t, 0.0))
            assert command.status.ok, command.status
            t += DT
        without, per_pa = moments.at(angle)
        assert without + per_pa * command.setpoint_pa[0] == pytest.approx(-WEIGHT * math.cos(angle), rel=1e-3)
    assert command.estimates["limb_moment"] == pytest.approx(-WEIGHT, rel=1e-3)


def test_it_does_not_answer_the_filter_which_knows_no_limb():
    controller = controller_of()
    asked = []
    for q in (STILL, np.array([3.0, 0.1])):
        state = controller.initial_state()
        for k in range(400):
            given = state, q, STILL, k * DT, DT, np.array([40e3])
            state, command = controller.step(
                *given, joint=MeasuredJoint(0.2 * math.sin(0.1 * k), k * DT, 0.0)
            )
        asked.append(command.setpoint_pa)
    np.testing.assert_allclose(*asked, atol=1.0)


def test_without_an_angle_it_asks_for_nothing():
    controller = controller_of()
    _, command = controller.step(controller.initial_state(), STILL, STILL, 0.0, DT, np.zeros(1))
    assert command.status.ok
    np.testing.assert_allclose(command.desired_force, 0.0)


def test_a_limb_that_a_stop_holds_ends_the_commands():
    controller = controller_of()
    state = controller.initial_state()
    for k in range(700):
        given = state, STILL, STILL, k * DT, DT, np.array([40e3])
        state, command = controller.step(*given, joint=MeasuredJoint(0.5, k * DT, 0.0))
        if not command.status.ok:
            break
    assert k * DT == pytest.approx(3.0, abs=0.02)
    assert "0.5 rad off level" in command.status.message


def weighed():
    """A controller that bears a limb, its state and time."""
    controller = controller_of()
    state, t = controller.initial_state(np.array([42e3])), 0.0
    while t < 4.0:
        given = state, STILL, STILL, t, DT, np.array([42.6e3])
        state, command = controller.step(*given, joint=MeasuredJoint(0.0, t, 0.0))
        assert command.status.ok, command.status
        t += DT
    return controller, state, t


def test_once_refused_it_stays_so_whatever_comes_then():
    controller, state, t = weighed()
    for angle, is_ok in ((3.1, True), (0.0, False), (0.0, False)):  # first it asks for the least pressure
        given = state, STILL, STILL, t, DT, np.array([42.6e3])
        state, command = controller.step(*given, joint=MeasuredJoint(angle, t, 0.0))
        assert command.status.ok == is_ok
        np.testing.assert_allclose(command.desired_force, 0.0)
        t += DT
    assert "the limb is at 3.1 rad" in command.status.message


def test_a_slow_encoder_has_the_rate_of_its_own_samples():
    """At 25 Hz beside ticks of 200 Hz: eight ticks have the same angle, which is older each time."""
    controller, state, t = weighed()
    rates, begin = [], t
    for k in range(200):
        sampled = begin + DT * 8 * (k // 8)
        given = state, STILL, STILL, t, DT, np.array([42.6e3])
        joint = MeasuredJoint(0.5 * (sampled - begin), sampled, t - sampled)
        state, command = controller.step(*given, joint=joint)
        assert command.status.ok, command.status
        rates.append(state.law.rate_rad_s)
        t += DT
    np.testing.assert_allclose(rates[100:], 0.5, atol=1e-3)
    without, per_pa = controller.law.limb.moments.at(0.5 * (t - begin))
    moment = without + per_pa * command.setpoint_pa[0]
    level, level_per_pa = controller.law.limb.moments.at(0.0)
    weight = level + level_per_pa * 42.6e3
    assert moment == pytest.approx(weight * math.cos(0.5 * (t - begin)), rel=0.02)


def test_a_weight_is_not_learned_from_predicted_pressures():
    controller = controller_of()
    state = controller.initial_state()
    for k, reading in enumerate((40e3, math.nan, 40e3)):
        given = state, STILL, STILL, k * DT, DT, np.array([reading])
        state, command = controller.step(*given, joint=MeasuredJoint(0.0, k * DT, 0.0))
        assert command.status.ok == math.isfinite(reading)


def test_a_limb_that_is_too_heavy_is_told():
    controller, state, t = weighed()
    heavy = replace(state.law.limb, weight=-5.0)
    state = replace(state, law=replace(state.law, limb=heavy))
    given = state, STILL, STILL, t, DT, np.array([42.6e3])
    _, command = controller.step(*given, joint=MeasuredJoint(0.0, t, 0.0))
    assert "the limb is not borne whole" in command.status.note


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"hinge": None}, "law_options.hinge"),
        ({"joint": ""}, "joint"),
        ({"hinge": {**WRIST, "limits_rad": [-3.0, 3.0]}}, "law_options.hinge"),
        ({"weighing": {"weigh_s": 0.0}}, "weigh_s"),
        ({"hinge": {**WRIST, "stiffness": 1.0}}, "stiffness"),
        ({"hinge": {**WRIST, "axis": [0.0, 0.0, 0.0]}}, "axis"),
        ({"robot": "tue_three_bellow"}, "law_options.hinge"),
    ],
)
def test_what_it_cannot_use_is_refused_in_one_line(changes, key):
    with pytest.raises(ConfigError, match=key) as error:
        controller_of(**changes)
    assert "\n" not in str(error.value)
