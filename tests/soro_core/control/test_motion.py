"""Motions of the three-bellow arm along paths: continuous, within limits, or refused with what is missing."""

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soro_core import SoftArm, equilibrium, load_robot
from soro_core.adaptation.learned import Learned
from soro_core.config import find_config, parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.motions.motion_parts import ToRest
from soro_core.control.motions.pressure_feasibility import rates
from soro_core.control.motions.tip_path import arc, corners
from soro_core.control.reference.active_reference import follow, reference_ahead
from soro_core.control.reference.trajectory import Hold, Point
from soro_core.planning.motion_error import MotionError
from soro_core.planning.steps import finished

DT = 0.005
REST = Point(np.array([0.05, 0.0, 0.0]), np.zeros(3), np.zeros(3))
HIGH = 0.066
LINE = np.array([[-0.015, 0.0, HIGH], [0.015, 0.0, HIGH]])


def controller(mass_kg=0.02, robot=None, **motion):
    config = parse(
        {"law": "adaptive", "motion": motion, "reference": {"kind": "hold"}}, ControllerConfig, "test"
    )
    control = Controller(robot or load_robot(find_config("tue_three_bellow", "robots")), config)
    state = control.initial_state()
    return control, replace(state, law=replace(state.law, estimate=np.array([mass_kg])))


def test_laws_that_have_learned_the_same_load_ask_for_the_same_force():
    adaptive, state = controller()
    learned = Learned(np.concatenate([[0.02], np.zeros(14)]))
    keys = {"law": "composite", "law_options": {"nonuniform_strain": False}, "reference": {"kind": "hold"}}
    composite = Controller(
        load_robot(find_config("tue_three_bellow", "robots")), parse(keys, ControllerConfig, "test")
    )
    inner = composite.initial_state().law
    inner = replace(inner, learner=replace(inner.learner, learned=learned))
    q, qd, qdd = np.array([[0.05, 6.0, -3.0], [0.1, -20.0, 30.0], [1.0, 200.0, -100.0]])
    force = adaptive.law.reference_force(state.law, q, qd, qdd)
    assert composite.law.reference_force(inner, q, qd, qdd) == pytest.approx(force, rel=1e-9, abs=1e-12)
    without = composite.law.reference_force(composite.initial_state().law, q, qd, qdd)
    assert np.abs(without - force).max() > 1e-3


def planned(path, begin=REST, start_s=0.0, orientations=None, **settings):
    control, state = controller(**settings)
    return control, finished(control.planner(state, DT).plan(begin, np.array(path), orientations, start_s))


def sampled(motion, dt=1e-3):
    times = np.arange(motion.start_s - 0.01, motion.end_s + 0.02, dt)
    points = [motion.sample(t) for t in times]
    return times, *(np.array([getattr(point, name) for point in points]) for name in ("q", "qd", "qdd"))


def tips(control, q):
    return np.array([control.arm.pose(row, control.robot.length)[:3, 3] for row in q])


def smooth(motion, after_s=-1.0):
    """Rates and accelerations are the derivatives, and accelerations do not jump."""
    jumps = []
    for h in (1e-3, 0.5e-3):
        times, q, qd, qdd = sampled(motion, h)
        q, qd, qdd = (rows[times > after_s] for rows in (q, qd, qdd))
        for value, slope in ((q, qd), (qd, qdd)):
            change, mean = np.diff(value, axis=0) / h, 0.5 * (slope[1:] + slope[:-1])
            assert np.abs(change - mean).max(axis=0) == pytest.approx(0.0, abs=2e-3 * np.abs(slope).max())
        jumps.append(np.abs(np.diff(qdd, axis=0)).max(axis=0))
    # What is continuous changes half as much in half the time; a jump stays.
    assert np.all(jumps[1] < 0.6 * jumps[0] + 1e-9)


PATHS = {
    "line": LINE,
    "corners": corners([np.array(x) for x in ([0.0, 0.0, HIGH], [0.01, 0.0, HIGH], [0.01, 0.01, HIGH])]),
    "arc": arc(*(0.01 * np.array([np.cos(x), np.sin(x), 6.6]) for x in (0.0, 2.0, 4.0))),
    "spline": np.array([[0.0, 0.0, 0.067], [0.01, 0.0, HIGH], [0.01, 0.01, 0.065], [-0.01, 0.0, HIGH]]),
}


