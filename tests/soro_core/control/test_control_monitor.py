"""What the controller says of a load that is too large, and of an arm that has fallen over."""

import control_samples
import numpy as np
import pytest

from soro_core import robot_from_dict
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.control_monitor import ControlMonitorState, update_monitor
from soro_core.control.laws import Certainty

DT = 0.005
NAMES = ("a", "b", "c")
NONE = np.zeros(3)


def after(state, seconds, away=0.0, missing=NONE, event=""):
    for _ in range(round(seconds / DT)):
        state = update_monitor(state, away, missing, NAMES, event, 3.0, DT)
    return state


def test_saturated_chambers_are_named_after_half_a_second():
    missing = np.array([12e3, 0.0, -3e3])
    state = after(ControlMonitorState(), 0.49, missing=missing)
    assert state.note == ""
    state = after(state, 0.02, missing=missing)
    assert "pressure saturated: a needs 12 kPa more than its limit" in state.note
    assert "c needs 3 kPa below its limit" in state.note
    assert "b " not in state.note
    assert after(state, 0.01, missing=missing + 100.0).note == state.note  # not another text each tick
    assert after(state, DT).note == ""
    assert after(ControlMonitorState(), 5.0, missing=np.array([1e3, 0.0, 0.0])).note == ""


def test_an_event_of_the_law_is_shown_for_some_seconds():
    state = after(ControlMonitorState(), DT, event="prior restored")
    assert after(state, 4.9).note == "prior restored"
    assert after(state, 5.1).note == ""


@pytest.mark.parametrize("swinging", [False, True])
def test_an_arm_has_fallen_over_when_its_tip_is_far_away_for_long(swinging):
    state = after(ControlMonitorState(), 5.0, away=0.9)  # a loaded arm gets up
    assert not state.fallen
    assert not after(state, 0.98, away=0.9).fallen
    assert not after(state, 20.0, away=0.4).fallen
    if swinging:
        for _ in range(10):
            state = after(after(state, 0.3, away=0.9), 0.1, away=0.2)
    else:
        state = after(state, 1.1, away=0.9)
    assert state.fallen
    assert after(state, 60.0).fallen


def controller(law, **options):
    link = {**control_samples.LINK, "creep": [{"tau": [0.025], "stiffness": [0.0, 2e-5, 2e-5]}]}
    robot = robot_from_dict({**control_samples.ROBOT, "links": [link]})
    return Controller(
        robot,
        parse({"law": law, "law_options": options, "reference": {"start_s": 0.1}}, ControllerConfig, "test"),
    )


def run(control, seconds, state=None, q=(0.0, 0.0, 0.0), certainty=None):
    state, q = state or control.initial_state(), np.array(q)
    for k in range(round(seconds / DT)):
        state, command = control.step(state, q, 0 * q, k * DT, DT, state.model_pa, certainty=certainty)
    return state, command


def test_the_air_of_a_fallen_arm_goes_until_the_controller_starts_anew():
    control = controller("composite")
    lying = (0.0, 45.0, 0.0)
    state, command = run(control, 3.0, q=lying)
    assert command.status.ok
    assert command.setpoint_pa.max() > 10e3
    state, command = run(control, 1.0, state, q=lying)
    assert state.watch.fallen
    assert command.status.ok
    assert command.status.note
    assert command.setpoint_pa.max() == 0.0
    assert run(control, 0.1, state)[1].setpoint_pa.max() == 0.0
    assert run(control, 0.5)[1].setpoint_pa.max() > 0.0
    assert not run(controller("adaptive"), 4.0, q=lying)[0].watch.fallen


@pytest.mark.parametrize("what", ["q", "pressure", "covariance"])
def test_what_is_not_finite_is_counted_and_the_last_model_kept(what):
    control = controller(
        "composite", nonuniform_strain=False
    )  # what the model knows of the bend follows the reference
    sure = Certainty(1e-8 * np.eye(6), True)
    state, command = run(control, 1.0, certainty=sure)
    theta = command.learned.theta
    assert theta.any()
    q, pressure, bad = np.zeros(3), state.model_pa, np.full((6, 6), np.nan)
    if what == "q":
        q = np.array([np.nan, 0.0, 0.0])
    if what == "pressure":
        pressure = np.full(3, np.inf)
    state, command = control.step(
        state, q, 0 * q, 1.0, DT, pressure, certainty=Certainty(bad, True) if what == "covariance" else sure
    )
    refused = control.law.counts(state.law)["samples_refused"]
    assert (state.watch.refused, refused) == ((0, 1) if what == "covariance" else (1, 0))
    if what != "pressure":  # the predicted pressure takes its place
        np.testing.assert_array_equal(command.learned.theta, theta)
    assert np.isfinite(command.setpoint_pa).all()


def test_nothing_is_learned_of_a_filter_that_is_lost():
    assert not run(controller("composite", nonuniform_strain=False), 1.0)[1].learned.theta.any()
