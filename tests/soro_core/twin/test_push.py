"""What pushes on the true arm: a wrench of the scene or of a call, and a wall that moves."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.config import find_config, parse
from soro_core.errors import ModelError
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.twin import Twin, TwinConfig
from tests.refused import fails, refused

PRESSURE = np.array([10e3, 20e3, 15e3])
FORCE = np.array([0.05, -0.03, 0.02])
# It leans over the arm, so that the tip alone meets it.
NORMAL = np.array([-0.9, 0.0, -0.4]) / np.hypot(0.9, 0.4)
STIFFNESS = 20000.0


@pytest.fixture(scope="module")
def robot():
    return load_robot(find_config("tue_three_bellow", "robots"))


def twin_of(robot, **keys):
    return Twin(robot, parse({"refine": 1, "damping_scale": 5.0, **keys}, TwinConfig, "test"))


def run(twin, seconds, state=None):
    """States after each tick, under constant pressures."""
    states = [twin.initial(PRESSURE) if state is None else state]
    for _ in range(round(seconds / twin.dt)):
        states.append(twin.step_pressures(states[-1], PRESSURE))
        assert states[-1].status.ok, states[-1].status
    return states


def tip_of(twin, state):
    return twin.observe(state)[1].tip[:3, 3]


def wall_at(robot, gap, **keys):
    """Wall of a distance from the tip of the arm at rest."""
    plain = twin_of(robot)
    point = tip_of(plain, plain.initial(PRESSURE)) - (robot.links[-1].radius + gap) * NORMAL
    return {"stiffness": STIFFNESS, "normal": NORMAL.tolist(), "point": point.tolist(), **keys}


def test_a_push_bends_the_arm_to_its_equilibrium_and_lets_it_go(robot):
    twin = twin_of(robot, wrench={"at_s": [0.1, 2.0], "force_n": [FORCE.tolist(), [0.0, 0.0, 0.0]]})
    states = run(twin, 4.0)
    pushed = [twin.observe(state)[1].push_n for state in states]
    np.testing.assert_array_equal(pushed[19:21], [np.zeros(3), FORCE])  # 5 ms each
    np.testing.assert_array_equal(pushed[399:401], [FORCE, np.zeros(3)])
    bent, arm = states[399], twin.plant.arm
    turn = twin.observe(bent)[1].tip[:3, :3]
    wanted = equilibrium(arm, PRESSURE, wrench=np.concatenate((np.zeros(3), turn.T @ FORCE)))
    away = tip_of(twin, bent) - tip_of(twin, states[0])
    assert np.linalg.norm(away) > 3e-3
    np.testing.assert_allclose(tip_of(twin, bent), arm.pose(wanted, arm.length)[:3, 3], atol=1e-4)
    np.testing.assert_allclose(tip_of(twin, states[-1]), tip_of(twin, states[0]), atol=1e-4)


def test_a_call_pushes_as_the_scene_does(robot):
    torque = np.array([1e-3, -2e-3, 5e-4])
    rows = {"at_s": [0.0], "force_n": [FORCE.tolist()], "torque_nm": [torque.tolist()]}
    of_scene, plain = twin_of(robot, wrench=rows), twin_of(robot)
    pushed = plain.at_wrench(plain.initial(PRESSURE), FORCE, torque)
    ends = [run(of_scene, 0.1)[-1], run(plain, 0.1, pushed)[-1]]
    np.testing.assert_array_equal(ends[0].arm.q, ends[1].arm.q)
    np.testing.assert_array_equal(plain.observe(ends[1])[1].push_n, FORCE)
    assert np.abs(ends[0].arm.q - run(plain, 0.1)[-1].arm.q).max() > 1e-3
    np.testing.assert_array_equal(plain.observe(plain.at_wrench(ends[1], np.zeros(3)))[1].push_n, np.zeros(3))
    with fails(ModelError, "finite"):
        plain.at_wrench(ends[1], [np.nan, 0.0, 0.0])


@pytest.mark.slow
def test_a_push_along_the_arm_acts_at_its_place(robot):
    """By the work of its force there, against the arm's own weight and stiffness."""
    rows = {"at_s": [0.0], "force_n": [(10 * FORCE).tolist()], "location": 0.4}
    twin = twin_of(robot, wrench=rows, model={"links": 2})
    state, arm = run(twin, 2.0)[-1], twin.plant.arm
    q, s = state.arm.q, 0.4 * twin.length
    jacobian = arm.pose(q, s)[:3, :3] @ arm.jacobian(q, s)[3:]
    left = arm.gravity_force(q) + arm.elastic_force(q) - arm.pressure_force(q, PRESSURE)
    pushed = jacobian.T @ (10 * FORCE)
    np.testing.assert_allclose(left, pushed, atol=0.02 * np.abs(pushed).max())


def test_a_ramp_grows_from_row_to_row(robot):
    rows = {"at_s": [1.0, 2.0], "force_n": [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]], "change": "ramp"}
    wrench = twin_of(robot, wrench=rows).config.wrench
    assert [wrench.at(t)[3] for t in (0.5, 1.0, 1.5, 2.0, 9.0)] == pytest.approx([0.0, 0.0, 0.1, 0.2, 0.2])