@pytest.mark.parametrize("name", PATHS)
def test_a_motion_is_smooth_keeps_to_its_path_and_its_limits(name):
    control, motion = planned(PATHS[name])
    smooth(motion)
    times, q, _, _ = sampled(motion)
    tip, on = tips(control, q), times > motion.path_s
    assert tip[-1] == pytest.approx(PATHS[name][-1], abs=1e-7)
    # Every pose is passed, and what lies between two of a dense path or a line is near the chord.
    for pose in PATHS[name]:
        assert np.linalg.norm(tip[on] - pose, axis=1).min() < 5e-5
    speed = np.linalg.norm(np.diff(tip, axis=0), axis=1) / 1e-3
    acceleration = np.linalg.norm(np.diff(tip, 2, axis=0), axis=1) / 1e-6
    assert motion.factor == 1.0
    assert speed.max() == pytest.approx(0.04, rel=0.02) or speed.max() < 0.04
    assert acceleration.max() < 0.1 * 1.03
    if name == "line":
        assert np.abs(tip[on][:, 1:] - LINE[0, 1:]).max() < 6e-6


@settings(max_examples=5, deadline=None, derandomize=True)
@given(
    st.lists(st.tuples(*[st.floats(-0.012, 0.012)] * 2), min_size=2, max_size=4, unique=True),
    st.floats(0.005, 0.2),
    st.floats(0.02, 2.0),
)
def test_limits_hold_for_any_path_that_is_not_refused(corner, speed, acceleration):
    path = corners([np.array([x, y, HIGH]) for x, y in corner])
    control, motion = planned(path, speed_m_s=speed, acceleration_m_s2=acceleration, mass_kg=0.01)
    times, q, qd, _ = sampled(motion, 2e-3)
    on = times > motion.path_s
    tip = tips(control, q)[on]
    v = np.diff(tip, axis=0) / 2e-3
    assert np.linalg.norm(v, axis=1).max(initial=0.0) <= speed * 1.02
    # The spline in coordinates leaves its path by some micrometres: at high speed this is an acceleration.
    a = np.diff(v, axis=0) / 2e-3
    assert np.linalg.norm(a, axis=1).max(initial=0.0) <= acceleration * 1.05
    assert np.all(control.fields.peaks(qd).max(axis=0) <= control.bounds.rate)
    assert np.all(control.fields.peaks(q).max(axis=0) <= control.bounds.strain)


def test_a_motion_that_begins_under_way_continues_position_rate_and_acceleration():
    begin = Point(np.array([0.05, 5.0, 0.0]), np.array([0.0, 10.0, 10.0]), np.array([0.0, 50.0, -30.0]))
    _, motion = planned(LINE, begin, start_s=3.0)
    first = motion.sample(3.0)
    for name in ("q", "qd", "qdd"):
        assert getattr(first, name) == pytest.approx(getattr(begin, name))
    smooth(motion, after_s=3.0)


def test_a_motion_replaces_another_without_a_jump_of_the_reference_in_force():
    """The reference in force is what the law follows: old motion, transition and new motion together."""
    control, state = controller()
    bounds, following, reference, at = control.bounds, None, None, REST.q
    rows = []
    for k in range(1100):
        t = k * DT
        if t == 0.5 or k == 200:
            begin = reference_ahead(bounds, following, 0.1)
            path = LINE if k != 200 else LINE[:, [1, 0, 2]]
            motion = finished(control.planner(state, DT).plan(begin, path, None, t + 0.1 - DT))
        if k == 120 or k == 220:  # the last tick was at the begin of the motion
            reference = motion
        following = follow(bounds, 3.0, Hold(at), following, at, t, DT, reference)
        rows.append(reference_ahead(bounds, following, 0.0))
    q, qd, qdd = (np.array([getattr(row, name) for row in rows]) for name in ("q", "qd", "qdd"))
    assert np.abs(qd[220]).max() > 5.0  # it was under way
    change, mean = np.diff(qd, axis=0) / DT, 0.5 * (qdd[1:] + qdd[:-1])
    assert np.abs(change - mean).max() < 0.02 * np.abs(qdd).max()
    assert np.abs(np.diff(qdd, axis=0)).max() < 0.15 * np.abs(qdd).max()
    assert tips(control, q[-1:])[0] == pytest.approx(LINE[1, [1, 0, 2]], abs=1e-6)


