"""The excitation as a state machine: levels end when the arm is still, and limits of motion end it."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.estimation.sensors.samples import ImuSample, PoseSample
from soro_core.model import SoftArm
from soro_core.robot import load_robot
from soro_core.rotation import quaternion_from_matrix, rotation_exp
from soro_lab.excitation import MotionLimits, foresight
from soro_lab.excitation.foresight import Warned, foresee
from soro_lab.excitation.motion import MotionCriteria
from soro_lab.excitation.procedure import (
    PATIENCE,
    VENT_S,
    Excitation,
    ExcitationTick,
    advance,
    initial_state,
    left_s,
)
from tests.soro_lab.excitation.test_plan import made

DT = 0.005
LENGTH = 0.064
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def excitation(motion=None, warned=None, **keys):
    keys = {"stages": ("singles",), "levels": 1, **keys}
    motion = motion or MotionLimits()
    plan = made(**keys)[1]
    return Excitation(plan, MotionCriteria(motion, LENGTH, True), warned, "pose0")


def pose(t, position=(0.0, 0.0, LENGTH), quaternion=UPRIGHT):
    return PoseSample(t, np.array(position), quaternion, LENGTH)


def imu(t, rate=0.0, orientation=None, up=(0.0, 0.0, 9.81)):
    return ImuSample(t, np.full(3, rate), np.array(up), orientation, LENGTH)


def run(given, sample_at, name="pose0", limit_s=200.0, every=2, answers=()):
    """States at each tick to the end, where a function of time and set points gives each sample, or None."""
    state, states = initial_state(given), []
    for k in range(round(limit_s / DT)):
        t = k * DT
        sample = sample_at(t, state.setpoint_pa) if k % every == 0 else None
        samples = {} if sample is None else {name: (sample,)}
        state = advance(
            given, state, ExcitationTick(t, samples, answered=any(abs(t - a) < 1e-9 for a in answers))
        )
        states.append((t, state))
        if state.phase == "over":
            return states
    raise AssertionError("not over")


def still(t, setpoint):
    return pose(t)


def test_an_arm_that_is_still_ends_each_level_early():
    given = excitation(hold_s=1.6)
    states = run(given, still)
    t, end = states[-1]
    assert end.reason == ""
    assert end.restless == 0
    assert end.index == len(given.plan.sections) - 1
    shortest = sum(s.ramp_s + s.shortest_s for s in given.plan.sections)
    assert t == pytest.approx(shortest + VENT_S, abs=2 * DT * len(given.plan.sections))
    assert shortest < given.plan.longest_s - 2.0


def test_a_level_waits_for_the_arm_at_the_expense_of_those_before():
    given = excitation(levels=2, hold_s=1.9)
    first, last = 1, len(given.plan.sections) - 1

    def restless(t, setpoint):
        # The arm swings in the last section alone: until then time is saved.
        is_last = t > 0.5 * given.plan.longest_s and not setpoint.any()
        return pose(t, (3e-3 * np.sin(40.0 * t) * is_last, 0.0, LENGTH))

    states = run(given, restless)
    spent = {
        k: sum(state.index == k and state.phase == "running" for _, state in states) * DT
        for k in (first, last)
    }
    section = given.plan.sections[last]
    assert spent[first] == pytest.approx(given.plan.sections[first].ramp_s + section.shortest_s, abs=3 * DT)
    assert spent[last] == pytest.approx(section.ramp_s + PATIENCE * section.hold_s, abs=3 * DT)
    assert states[-1][1].restless == 1
    assert states[-1][0] <= given.plan.longest_s + VENT_S


@pytest.mark.parametrize("stamp_s", [1e9, -1e9])
@pytest.mark.parametrize("k", [100, 501])
def test_one_sample_with_an_impossible_time_is_no_motion(stamp_s, k):
    given = excitation(hold_s=1.6)
    usual = run(given, still, every=1)
    odd = run(given, lambda t, _: pose(stamp_s if round(t / DT) == k else t), every=1)
    assert (odd[-1][1].reason, odd[-1][1].restless) == ("", 0)
    assert odd[-1][0] == pytest.approx(usual[-1][0], abs=0.5)


def test_an_arm_that_never_stands_still_takes_the_longest_time():
    given = excitation()
    states = run(given, lambda t, p: pose(t, (3e-3 * np.sin(40.0 * t) * (t > 1.5), 0.0, LENGTH)))
    t, end = states[-1]
    assert t == pytest.approx(given.plan.longest_s + VENT_S, abs=2 * DT * len(given.plan.sections))
    assert end.restless == 6
    assert end.reason == ""


def stop_of(given, sample_at, name="pose0", **options):
    """Time of the stop, the states, and the set points from then on, which must be zero."""
    states = run(given, sample_at, name, **options)
    t, first = next((t, state) for t, state in states if state.reason)
    after = [state for time, state in states if time >= t]
    assert all(not state.setpoint_pa.any() for state in after)
    assert len(after) * DT == pytest.approx(VENT_S, abs=2 * DT)
    return t, first, states


def test_a_tip_that_leaves_its_box_vents_at_once():
    def leaves(t, setpoint):
        return pose(t, (0.0, -0.07 if t >= 2.0 else 0.0, LENGTH))

    t, state, states = stop_of(excitation(), leaves)
    before = [state for time, state in states if time < t][-1]
    assert before.setpoint_pa.max() > 10e3
    assert t == pytest.approx(2.0 + 2 * 2 * DT)  # the third sample in a row
    assert "y -70.0 mm" in state.reason
    assert "box_m" in state.reason


def test_a_single_swapped_marker_is_no_stop():
    states = run(excitation(), lambda t, p: pose(t, (0.0, 0.3 if t in (2.0, 2.01) else 0.0, LENGTH)))
    assert states[-1][1].reason == ""


@pytest.mark.parametrize(
    ("box", "stops"),
    [
        ((0.02,), True),
        ((0.04,), False),
        ((-0.1, -0.1, 0.0, 0.1, 0.1, 0.1), False),
        ((-0.01, -0.1, 0.0, 0.01, 0.1, 0.1), True),
    ],
)
def test_the_box_is_the_stated_one(box, stops):
    given = excitation(MotionLimits(box_m=box))
    states = run(given, lambda t, p: pose(t, (0.03 if t > 2.0 else 0.0, 0.0, LENGTH)))
    assert bool(states[-1][1].reason) is stops


def test_an_arm_that_rests_outside_its_box_gets_no_pressure():
    given = excitation(MotionLimits(box_m=(0.1, 0.1, 0.1, 0.2, 0.2, 0.2)))
    _, state, states = stop_of(given, still)
    assert not any(state.setpoint_pa.any() for _, state in states)
    assert state.index == 0


@pytest.mark.parametrize("degrees", [120.0, 160.0])
def test_a_sensor_that_turns_too_far_vents(degrees):
    turned = quaternion_from_matrix(rotation_exp(np.radians([degrees, 0.0, 0.0])))
    states = run(excitation(), lambda t, p: pose(t, quaternion=turned if t > 2.0 else UPRIGHT))
    assert ("bend_rad" in states[-1][1].reason) is (degrees > 149.0)


@pytest.mark.parametrize("with_orientation", [True, False])
def test_an_imu_alone_limits_the_bend_and_shows_stillness(with_orientation):
    given = replace(excitation(), motion=MotionCriteria(MotionLimits(), LENGTH, False), outermost="imu0")

    def sample(angle):
        turn = rotation_exp(np.array([angle, 0.0, 0.0]))
        orientation = quaternion_from_matrix(turn) if with_orientation else None
        return lambda t, p: imu(
            t,
            0.0,
            orientation if t > 2.0 else UPRIGHT if with_orientation else None,
            turn.T @ [0.0, 0.0, 9.81] if t > 2.0 else (0.0, 0.0, 9.81),
        )

    quiet = run(given, sample(1.0), "imu0")
    assert quiet[-1][1].reason == ""
    assert quiet[-1][1].restless == 0
    _, state, _ = stop_of(given, sample(2.8), "imu0")
    assert "IMU" in state.reason
    shaken = run(given, lambda t, p: imu(t, 0.3 * np.sin(50.0 * t) * (t > 1.5)), "imu0")
    assert shaken[-1][1].restless == 6


def test_a_silent_sensor_vents():
    t, state, _ = stop_of(excitation(), lambda t, p: pose(t) if t < 3.0 else None)
    assert t == pytest.approx(3.0 + 0.5, abs=3 * DT)
    assert "sensors/pose0" in state.reason
    assert "silence_s" in state.reason


def test_samples_that_are_not_finite_are_none():
    _, state, _ = stop_of(excitation(), lambda t, p: pose(t, (np.nan, 0.0, 0.0)))
    assert "no sample" in state.reason


def test_without_a_sample_there_is_no_pressure():
    _, _, states = stop_of(excitation(), lambda t, p: None)
    assert not any(state.setpoint_pa.any() for _, state in states)


def test_the_section_that_the_model_warns_of_is_not_started():
    given = excitation(levels=2, warned=Warned(3, "no balance"))
    _, state, states = stop_of(given, still)
    assert state.reason == "no balance"
    assert state.index == 2
    highest = max(s.level_pa.max() for s in given.plan.sections[:3])
    assert max(state.setpoint_pa.max() for _, state in states) == highest


def test_the_model_warns_of_the_first_level_without_balance(monkeypatch):
    plan, arm = made(levels=3)[1], SoftArm(load_robot("tue_three_bellow"))
    assert foresee(arm, plan) is None
    real = foresight.equilibrium

    def limited(arm, pressure, start):
        if pressure[1] > 30e3:
            raise ModelError("no equilibrium", "equilibrium")
        return real(arm, pressure, start)

    monkeypatch.setattr(foresight, "equilibrium", limited)
    warned = foresee(arm, plan)
    first = next(k for k, s in enumerate(plan.sections) if s.level_pa[1] > 30e3)
    assert warned.index == first
    assert f"link0/chamber1 {1e-3 * plan.sections[first].level_pa[1]:.1f} kPa" in warned.reason


def test_a_release_waits_for_its_answer_and_a_hand_may_move_the_arm():
    given = excitation(release=True)
    asked = run(given, still, limit_s=500.0)
    assert asked[-1][0] == pytest.approx(60.0, abs=20.0)
    begin = next(t for t, s in asked if s.phase == "running" and given.plan.sections[s.index].asks)

    def by_hand(t, setpoint):
        return pose(t, (0.2 if t > begin + 1.0 else 0.0, 0.0, 0.0)) if t < begin + 2.0 else None

    answered = run(given, by_hand, answers=[round(begin / DT + 1000) * DT])
    assert answered[-1][1].reason == ""
    assert answered[-1][0] == pytest.approx(begin + 5.0 + VENT_S, abs=3 * DT)


def test_the_time_left_is_never_exceeded():
    given = excitation(levels=2)
    states = run(given, lambda t, p: pose(t, (2e-3 * np.sin(30.0 * t) * (t % 3.0 < 1.0), 0.0, LENGTH)))
    end = states[-1][0]
    for t, state in states:
        assert end - t <= left_s(given, state, t) + 2 * DT * len(given.plan.sections)
    assert left_s(given, states[0][1], 0.0) == pytest.approx(given.plan.longest_s + VENT_S)
