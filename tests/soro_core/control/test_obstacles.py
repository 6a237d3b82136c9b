"""A reference on whose way the arm would meet an obstacle of its robot file is refused, with the place."""

import re
from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.adaptation.learned import Learned
from soro_core.config import find_config, parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.motions.lookout import line
from soro_core.control.reference.trajectory import Point
from soro_core.control.retune import retune
from soro_core.errors import ConfigError
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.planning.motion_error import MotionError
from soro_core.planning.steps import finished
from soro_core.robot import Discretisation

ROBOT = load_robot(find_config("tue_three_bellow", "robots"))
DT = 0.005
REST = np.array([0.05, 0.0, 0.0])
LINE = np.array([[-0.015, 0.0, 0.066], [0.015, 0.0, 0.066]])
RADIUS = ROBOT.links[0].radius


def ball(centre, radius):
    return {"centre": list(centre), "radius": radius, "stiffness": 1e3}


def wall(point, normal):
    return {"point": list(point), "normal": list(normal), "stiffness": 1e3}


def controller(spheres=(), planes=(), model=Discretisation(), reference=None, law="composite"):  # noqa: B008
    config = {"law": law, "reference": reference or {"kind": "hold"}}
    contacts = {"spheres": list(spheres), "planes": list(planes)}
    robot = ROBOT.replace(contacts=contacts) if spheres or planes else ROBOT
    return Controller(robot, parse(config, ControllerConfig, "test"), model)


def loaded(control, mass_kg):
    state = control.initial_state()
    theta = np.zeros_like(state.law.learner.learned.theta)
    theta[0] = mass_kg
    return replace(state, law=replace(state.law, learner=replace(state.law.learner, learned=Learned(theta))))


def following(control, q):
    """State of a controller whose reference rests at `q`."""
    state, zero = control.initial_state(), np.zeros(control.arm.n_q)
    hold = Controller(ROBOT, parse({"reference": {"kind": "hold"}}, ControllerConfig, "test")).step
    after, command = hold(hold.__self__.initial_state(), q, zero, 0.0, DT, np.zeros(3))
    assert command.status.ok
    return replace(state, following=after.following)


def planned(control, path=LINE, state=None, begin=REST):
    state = state or control.initial_state()
    still = Point(begin, np.zeros_like(begin), np.zeros_like(begin))
    return finished(control.planner(state, DT).plan(still, np.array(path), None, 0.0))


def least_clearance(motion, robot):
    """By dense samples of the motion and of the arm with constant strains, from one radius on."""
    arm = SoftArm(ROBOT)
    rows = np.array([motion.sample(t).q for t in np.arange(0.0, motion.end_s, 5e-3)])
    places = np.arange(RADIUS, arm.length, 2.5e-4)
    points = np.stack([arm.poses(rows, s)[:, :3, 3] for s in places])
    found = []
    for one in robot.contacts.spheres:
        found.append(np.linalg.norm(points - one.centre, axis=2).min() - one.radius - RADIUS)
    for one in robot.contacts.planes:
        normal = np.array(one.normal) / np.linalg.norm(one.normal)
        found.append(((points - one.point) @ normal).min() - RADIUS)
    return min(found)


@pytest.fixture(scope="module")
def free():
    """The motion that nothing refuses."""
    return planned(controller(law="adaptive"))


def obstacle(seed):
    """One to three obstacles near the way, of any size; balls beside any place of the arm."""
    rng = np.random.default_rng(seed)
    spheres, planes = [], []
    for _ in range(rng.integers(1, 4)):
        angle, height = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.02, 0.08)
        side = np.array([np.cos(angle), np.sin(angle), 0.0])
        if rng.random() < 0.7:
            radius = 10.0 ** rng.uniform(-4.0, -2.0)
            spheres.append(ball((RADIUS + radius + rng.uniform(0.0, 0.02)) * side + [0, 0, height], radius))
        else:
            planes.append(
                wall((RADIUS + rng.uniform(0.0, 0.03)) * side, -side + [0, 0, rng.uniform(-0.3, 0.3)])
            )
    return spheres, planes


@pytest.mark.slow
@pytest.mark.parametrize("law", ["adaptive", "composite"])
def test_a_motion_is_refused_where_a_dense_search_finds_that_the_arm_touches(law, free):
    """But for obstacles within 0.3 mm: weight bends the arm by that much between its ends."""
    refused = 0
    for seed in range(60 if law == "adaptive" else 20):
        spheres, planes = obstacle(seed)
        control = controller(spheres, planes, law=law)
        clearance = least_clearance(free, control.robot)
        if abs(clearance) < 3e-4:
            continue
        if clearance > 0.0:
            planned(control)
            continue
        with pytest.raises(MotionError) as caught:
            planned(control)
        assert caught.value.reason == "contact", seed
        refused += 1
    assert refused > 5