def test_time_is_extended_until_the_set_points_keep_their_rates():
    asked = {"speed_m_s": 0.2, "acceleration_m_s2": 2.0, "rate_part": 0.3}
    control, fast = planned(LINE, **asked)
    assert 3.0 < fast.factor < 10.0
    smooth(fast)
    supply = control.planner(controller()[1], DT).supply
    path = fast.parts[-1]
    assert finished(rates(supply, path, DT, 0.3)).fits
    # A twentieth less time is too little.
    assert not finished(rates(supply, replace(path, factor=path.factor / 1.05), DT, 0.3)).fits
    with pytest.raises(MotionError) as caught:
        planned(LINE, **asked, slowest=1.2)
    assert (caught.value.reason, caught.value.key) == ("rate", "rate")
    assert caught.value.factor == pytest.approx(fast.factor)
    assert caught.value.chamber in control.robot.chamber_names
    _, slow = planned(LINE, **{**asked, "rate_part": 1.0})
    assert slow.factor == pytest.approx(2.74, abs=0.02)  # by the rate of bending
    with pytest.raises(MotionError, match=r"rate of strain.*2\.74"):
        planned(LINE, **{**asked, "rate_part": 1.0}, slowest=1.2)


@pytest.mark.parametrize("rate", [1e-9, 1e-300])
def test_a_motion_that_would_last_for_years_is_refused(rate):
    """Its set points would not fit into the memory; on the path, and on the way to it."""
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    keys = {"reference": {"kind": "hold", "bend_rate_rad_s": rate}}
    control = Controller(robot, parse(keys, ControllerConfig, "test"))
    for path in (LINE, LINE[:1]):
        with pytest.raises(MotionError, match=r"rate: got '[\d.e+]+ s for .*at most 50000 s") as caught:
            finished(control.planner(control.initial_state(), DT).plan(REST, path, None, 0.0))
        assert caught.value.reason == "rate"


def test_the_way_to_the_path_keeps_the_rates_of_set_points():
    control, motion = planned([[0.012, 0.0, HIGH]], speed_m_s=5.0, acceleration_m_s2=500.0, rate_part=0.1)
    supply, (way,) = control.planner(controller()[1], DT).supply, motion.parts
    assert finished(rates(supply, way, DT, 0.1)).rate <= 1.0
    # It is extended by a third at a time.
    assert finished(rates(supply, replace(way, duration_s=way.duration_s / 1.3), DT, 0.1)).rate > 1.0


def test_a_point_out_of_reach_is_refused_with_the_nearest():
    for path in ([[0.0, 0.0, HIGH], [0.3, 0.0, HIGH]], [[0.3, 0.0, HIGH]]):
        with pytest.raises(MotionError) as caught:
            planned(path)
        assert caught.value.reason == "reach"
        assert 0.03 < caught.value.nearest_m[0] < 0.3
        assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def held_tips():
    """Tips at which the arm with its load rests under pressures of a grid."""
    arm = SoftArm(load_robot("tue_three_bellow"))
    levels = np.linspace(0.0, 90e3, 8)
    rests = [equilibrium(arm, np.array(one), added_tip_mass=0.02) for one in product(levels, repeat=3)]
    return np.array([arm.pose(q, arm.length)[:3, 3] for q in rests])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("goal", "reason"),
    [
        ((0.3, 0.0, HIGH), "reach"),
        ((0.0, 0.0, 0.2), "reach"),
        ((-0.2, 0.1, -0.1), "reach"),
        ((0.04, 0.03, 0.05), "pressure"),  # the arm can bend so, and no pressure makes it
        ((0.0, 0.0, 0.03), "pressure"),
        ((-0.05, 0.02, 0.0), "pressure"),
    ],
)
@pytest.mark.parametrize("before", [[], [[0.0, 0.0, HIGH]]], ids=["alone", "on a path"])
def test_the_nearest_point_that_is_offered_can_be_held(goal, reason, before, held_tips):
    """As it is printed, in tenths of a millimetre; no other is nearer by more than 1.5 % of the pressures.

    So far the pressures of an offered point keep from their bounds.
    """
    with pytest.raises(MotionError) as caught:
        planned([*before, list(goal)])
    if not before:
        assert caught.value.reason == reason
    offered = re.search(r"the nearest is \((.*?)\) mm", str(caught.value))
    point = 1e-3 * np.array([float(x) for x in offered[1].split(",")])
    assert point == pytest.approx(caught.value.nearest_m, abs=0.51e-4)
    planned([point])
    if not before:
        away = np.linalg.norm(held_tips - goal, axis=1).min()
        assert np.linalg.norm(point - goal) < away + 3e-3


