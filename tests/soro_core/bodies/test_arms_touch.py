"""Arms that touch each other, and an arm that touches itself."""

import dataclasses

import numpy as np
import pytest

from soro_core import BaseState, SoftArm, load_robot
from soro_core.bodies import BodyWorld, simulate_world
from soro_core.errors import ModelError
from tests.soro_core.bodies.scenes import BETWEEN, RADIUS, beam, crossing_beams, fingers, lower_beam
from tests.soro_core.bodies.scenes import close as close_hand

# Place along the lower beam, and along the upper one, at which they cross [m].
AT, REACH = 0.15, 0.18


def rest(world, depth, dt=1e-3, t_end=0.6, pull=0.0):
    """Lower the upper beam by a depth, and then move its base along the lower one."""
    result = simulate_world(
        world, t_end=t_end, dt=dt, motions={"low": lambda t: BaseState(), "high": lower_beam(depth, pull)}
    )
    assert result.status.ok, result.status
    return result


@pytest.mark.slow
@pytest.mark.parametrize("points", [3, 6])
@pytest.mark.parametrize("dt", [1e-3, 2.5e-4])
def test_two_crossed_beams_press_with_the_force_of_their_closed_form(dt, points):
    """F = depth / (1/k1 + 1/k2), k = 3 EI / a^3 / (1 - 1 / 4 n^2) of a beam of n = a / 25 mm arcs."""
    depth, bending = 2e-3, 5e7 * np.pi * RADIUS**4 / 4.0
    result = rest(crossing_beams(AT, REACH, points_per_link=points, arm_friction=0.0), depth, dt)
    soft = sum(a**3 / (3.0 * bending) * (1.0 - 1.0 / (4.0 * (a / 0.025) ** 2)) for a in (AT, REACH))
    force = result.contact_force("low")[-1]
    assert -force[2] == pytest.approx(depth / soft, rel=0.005)
    np.testing.assert_allclose(result.contact_force("high")[-1], -force, atol=1e-12)


def borne(result, name):
    """Generalised force on an arm by the contacts of the last step, at the sections nearest to them."""
    arm, q = result.world.arms[name], result.q[name][-1]
    places = np.linspace(0.0, arm.length, 2001)
    axis = np.array([arm.pose(q, s)[:3, 3] for s in places])
    total = np.zeros(arm.n_q)
    rows = result.contacts.step == len(result.t) - 1
    names, c = list(result.world.arms), result.contacts
    for side, point, normal, force in zip(
        c.side[rows], c.point[rows], c.normal[rows], c.force[rows], strict=True
    ):
        for end, way in ((0, 1.0), (1, -1.0)):
            if names[-1 - side[end]] == name:
                middle = point + way * arm.robot.links[0].radius * normal
                T, J = arm.pose_and_jacobian(q, places[np.linalg.norm(axis - middle, axis=1).argmin()])
                own = T[:3, :3].T @ (way * force)
                total += J[3:].T @ own + J[:3].T @ np.cross(T[:3, :3].T @ (point - T[:3, 3]), own)
    return total


@pytest.mark.slow
def test_each_arm_bears_what_the_other_one_gives():
    """At rest the forces of each arm balance the same force at the same point, with its sign."""
    result = rest(crossing_beams(AT, REACH), 2e-3, t_end=1.0)
    # The upper base is lowered: its forces are those seen from there.
    contacts = result.contacts
    for name, lift in (("low", 0.0), ("high", BETWEEN + 2e-3)):
        moved = dataclasses.replace(contacts, point=contacts.point + np.array([0.0, 0.0, lift]))
        own = result.world.arms[name].elastic_force(result.q[name][-1])
        given = borne(dataclasses.replace(result, contacts=moved), name)
        np.testing.assert_allclose(given, own, atol=0.01 * np.abs(own).max())


@pytest.mark.slow
def test_a_beam_that_is_drawn_across_another_sticks_and_then_slips():
    friction = 0.3
    result = rest(crossing_beams(AT, REACH, arm_friction=friction), 2e-3, t_end=1.2, pull=0.02)
    force, press = result.contact_force("low"), result.normal_force("low")
    across = np.sqrt(np.maximum((force**2).sum(axis=1) - press**2, 0.0))
    share = across / np.maximum(press, 1e-9)
    held = (result.t > 0.45) & (result.t < 0.5)
    assert share[held].max() < 0.6 * friction
    slips = result.t > 1.0
    np.testing.assert_allclose(share[slips], friction, rtol=1e-3)
    assert (force[slips, 0] > 0.0).all()


def test_a_closed_world_gains_no_energy_and_forgets_its_own_speed():
    """A blow between undamped arms on bases that all move alike: as at rest, and no energy comes of it."""
    lifted = {"high": np.tile([0.0, 0.0, -0.3], 8)}
    world = crossing_beams(AT, REACH, viscosity=0.0, arm_friction=0.0, q0=lifted)

    def drive(speed):
        return lambda t: BaseState(
            displacement=[speed * t, 0.0, 2.0 * speed * t], velocity=[speed, 0, 2 * speed]
        )

    runs = []
    for speed in (0.0, 0.7):
        result = simulate_world(world, t_end=0.2, dt=5e-4, motions=dict.fromkeys(world.arms, drive(speed)))
        assert result.status.ok, result.status
        runs.append(result)
    assert len(runs[0].contacts.gap) > 5
    for name in world.arms:
        np.testing.assert_allclose(
            runs[1].q[name], runs[0].q[name], atol=1e-9 * np.abs(runs[0].q[name]).max()
        )
    energy = runs[0].energy()
    rises = np.diff(energy)
    assert rises[rises > 0.0].sum() < 1e-3 * energy[0]
    assert energy[-1] < energy[0]