def test_a_line_along_a_ball_beside_the_middle_of_the_arm_is_refused_with_the_place():
    control = controller([ball((0.021, 0.0, 0.040), 0.004)])
    with pytest.raises(MotionError) as caught:
        planned(control)
    text = str(caught.value)
    assert re.search(r"got 'a clearance of -\d\.\d mm'", text), text
    assert "contacts.spheres[0] (centre (21.0, 0.0, 40.0) mm, radius 4 mm)" in text
    place = float(re.search(r"at (\d+) mm of its length \(link0\)", text)[1])
    assert 20 < place < 55
    assert re.search(r"[\d.]+ mm along the path", text)
    assert "\n" not in text


def test_the_way_to_the_path_counts_too():
    control = controller([ball((0.0, 0.0187, 0.066), 0.001)])
    one, other = np.array([[0.05, 4.0, 3.0], [0.05, -4.0, 3.0]])
    ends = [control.arm.pose(q, control.arm.length)[:3, 3] for q in (one, other)]
    planned(control, [ends[0]], begin=one)
    planned(control, [ends[1]], begin=other)
    with pytest.raises(MotionError, match=r"contacts.spheres\[0\].* on the way to the first pose"):
        planned(control, [ends[1]], begin=one)


def test_a_way_past_an_obstacle_that_both_ends_keep_clear_of_is_refused_on_each_topic():
    control = controller([ball((0.0, 0.036, 0.055), 0.012)])
    arm, names = control.arm, control.robot.coordinate_names
    one, other = np.array([[0.05, 9.0, 7.0], [0.05, -9.0, 7.0]])
    state = following(control, one)
    tip = arm.pose(other, arm.length)[:3, 3]
    with pytest.raises(MotionError, match=r"contacts.spheres\[0\]"):
        control.tip(state, tip)
    with pytest.raises(MotionError, match=r"contacts.spheres\[0\]"):
        control.trajectory(0.0, names, [1.0], [other], state=state)
    rows = [one, 0.5 * (one + other), other]
    with pytest.raises(MotionError, match=r"[\d.]+ s after its first point"):
        control.trajectory(0.0, names, [0.0, 1.0, 2.0], rows, state=state)
    around = [one, one * [1, 1, -1], other * [1, 1, -1], other]
    assert control.tip(state, arm.pose(one, arm.length)[:3, 3]).sample(0.0).q == pytest.approx(one, abs=1e-2)
    control.trajectory(0.0, names, [0.0, 1.0, 2.0, 3.0], around, state=state)


def test_a_trajectory_that_one_tick_cannot_look_at_is_refused():
    """A command that is late by 100 ms vents the arm."""
    control = controller([ball((0.09, 0.0, 0.04), 0.005)])
    times = np.linspace(0.02, 30.0, 600)
    rows = np.column_stack([0.05 + 0 * times, 8.0 * np.sin(times), 8.0 * np.cos(times)])
    names, state = control.robot.coordinate_names, following(control, rows[0])
    with pytest.raises(MotionError, match=r"more than one tick can look at .*50 points"):
        control.trajectory(0.0, names, times, rows, state=state)
    control.trajectory(0.0, names, times[:40], rows[:40], state=state)
    controller().trajectory(0.0, names, times, rows)


def test_a_place_that_is_no_number_is_not_clear(monkeypatch):
    control = controller([ball((0.09, 0.0, 0.04), 0.005)])
    state = following(control, REST)
    whole = control.lookout(state.law, REST)
    monkeypatch.setattr(
        whole, "_seen", lambda q, offset: np.full((len(q), len(whole.obstacles.places), 3), np.nan)
    )
    with pytest.raises(MotionError, match="clearance of nan mm"):
        finished(whole.follow(line(REST, REST, "on the way")))


def test_a_way_that_needs_more_places_than_are_looked_at_is_refused(monkeypatch):
    monkeypatch.setattr("soro_core.control.motions.lookout._MOST", 5)
    control = controller([ball((0.09, 0.0, 0.04), 0.005)])
    with pytest.raises(MotionError, match="places to look at"):
        planned(control)


CONFIGURED = {
    "path_m": {"kind": "path", "path_m": [-0.015, 0.0, 0.066, 0.015, 0.0, 0.066]},
    "curvature_per_m": {"kind": "circle", "curvature_per_m": 8.0, "elongation": 0.05},
    "set_point": {"kind": "set_point", "set_point": [0.05, 8.0, 0.0]},
}


@pytest.mark.parametrize("key", CONFIGURED)
def test_a_configured_reference_is_refused_with_its_key(key):
    near = ball((0.028, 0.0, 0.05), 0.008)
    with pytest.raises(ConfigError, match=rf"controller: reference\.{key}: .*contacts.spheres\[0\]"):
        controller([near], reference=CONFIGURED[key])
    far = ball((0.1, 0.0, 0.05), 0.008)
    control = controller([far], reference=CONFIGURED[key])
    assert control.configured is not None
    still = controller([near])
    changed = parse({"law": "composite", "reference": CONFIGURED[key]}, ControllerConfig, "test")
    with pytest.raises(ConfigError, match=rf"reference\.{key}"):
        retune(still, still.initial_state(), changed, 0.0)