def test_before_control_begins_nothing_pushes(robot):
    keys = {"wrench": {"at_s": [0.0], "force_n": [[0.1, 0.0, 0.0]]}}
    twin, plain = twin_of(robot, **keys), twin_of(robot)
    waiting = replace(twin.initial(PRESSURE), start_tick=None)
    np.testing.assert_array_equal(run(twin, 0.05, waiting)[-1].arm.q, run(plain, 0.05)[-1].arm.q)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["trapezoidal", "tr_bdf2_linear"])
def test_a_wall_carries_the_tip_along_at_its_speed(robot, integrator):
    """A stiff wall that comes with 10 mm/s: it meets the tip, and the tip stays on its face."""
    speed = (0.01 * NORMAL).tolist()
    wall = wall_at(robot, 2e-3, damping=1.0, velocity_m_s=speed, from_s=0.1, to_s=1.1)
    twin = twin_of(robot, wall=wall, integrator=integrator)
    states = run(twin, 1.6)
    seen = [twin.observe(state)[1] for state in states]
    np.testing.assert_array_equal(seen[55].contact_n, 0.0)  # after 1.75 mm
    forces = np.array([one.contact_n for one in seen])
    for tick, moved in ((160, 7e-3), (-1, 10e-3)):
        force = forces[tick] @ NORMAL
        assert force > 0.03
        face = np.array(wall["point"]) + moved * NORMAL
        gap = NORMAL @ (seen[tick].tip[:3, 3] - face)
        assert gap == pytest.approx(robot.links[-1].radius - force / STIFFNESS, abs=1e-9)
    late = forces[100:220] @ NORMAL
    assert 0.0 < np.diff(late).max() < 0.02 * late.max()  # it does not chatter
    q, arm = states[-1].arm.q, twin.plant.arm
    left = arm.gravity_force(q) + arm.elastic_force(q) - arm.pressure_force(q, PRESSURE)
    pushed = arm.external_forces(q).generalised
    np.testing.assert_allclose(left, pushed, atol=0.02 * np.abs(pushed).max())


def test_a_hard_wall_without_losses_does_not_throw_the_tip(robot):
    """Steps of 2.5 ms let the tip bounce 18 mm off a wall that comes with 10 mm/s."""
    wall = wall_at(robot, 2e-3, velocity_m_s=(0.01 * NORMAL).tolist())
    twin = twin_of(robot, wall=wall, step_s=0.0025)
    states = run(twin, 1.0)[45:]
    gaps = [NORMAL @ (tip_of(twin, s) - twin.config.wall.at(s.tick * twin.dt)[0]) for s in states]
    assert max(gaps) - robot.links[-1].radius < 3e-4


def test_a_wall_that_slides_drags_the_tip_by_friction(robot):
    wall = wall_at(robot, -2e-3, friction=0.5)
    y = []
    for v in (-0.05, 0.0, 0.05):
        twin = twin_of(robot, wall={**wall, "velocity_m_s": [0.0, v, 0.0]})
        y.append(tip_of(twin, run(twin, 0.5)[-1])[1])
    assert y[0] + 3e-4 < y[1] < y[2] - 3e-4


def test_without_a_wall_no_place_touches(robot):
    twin = twin_of(robot)
    assert twin.plant.arm.robot.contacts is None
    assert not twin.plant.arm.robot.wrench_places
    np.testing.assert_array_equal(twin.observe(twin.initial())[1].force_n, np.zeros(3))


@pytest.mark.parametrize(
    ("section", "keys", "names"),
    [
        ("wrench", {"at_s": [1.0], "force_n": []}, ("3 numbers", "0")),
        ("wrench", {"at_s": [2.0, 1.0], "force_n": [[0.0] * 3] * 2}, ("increase",)),
        ("wrench", {"at_s": [1.0], "force_n": [[1e3, 0.0, 0.0]]}, ("100 N",)),
        ("wrench", {"at_s": [1.0], "force_n": [1.0, 0.0]}, ("3 numbers",)),
        ("wall", {"stiffness": 1.0, "normal": [0.0, 0.0, 0.0]}, ("zeros",)),
        ("wall", {"stiffness": 1.0, "velocity_m_s": [3.0, 0.0, 0.0]}, ("1 m/s",)),
        ("wall", {"stiffness": 1.0, "from_s": 3.0, "to_s": 1.0}, ("from_s",)),
    ],
)
def test_pushes_that_cannot_be_are_refused(section, keys, names):
    with refused(section, names=names):
        parse({section: keys}, TwinConfig, "test")


@pytest.mark.slow
def test_contact_of_an_arm_on_a_base_that_moves(robot):
    """The base has come 3 mm nearer to the wall: its force is that of the arm that stands there."""
    shake = {"frequency_hz": 10.0, "amplitude_m": (-3e-3 * NORMAL).tolist()}
    twin = twin_of(robot, wall=wall_at(robot, 0.0, stiffness=100.0), base_shake=shake)
    arm = twin.plant.arm
    state = replace(twin.initial(PRESSURE), tick=5)  # a quarter of a period
    there = SoftArm(arm.robot.replace(base_position=(arm.robot.base_position - 3e-3 * NORMAL).tolist()))
    wanted = there.external_forces(state.arm.q).force.sum(axis=0)
    assert wanted @ NORMAL > 0.2
    np.testing.assert_allclose(twin.observe(state)[1].contact_n, wanted, atol=1e-9)