def curled():
    """A thin arm of eight links, each of which bends by 50 degrees at 100 kPa."""
    return SoftArm(beam("curled", radius=0.006, length=0.03, youngs=1e6, chamber=True))


def close(t):
    return np.full(8, 100e3 * min(t / 0.5, 1.0))


def least_gap(arm, q, skip=4):
    """Smallest distance of two sections that are at least `skip` links apart, less the diameter."""
    places = np.linspace(0.0, arm.length, 161)
    x = np.array([arm.pose(q, s)[:3, 3] for s in places])
    apart = np.linalg.norm(x[:, None] - x[None], axis=2)
    far = np.abs(places[:, None] - places[None]) > skip * 0.03
    return apart[far].min() - 0.012


def test_an_arm_that_curls_up_is_stopped_by_itself():
    arm = curled()
    ends = {}
    for touch in (True, False):
        world = BodyWorld({}, {"arm": arm}, touch_arms=touch)
        result = simulate_world(world, t_end=1.0, pressures={"arm": close})
        assert result.status.ok, result.status
        ends[touch] = result
        np.testing.assert_allclose(result.contact_force("arm"), 0.0, atol=1e-12)
    assert len(ends[False].contacts.gap) == 0
    assert least_gap(arm, ends[False].q["arm"][-1]) < -3e-3
    assert least_gap(arm, ends[True].q["arm"][-1]) > -2e-4
    assert ends[True].normal_force("arm")[-1] > 0.01
    assert ends[True].normal_force("arm")[ends[True].t < 0.2].max() == 0.0  # neighbours do not touch


@pytest.mark.slow
def test_the_force_of_an_arm_on_itself_depends_neither_on_the_step_nor_on_the_number_of_points():
    forces = []
    for dt, points in ((1e-3, 6), (1e-3, 3), (1e-3, 24), (2.5e-4, 6)):
        world = BodyWorld({}, {"arm": curled()}, points_per_link=points)
        result = simulate_world(world, t_end=1.5, dt=dt, pressures={"arm": close})
        forces.append(result.normal_force("arm")[-1])
    assert forces[0] > 0.1
    np.testing.assert_allclose(forces, forces[0], rtol=0.005)


def test_an_arm_that_touches_itself_bears_the_force_on_both_sides():
    arm = curled()
    result = simulate_world(BodyWorld({}, {"arm": arm}), t_end=2.0, pressures={"arm": close})
    assert result.status.ok, result.status
    q = result.q["arm"][-1]
    assert np.abs(result.qd["arm"][-1]).max() < 1e-3
    given = borne(result, "arm")
    own = arm.elastic_force(q) - arm.pressure_force(q, close(2.0))
    np.testing.assert_allclose(given, own, atol=0.02 * np.abs(given).max())


@pytest.mark.parametrize("friction", [0.0, 0.5, 2.0])
def test_three_fingers_close_on_each_other(friction):
    """By symmetry each presses on two others, all with one force, and all rest."""
    world = BodyWorld({}, fingers(), arm_friction=friction)
    result = simulate_world(world, t_end=1.5, pressures=close_hand(world))
    assert result.status.ok, result.status
    forces = [result.normal_force(name)[-1] for name in world.arms]
    assert forces[0] > 0.05
    np.testing.assert_allclose(forces, forces[0], rtol=1e-4)
    assert max(np.abs(result.qd[name][-1]).max() for name in world.arms) < 1e-5


def test_arms_that_overlap_at_the_start_are_named_with_their_depth():
    world = crossing_beams(AT, REACH)
    high = SoftArm(world.arms["high"].robot.replace(base_position=[AT, -REACH, 2.0 * RADIUS - 1e-3]))
    with pytest.raises(ModelError, match="arm high and arm low overlap at the start by 1 mm"):
        simulate_world(BodyWorld({}, {"low": world.arms["low"], "high": high}), t_end=0.01)
    q0 = {"arm": np.tile([0.0, -29.0, 0.0], 8)}
    with pytest.raises(ModelError, match="arm arm and itself overlap at the start by"):
        simulate_world(BodyWorld({}, {"arm": curled()}, q0), t_end=0.01)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"arm_friction": -0.1}, "arm_friction = -0.1: allowed are numbers from 0 to 10"),
        ({"touch_arms": "no"}, "touch_arms: got 'no'; allowed: true or false"),
        ({"bodies": {}, "arms": {}}, "bodies: there is none, and no arm"),
    ],
)
def test_wrong_keys_of_arms_are_refused_in_one_line(keys, said):
    robot = load_robot("config/robots/tue_three_bellow.yaml")
    with pytest.raises(ModelError) as caught:
        BodyWorld(**{"bodies": {}, "arms": {"arm": SoftArm(robot)}, **keys})
    assert said in str(caught.value)