def test_an_arm_that_begins_in_contact_may_move_away_but_not_further_in_nor_back():
    control = controller(planes=[wall((RADIUS - 5e-4, 0, 0), (-1, 0, 0))])  # 0.5 mm deep in its side
    arm, names = control.arm, control.robot.coordinate_names
    straight, left, right = np.array([[0.05, 0.0, 0.0], [0.05, -5.0, 0.0], [0.05, 5.0, 0.0]])
    state = following(control, straight)
    control.trajectory(0.0, names, [0.0, 1.0], [straight, left], state=state)
    control.tip(state, arm.pose(left, arm.length)[:3, 3])
    with pytest.raises(MotionError, match="touches at the begin too"):
        control.tip(state, arm.pose(right, arm.length)[:3, 3])
    with pytest.raises(MotionError, match="clearance of -0"):
        control.trajectory(0.0, names, [0.0, 1.0, 2.0], [straight, left, straight], state=state)


def test_an_arm_that_is_mounted_on_a_plane_may_move():
    control = controller(planes=[wall((0, 0, 0), (0, 0, 1))])
    assert planned(control).end_s > 0.0


def test_the_learned_load_bends_the_arm_into_a_ball_between_its_ends():
    """The ball is beside the middle of the arm, where a finer model rests, and clear without the load."""
    q, mass_kg = np.array([0.05, 0.0, 9.0]), 0.06
    arm = SoftArm(ROBOT)
    finer = SoftArm(ROBOT.replace(tip_mass=ROBOT.tip_mass + mass_kg).refine(6))
    control = controller([ball((0.2, 0.0, 0.0), 0.01)])
    tip = arm.pose(q, arm.length)[:3, 3]
    state = loaded(control, mass_kg)
    lookout = control.lookout(state.law, q)
    x = lookout.shape.spread @ q + lookout.shape.offset(q)
    middle = 0.5 * arm.length
    bent = lookout.shape.arm.pose(x, middle)[:3, 3]
    np.testing.assert_allclose(lookout.shape.arm.pose(x, arm.length)[:3, 3], tip, atol=2e-5)
    # Pressures that bring the tip of the finer arm there.
    force = control.law.reference_force(state.law, q, np.zeros(3), np.zeros(3))
    pressure = np.linalg.solve(arm.actuation_matrix(q), force)
    for _ in range(20):
        rest = equilibrium(finer, pressure, np.tile(q, 6))
        gap = tip - finer.pose(rest, finer.length)[:3, 3]
        if np.linalg.norm(gap) < 1e-6:
            break
        slopes = []
        for k in range(3):
            step = 50.0 * np.eye(3)[k]
            moved = equilibrium(finer, pressure + step, rest)
            slopes.append((finer.pose(moved, finer.length)[:3, 3] + gap - tip) / 50.0)
        pressure = pressure + np.linalg.solve(np.array(slopes).T, gap)
    true = finer.pose(rest, middle)[:3, 3]
    even = arm.pose(q, middle)[:3, 3]
    away = np.linalg.norm(true - even)
    assert away > 5e-4
    assert np.linalg.norm(bent - true) < 0.25 * away
    # A ball that the bent arm is half of `away` inside, and the even one as far outside.
    towards = (true - even) / away
    centre = even + towards * (RADIUS + 0.004 + 0.5 * away)
    near = controller([ball(centre, 0.004)])
    path = [tip - [0.0, 0.0, 1e-4], tip]
    planned(near, path, near.initial_state(), begin=q)
    with pytest.raises(MotionError, match=r"contacts.spheres\[0\]"):
        planned(near, path, loaded(near, mass_kg), begin=np.array([0.05, 0.0, 0.0]))


def test_coordinates_that_no_chamber_drives_are_where_the_load_puts_them():
    model = Discretisation(basis="legendre", order=1)
    control = controller([ball((0.2, 0.0, 0.0), 0.01)], model=model)
    state = loaded(control, 0.06)
    q = np.array([0.05, 0.0, 0.0, 0.0, 9.0, 0.0])
    shape = control.lookout(state.law, q).shape
    x = q + shape.offset(q)
    tip = shape.arm.pose(x, shape.arm.length)[:3, 3]
    np.testing.assert_allclose(tip, control.arm.pose(q, control.arm.length)[:3, 3], atol=5e-4)
    middle = 0.5 * control.arm.length
    assert np.linalg.norm((shape.arm.pose(x, middle) - control.arm.pose(q, middle))[:3, 3]) > 3e-4


def test_a_robot_that_knows_no_obstacle_is_not_looked_at():
    control = controller()
    assert control.lookout(control.initial_state().law, REST) is None
    planned(control)