def test_the_nearest_point_turns_with_the_base():
    """Of an arm without weight, whose base is turned, the same pressures hold it."""
    goal = 0.04, 0.03, 0.05
    robot = load_robot("tue_three_bellow").replace(gravity=(0.0, 0.0, 0.0))
    found = []
    for quaternion in ((0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), (0.5, -0.1, 0.7, 0.5)):
        turned = robot.replace(base_quaternion=quaternion / np.linalg.norm(quaternion))
        base = SoftArm(turned).pose(np.zeros(3), 0.0)
        control, state = controller(robot=turned)
        there = base[:3, :3] @ goal + base[:3, 3]
        with pytest.raises(MotionError) as caught:
            finished(control.planner(state, DT).plan(REST, there[None], None, 0.0))
        found.append(base[:3, :3].T @ (caught.value.nearest_m - base[:3, 3]))
    assert np.ptp(found, axis=0).max() < 1e-4


@pytest.mark.parametrize(
    ("path", "low_pa", "high_pa", "chamber"),
    [
        ([[0.0, 0.0, HIGH], [0.005, 0.0, 0.08]], 90e3, 200e3, ""),
        ([[0.0, 0.0, HIGH], [0.04, 0.0, 0.05]], -30e3, 0.0, "link0/chamber0"),
    ],
)
def test_pressures_that_are_not_there_are_refused_by_chamber(path, low_pa, high_pa, chamber):
    with pytest.raises(MotionError) as caught:
        planned(path)
    assert caught.value.reason == "pressure"
    assert caught.value.key == caught.value.chamber
    assert chamber in ("", caught.value.chamber)
    assert low_pa < caught.value.pressure_pa < high_pa
    assert " mm along the path" in caught.value.got


def test_the_learned_load_is_in_the_pressures():
    """Without the load the path is possible, with it not."""
    high = [[0.0, 0.0, HIGH], [0.0, 0.0, 0.0716]]
    planned(high, mass_kg=0.0)
    with pytest.raises(MotionError) as caught:
        planned(high, mass_kg=0.09)
    assert caught.value.reason == "pressure"


def test_orientations_count_with_a_weight_alone_and_that_is_said():
    turned = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.38, 0.0, 0.92]])
    _, plain = planned(LINE)
    _, motion = planned(LINE, orientations=turned)
    assert (plain.note, "rotation_weight_m" in motion.note) == ("", True)
    assert motion.sample(2.0).q == pytest.approx(plain.sample(2.0).q)
    _, motion = planned(LINE, orientations=np.array(2 * [[0.0, 0.0, 0.0, 1.0]]))
    assert motion.note == ""


def test_a_motion_may_begin_where_the_pressures_would_not_hold_the_arm():
    """As a vented arm that leans: its load is not learned yet."""
    lean = replace(REST, q=np.array([0.0, 3.0, 2.0]))
    with pytest.raises(MotionError) as caught:
        planned(tips(controller()[0], [lean.q]), mass_kg=0.0)
    assert caught.value.reason == "pressure"
    _, motion = planned(LINE, lean, mass_kg=0.0)
    assert motion.sample(0.0).q == pytest.approx(lean.q)


def test_a_motion_to_where_the_arm_rests_ends_at_once():
    _control, motion = planned(tips(controller()[0], [REST.q]))
    assert motion.end_s <= 0.2
    assert motion.sample(motion.end_s).q == pytest.approx(REST.q)


def test_the_way_to_rest_has_the_given_ends():
    begin = Point(np.array([1.0, 2.0]), np.array([3.0, -1.0]), np.array([0.5, 4.0]))
    part = ToRest(begin, np.array([5.0, 5.0]), 0.7)
    first, last = part.at(0.0), part.at(0.7)
    assert first.q.tolist() == begin.q.tolist()
    assert first.qd == pytest.approx(begin.qd)
    assert first.qdd == pytest.approx(begin.qdd)
    assert last.q == pytest.approx([5.0, 5.0])
    assert np.concatenate((last.qd, last.qdd)) == pytest.approx(np.zeros(4), abs=1e-9)
