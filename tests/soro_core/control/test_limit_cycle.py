"""The detector of limit cycles on signals of its own."""

import re
from functools import partial

import control_samples
import numpy as np
import pytest

from soro_core import SoftArm, robot_from_dict
from soro_core.control.laws import limit_cycle
from soro_core.control.laws.limit_cycle import AskedForce, LimitCycleWatch, no_limit_cycle, scaled_feedback
from soro_core.control.laws.protocol import ArmBelief
from soro_core.errors import ConfigError

ARM = SoftArm(robot_from_dict({**control_samples.ROBOT, "links": [control_samples.LINK]}))
WATCH = LimitCycleWatch(ARM)
RAISING = LimitCycleWatch(ARM, raises=True)
BY_Q, BY_FORCE = WATCH.units
N = ARM.n_q
SIDE = np.array([0.0, 1.0, 0.0])


def watched(
    error,
    reference=lambda t: 0.0,
    force=5.0,
    seconds=10.0,
    dt=0.005,
    jumps=(),
    missing_pa=0.0,
    watch=WATCH,
    stiffness=lambda t: -0.1,
):
    """Return the times of detections, and the last state; the arm is where the error has it."""
    state, before, found = no_limit_cycle(N), 1.0, []
    for k in range(round(seconds / dt)):
        t = k * dt
        e = error(t) * SIDE
        qd = (error(t + 1e-5) - error(t - 1e-5)) / 2e-5 * SIDE
        q = e + 5.0 * SIDE * sum(t >= jump for jump in jumps)
        belief = ArmBelief(q * BY_Q, qd * BY_Q, None, True, np.zeros(0), np.zeros(3), np.zeros(3, bool))
        terms = {
            "error": e * BY_Q,
            "proportional": -force * state.part * e * BY_FORCE,
            "derivative": np.zeros(N),
        }
        state = watch.step(
            state,
            AskedForce(terms, np.zeros(N), np.array([missing_pa]), partial(stiffness, t)),
            reference(t) * SIDE * BY_Q,
            belief,
            dt,
        )
        if state.part < before:
            found.append(t)
        before = state.part
    return found, state


@pytest.mark.parametrize("hz", [1.0, 3.3, 9.0])
@pytest.mark.parametrize("dt", [0.002, 0.01])
def test_a_swing_is_known_within_two_periods_with_its_frequency(hz, dt):
    begin_s = 0.6  # the filter is on the arm then

    def error(t):
        return 0.3 * np.sin(2.0 * np.pi * hz * max(t - begin_s, 0.0))

    found, state = watched(error, seconds=begin_s + 3.0 / hz, dt=dt)
    assert found[0] <= begin_s + 2.0 / hz
    told = re.fullmatch("limit cycle at (.*) Hz: feedback lowered to 0.5 times its gains", state.note)
    assert float(told[1]) == pytest.approx(hz, rel=0.06)


def test_feedback_is_lowered_until_it_swings_no_more_and_stays_lowered():
    def error(t):
        return 0.3 * np.sin(20.0 * t) * (1.0 if t < 2.0 else 0.0)

    found, state = watched(error)
    assert len(found) >= 2
    assert max(found) < 2.5
    assert state.part == 0.5 ** len(found)
    # A little of it is left, whatever swings.
    assert watched(lambda t: 0.3 * np.sin(20.0 * t), force=100.0)[1].part == 1.0 / 16.0


@pytest.mark.slow
def test_other_swings_are_no_limit_cycle():
    swing = 20.0
    rng = np.random.default_rng(1)
    noise = dict(enumerate(rng.normal(0.0, 0.1, 4001)))
    cases = {
        "rings down": (lambda t: 2.0 * np.exp(-0.05 * swing * t) * np.sin(swing * t), {}),
        "too small": (lambda t: 0.03 * np.sin(swing * t), {}),
        "without feedback": (lambda t: 0.3 * np.sin(swing * t), {"force": 0.1}),
        "with the reference": (lambda t: 0.3 * np.sin(swing * t), {"reference": lambda t: np.cos(swing * t)}),
        "third harmonic": (lambda t: 0.3 * np.sin(swing * t), {"reference": lambda t: np.cos(swing * t / 3)}),
        "grows once": (lambda t: 0.5 * (t > 5.0) + 0.1 * t, {}),
        "estimate jumps": (
            lambda t: 0.3 * np.sin(swing * t) * (1.0 < t < 2.0),
            {"jumps": (1.1, 1.4, 1.7)},
        ),
        "faster than set points act": (
            lambda t: 0.3 * np.sin(70.0 * t),
            {"watch": LimitCycleWatch(ARM, 1, 0.06)},
        ),
        "pressures end": (lambda t: 0.3 * np.sin(swing * t), {"missing_pa": 3e3}),
        "start": (lambda t: 0.3 * np.sin(50.0 * t) * (t < 0.5), {}),
        "noise": (lambda t: noise[min(round(t / 0.005), 4000)], {"seconds": 20.0}),
    }
    found = {name: watched(error, **keys)[0] for name, (error, keys) in cases.items()}
    assert not any(found.values()), found
    # The same swing beside a slow reference is one.
    assert watched(lambda t: 0.3 * np.sin(swing * t), reference=lambda t: np.cos(1.5 * t))[0]


