"""The law `counterbalance`: what it asks for of an encoder's angle, and what it refuses."""

import math

import numpy as np
import pytest

from soro_core import load_robot
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
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
    state, t = controller.initial_state(np.array([held])), 0.0
    for angle, until_s in ((0.0, 4.0), (0.4, 5.0), (-0.4, 6.0)):
        while t < until_s:
            state, command = controller.step(state, STILL, STILL, t, DT, np.array([held]), joint_rad=angle)
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
            state, command = controller.step(*given, joint_rad=0.2 * math.sin(0.1 * k))
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
        state, command = controller.step(*given, joint_rad=0.5)
        if not command.status.ok:
            break
    assert k * DT == pytest.approx(3.0, abs=0.02)
    assert "0.5 rad off level" in command.status.message


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"hinge": None}, "law_options.hinge"),
        ({"joint": ""}, "joint"),
        ({"hinge": {**WRIST, "limits_rad": [-3.0, 3.0]}}, "law_options.hinge"),
        ({"weighing": {"weigh_s": -1.0}}, "weigh_s"),
        ({"hinge": {**WRIST, "axis": [0.0, 0.0, 0.0]}}, "axis"),
        ({"robot": "tue_three_bellow"}, "law_options.hinge"),
    ],
)
def test_what_it_cannot_use_is_refused_in_one_line(changes, key):
    with pytest.raises(ConfigError, match=key) as error:
        controller_of(**changes)
    assert "\n" not in str(error.value)
