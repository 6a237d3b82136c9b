"""Ways around obstacles: the map from pressures to shapes, the way, refusals, and the motion along it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm, equilibrium, load_robot
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.motions.way_around import route_around
from soro_core.control.reference.trajectory import Point
from soro_core.errors import ModelError
from soro_core.planning.around import plan_around
from soro_core.planning.motion_error import MotionError
from soro_core.planning.obstacles import obstacles_of
from soro_core.planning.shapes import HeldShapes
from soro_core.planning.steps import finished
from soro_core.robot.surroundings import Contacts

ONE = load_robot("tue_three_bellow")
TWO = ONE.replace(
    links=[link.model_dump() for link in ONE.links] * 2, base_quaternion=[1.0, 0, 0, 0], name="two"
)
ARM = SoftArm(TWO)
RADIUS = TWO.links[0].radius
LOW, HIGH = TWO.input_range
# From one side to the other; a ball stands where the tip is half way.
START = np.array([50e3, 0.0, 0.0, 30e3, 0.0, 0.0])
END = np.array([5e3, 40e3, 40e3, 5e3, 20e3, 20e3])


def tip(pressure, arm=ARM):
    return arm.pose(equilibrium(arm, pressure), arm.length)[:3, 3]


def ball(centre, radius):
    return {"centre": [float(x) for x in centre], "radius": radius, "stiffness": 1e3}


def balls(*rows):
    return Contacts.model_validate({"spheres": [ball(*row) for row in rows]})


def least_clearance(rows, contacts, arm=ARM):
    """By dense samples of shapes (n, n_q) and of the arm from one radius on."""
    points = np.stack([arm.poses(rows, s)[:, :3, 3] for s in np.arange(RADIUS, arm.length, 5e-4)])
    found = [
        np.linalg.norm(points - one.centre, axis=2).min() - one.radius - RADIUS for one in contacts.spheres
    ]
    for one in contacts.planes:
        found.append(((points - one.point) @ np.array(one.normal)).min() - RADIUS)
    return min(found)


ABOVE = np.array([0.0, 0.0, 0.01])
MIDDLE = tip(0.5 * (START + END)) + ABOVE
IN_THE_WAY = balls((MIDDLE, 0.012))


def dense(way):
    """Coordinates between the shapes of a way too."""
    places = np.linspace(0.0, len(way.q) - 1.0, 8 * len(way.q))
    return np.stack([np.interp(places, np.arange(len(way.q)), column) for column in way.q.T], axis=1)


@pytest.fixture(scope="module")
def way():
    return plan_around(ARM, START, tip(END), IN_THE_WAY, margin_m=3e-3)


@pytest.mark.slow
def test_the_map_from_pressures_is_the_equilibrium_on_any_line():
    shapes = HeldShapes(ARM, obstacles_of(ARM, IN_THE_WAY), LOW, HIGH, np.full(6, 100.0))
    random = np.random.default_rng(3)
    for _ in range(5):
        begin, end = random.random((2, 6))
        q = equilibrium(ARM, LOW + begin * (HIGH - LOW))
        line = shapes.line(begin, end, q, -np.inf, 7)
        assert line.whole
        for x, found, places, clearance in zip(line.x, line.q, line.places, line.clearance_m, strict=True):
            np.testing.assert_allclose(found, equilibrium(ARM, LOW + x * (HIGH - LOW)), atol=1e-6)
            there = np.array([ARM.pose(found, s)[:3, 3] for s in shapes.obstacles.places])
            np.testing.assert_allclose(places, there, atol=1e-12)
            assert clearance <= shapes.obstacles.clearance(there).min() + 1e-12


def test_a_line_ends_before_the_arm_is_nearer_than_the_margin():
    shapes = HeldShapes(ARM, obstacles_of(ARM, IN_THE_WAY), LOW, HIGH, np.full(6, 100.0))
    x, end = START / HIGH, END / HIGH
    line = shapes.line(x, end, equilibrium(ARM, START), 3e-3, 200)
    assert not line.whole
    assert least_clearance(line.q, IN_THE_WAY) >= 3e-3 - 5e-5  # between its places
    further = HIGH * (line.x[-1] + 2.0 * (line.x[-1] - line.x[-2]))
    assert least_clearance(equilibrium(ARM, further, line.q[-1])[None], IN_THE_WAY) < 3e-3


def test_the_whole_arm_goes_around_a_ball_with_pressures_that_hold_it(way):
    straight = np.array([equilibrium(ARM, p) for p in np.linspace(START, END, 40)])
    assert least_clearance(straight, IN_THE_WAY) < 0.0
    assert least_clearance(dense(way), IN_THE_WAY) > 3e-3 - 5e-5
    assert way.clearance_m == pytest.approx(least_clearance(dense(way), IN_THE_WAY), abs=1e-4)
    assert np.all((way.pressure_pa >= LOW) & (way.pressure_pa <= HIGH))
    np.testing.assert_allclose(way.pressure_pa[0], START, atol=1e-6)
    np.testing.assert_allclose(way.tip_m[-1], tip(END), atol=1.1e-4)
    for p, q, at in zip(way.pressure_pa, way.q, way.tip_m, strict=True):
        np.testing.assert_allclose(q, equilibrium(ARM, p, q), atol=1e-6)
        np.testing.assert_allclose(at, ARM.pose(q, ARM.length)[:3, 3], atol=1e-9)


def test_the_same_seed_gives_the_same_way_and_a_load_another(way):
    again = plan_around(ARM, START, tip(END), IN_THE_WAY, margin_m=3e-3)
    assert np.array_equal(again.q, way.q)
    heavy = SoftArm(TWO.replace(tip_mass=0.005))
    lower = balls((tip(0.5 * (START + END), heavy) + ABOVE, 0.005))
    loaded = plan_around(heavy, START, tip(END, heavy), lower, margin_m=3e-3)
    for p, q in zip(loaded.pressure_pa[::8], loaded.q[::8], strict=True):
        np.testing.assert_allclose(q, equilibrium(heavy, p, q), atol=1e-6)
    assert least_clearance(dense(loaded), lower, heavy) > 3e-3 - 5e-5


def test_planes_count_and_a_way_without_anything_near_is_a_straight_line():
    side = ARM.pose(equilibrium(ARM, START), ARM.length)[:3, 3]
    floor = Contacts.model_validate(
        {"planes": [{"point": [0.0, 0.0, side[2] - 0.05], "normal": [0, 0, 1], "stiffness": 1e3}]}
    )
    found = plan_around(ARM, START, tip(END), floor)
    lines = np.linspace(found.pressure_pa[0], found.pressure_pa[-1], len(found.q))
    gaps = np.linalg.norm(found.pressure_pa[:, None] - lines[None], axis=2).min(axis=1)
    assert gaps.max() < 0.05 * np.linalg.norm(lines[-1] - lines[0])
    assert least_clearance(dense(found), floor) > 2e-3


@pytest.mark.parametrize(
    ("goal", "obstacles", "reason", "text"),
    [
        (tip(END), balls((tip(END) + 3.0 * ABOVE, 0.02)), "contact", r"contacts.*with the tip at"),
        (tip(END), balls((tip(START), 0.01)), "contact", r"contacts\.spheres\[0\] .*at the start"),
        (np.array([0.5, 0.0, 0.0]), IN_THE_WAY, "reach", r"goal: got '\(500\.0, 0\.0, 0\.0\) mm'"),
    ],
)  # fmt: skip
def test_a_goal_in_an_obstacle_a_start_in_one_and_a_goal_out_of_reach_are_refused(
    goal, obstacles, reason, text
):
    with pytest.raises(MotionError, match=text) as caught:
        plan_around(ARM, START, goal, obstacles)
    assert caught.value.reason == reason
    assert "\n" not in str(caught.value)


def test_a_goal_that_the_tip_but_not_the_arm_keeps_clear_of_an_obstacle_is_refused():
    """A ball beside the base: the arm is straight at full pressure, and its tip has one shape."""
    goal = tip(HIGH)
    beside = ARM.pose(equilibrium(ARM, HIGH), 0.4 * ARM.length)[:3, 3] + [RADIUS + 0.003, 0.0, 0.0]
    with pytest.raises(MotionError, match=r"contacts\.spheres\[0\].*with the tip at") as caught:
        plan_around(ARM, START, goal, balls((beside, 0.004)))
    assert re.search(r"at \d+ mm of its length \(link0\)", str(caught.value))


def test_a_way_that_is_not_found_says_among_how_many_shapes():
    with pytest.raises(MotionError, match=r"no way found among 130 shapes.*around_shapes"):
        plan_around(ARM, START, tip(END), IN_THE_WAY, margin_m=3e-3, shapes=130)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"margin_m": -1e-3}, "margin_m"),
        ({"margin_m": np.nan}, "margin_m"),
        ({"tolerance_m": np.inf}, "tolerance_m"),
        ({"start": np.zeros(5)}, "start"),
        ({"goal": [0.0, np.nan, 0.0]}, "goal"),
        ({"obstacles": Contacts()}, "obstacles"),
        ({"obstacles": None}, "obstacles"),
        ({"limit": np.zeros(3)}, "limit"),
        ({"shapes": -1}, "shapes"),
        ({"margin": 1e-3}, "margin.*margin_m"),
    ],
)
def test_what_is_not_allowed_gets_one_line(changes, key):
    given = {"start": START, "goal": tip(END), "obstacles": IN_THE_WAY, **changes}
    with pytest.raises(ModelError, match=key) as caught:
        plan_around(ARM, **given)
    assert "\n" not in str(caught.value)


# The motion of a controller ------------------------------------------------------------------------------


def controller(contacts, **motion):
    config = {"law": "composite", "reference": {"kind": "hold"}, "motion": motion}
    robot = TWO.replace(contacts=contacts.model_dump())
    return Controller(robot, parse(config, ControllerConfig, "test"))


def test_a_motion_around_keeps_speed_pressures_and_clearance():
    control = controller(IN_THE_WAY, margin_m=3e-3, speed_m_s=0.03)
    state, begin = control.initial_state(), equilibrium(ARM, START)
    planner = control.planner(state, 0.005)
    still = Point(begin, np.zeros(6), np.zeros(6))
    motion = finished(planner.motion(finished(route_around(planner, begin, tip(END))), still, 0.0))
    times = np.arange(0.0, motion.end_s, 5e-3)
    rows = np.array([motion.sample(t).q for t in times])
    assert least_clearance(rows, IN_THE_WAY) > 2.8e-3
    tips = np.array([ARM.pose(q, ARM.length)[:3, 3] for q in rows])
    speed = np.linalg.norm(np.diff(tips, axis=0), axis=1) / 5e-3
    assert 0.01 < speed.max() < 0.0303
    assert np.linalg.norm(np.diff(tips, 2, axis=0), axis=1).max() / 25e-6 < 0.11
    np.testing.assert_allclose(tips[-1], tip(END), atol=2e-4)
    held = [
        np.linalg.solve(ARM.actuation_matrix(q), ARM.gravity_force(q) + ARM.elastic_force(q)) for q in rows
    ]
    assert np.min(held) > -200.0
    assert np.max(held) < HIGH[0]


def test_a_point_that_only_pressures_at_the_end_of_their_range_hold_is_refused_with_the_range_that_is_left():
    start, end = np.zeros(6), np.array([0.0, 80e3, 0.0, 0.0, 75e3, 0.0])
    beside = balls((tip(START), 0.004))
    np.testing.assert_allclose(plan_around(ARM, start, tip(end), beside).tip_m[-1], tip(end), atol=1.1e-4)
    control = controller(beside)
    planner = control.planner(control.initial_state(), 0.005)
    with pytest.raises(MotionError, match=r"can reach with 1\.8 to 88\.2 kPa"):
        finished(route_around(planner, equilibrium(ARM, start), tip(end)))


def test_without_obstacles_the_way_around_is_the_one_of_coordinates():
    config = parse({"law": "composite", "reference": {"kind": "hold"}}, ControllerConfig, "test")
    planner = Controller(TWO, config).planner(Controller(TWO, config).initial_state(), 0.005)
    begin = equilibrium(ARM, START)
    goal = tip(0.9 * START)
    route = finished(route_around(planner, begin, goal))
    assert route.parts == ()
    np.testing.assert_allclose(ARM.pose(route.first, ARM.length)[:3, 3], goal, atol=1e-4)


def test_the_learned_load_bends_the_way():
    control = controller(balls((MIDDLE, 0.004)), margin_m=1e-3)
    planner = replace(control.planner(control.initial_state(), 0.005), load_kg=0.005)
    heavy = SoftArm(TWO.replace(tip_mass=0.005))
    route = finished(route_around(planner, equilibrium(ARM, START), tip(END, heavy)))
    first = equilibrium(heavy, np.clip(START, 0.02 * HIGH, 0.98 * HIGH))
    np.testing.assert_allclose(route.first, first, atol=1e-5)