def test_lowered_feedback_is_that_of_the_terms():
    terms = {
        "model": np.ones(N),
        "error": np.ones(N),
        "proportional": 2.0 * np.ones(N),
        "derivative": 4.0 * np.ones(N),
    }
    left, desired = scaled_feedback(terms, 7.0 * np.ones(N), 0.25)
    np.testing.assert_allclose(desired, 1.0 + 1.5)
    np.testing.assert_allclose(left["model"] + left["proportional"] + left["derivative"], desired)
    assert scaled_feedback({"model": desired}, desired, 0.25)[1] is desired  # terms without feedback


@pytest.mark.parametrize("terms", [{}, dict.fromkeys(limit_cycle.FEEDBACK, 1.0)])
def test_a_law_that_does_not_tell_its_feedback_by_coordinate_is_not_watched(terms):
    state = no_limit_cycle(N)
    assert WATCH.step(state, AskedForce(terms, BY_Q, np.zeros(3), None), BY_Q, None, 0.005) is state
    assert scaled_feedback(terms, BY_Q, 0.5) == (terms, BY_Q)


def test_an_arm_without_units_is_not_watched(monkeypatch):
    def refuse(arm, pieces):
        raise ConfigError("learner", "robot", "no stiffness", "stiffness")

    monkeypatch.setattr(limit_cycle, "scales_of", refuse)
    state = no_limit_cycle(N)
    assert (
        LimitCycleWatch(ARM).step(state, AskedForce({}, BY_Q, np.zeros(3), None), BY_Q, None, 0.005) is state
    )


def runs_away(t):
    return 0.02 * np.exp(4.0 * t)


def test_feedback_of_an_arm_that_runs_away_is_raised():
    state = watched(runs_away, seconds=1.1, watch=RAISING)[1]
    assert state.part == 3.0
    assert state.note == "the arm runs away: feedback raised to 3 times its gains"
    # Within a quarter of a second of what the arm comes back from.
    assert state.raised_s < np.log(0.4 / 0.02) / 4.0 + 0.25
    assert watched(runs_away, seconds=2.0, watch=RAISING)[1].part == 3.0

    # What swings afterwards is not judged before the arm is learned, and is lowered then.
    def swings(t):
        return runs_away(t) if t < 1.0 else runs_away(1.0) * np.cos(20.0 * (t - 1.0))

    found = watched(swings, watch=RAISING)[0]
    assert 5.9 < found[0] < 6.6
    # Where the learned arm stands by itself, it is raised no more.
    for later, part in ((0.25, 3.0), (0.35, 1.0)):
        found = watched(swings, seconds=3.0, watch=RAISING, stiffness=lambda t, a=later: a * (t > 2.0) - 0.01)
        assert found[1].part == part
        assert bool(found[1].note) == (part > 1.0)


def test_other_errors_raise_nothing():
    cases = {
        "stated gains": (runs_away, {"watch": WATCH, "seconds": 1.1}),
        "an arm that stands": (runs_away, {"seconds": 1.1, "stiffness": lambda t: 0.01}),
        "lags behind": (lambda t: 0.35 * (1.0 - np.exp(-2.0 * t)), {}),
        "a short peak": (lambda t: np.exp(-(((t - 3.0) / 0.1) ** 2)), {}),
        "comes back": (lambda t: 2.0 * np.exp(-2.0 * t), {}),
        "estimate jumps": (lambda t: 0.2 * t, {"jumps": np.arange(0.0, 4.0, 0.1), "seconds": 4.0}),
        "pressures end": (lambda t: 0.2 * t, {"missing_pa": 3e3}),
        "lowered before": (lambda t: 0.3 * np.sin(20.0 * t) if t < 2.0 else 0.2 * (t - 2.0), {}),
    }
    raising = {"watch": RAISING}
    found = {name: watched(error, **(raising | keys))[1].part for name, (error, keys) in cases.items()}
    assert max(found.values()) == 1.0, found
    assert found["lowered before"] < 1.0
