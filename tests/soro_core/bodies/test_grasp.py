"""Arms and bodies together: what three fingers hold, what they lose, and what does not depend on the step."""

import time

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.bodies import BallShape, BodyWorld, BoxShape, CylinderShape, RigidBody, simulate_world
from soro_core.errors import ModelError
from soro_core.integrate import simulate
from soro_core.robot import Shake
from tests.soro_core.bodies.scenes import MASS, WEIGHT, close, fingers, grasp, grip

SHAPES = {"ball": BallShape(radius=0.016), "cylinder": CylinderShape(radius=0.016, length=0.03)}


@pytest.mark.parametrize("shape", SHAPES)
def test_three_fingers_hold_an_object_without_creep(shape):
    result = grasp(grip(SHAPES[shape]), t_end=3.0)
    assert result.status.ok
    late = result.t > 2.0
    height = result.place["object"][late, 2]
    assert height[-1] > -0.07
    creep = np.polyfit(result.t[late], height, 1)[0]
    assert abs(creep) < 1e-9  # asked: 1e-6 m/s
    balance = result.contact_force("object")[late, 2] / (MASS * WEIGHT) - 1.0
    assert np.abs(balance).max() < 1e-6  # asked: 1e-3
    assert len(set(result.contacts.side[result.contacts.step == len(result.t) - 1, 0])) == 3


def test_without_enough_friction_the_object_goes_with_the_table():
    result = grasp(grip(friction=0.2), t_end=2.0)
    assert result.place["object"][-1, 2] < -0.072


def test_arms_feel_what_the_object_feels():
    result = grasp(grip(), t_end=1.9)
    forces = sum(result.contact_force(name) for name in result.world.arms)
    total = result.contact_force("object") + forces + result.contact_force("table")
    np.testing.assert_allclose(total, 0.0, atol=1e-12)


def pulled_out(shape="ball", dt=1e-3, points=6):
    """Force at which a pull downwards of 0.5 N/s, from 1.6 s on, has drawn the object out by 10 mm [N]."""
    world = grip(SHAPES[shape], points_per_link=points)
    result = grasp(
        world,
        t_end=2.9,
        dt=dt,
        wrenches={"object": lambda t: [0.0, 0.0, 0.0, 0.0, 0.0, -0.5 * max(t - 1.6, 0.0)]},
    )
    assert result.status.ok
    height = result.place["object"][:, 2]
    out = np.argmax(height < height[round(1.6 / dt)] - 0.01)
    assert out > 0
    return 0.5 * (result.t[out] - 1.6)


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
def test_the_force_of_a_pull_out_depends_neither_on_the_step_nor_on_the_number_of_points(shape):
    """Asked: 3 % from 1 ms to 0.25 ms and from 6 to 24 points a link."""
    known = pulled_out(shape)
    for dt, points in ((2.5e-4, 6), (1e-3, 24), (1e-3, 3)):
        assert pulled_out(shape, dt, points) == pytest.approx(known, rel=0.005), (dt, points)


@pytest.mark.slow
def test_a_held_object_stays_while_the_hand_shakes():
    """0.3 g at 2 Hz; the bases of all fingers move, the table is gone."""
    amplitude = 0.3 * WEIGHT / (2.0 * np.pi * 2.0) ** 2
    shake = Shake(frequency_hz=2.0, amplitude_m=[amplitude, 0.0, 0.0])

    def motion(t):
        return shake(max(t - 1.5, 0.0)) if t > 1.5 else Shake()(0.0)

    world = grip()
    result = grasp(world, t_end=3.0, motions=dict.fromkeys(world.arms, motion))
    assert result.status.ok
    swing = result.place["object"][result.t > 2.0, 0]
    # The fingers give way: it swings more than they do.
    assert 1.0 < np.ptp(swing) / (2.0 * amplitude) < 1.5
    height = result.place["object"][:, 2]
    assert height[-1] > -0.07
    assert abs(height[-1] - height[round(2.5 * 1000)]) < 2e-5


def test_an_arm_that_touches_nothing_moves_as_alone():
    """As with the implicit midpoint rule, whose step is that of an arm without contact."""
    arm = SoftArm(load_robot("config/robots/tue_three_bellow.yaml"))
    pressure = np.array([20e3, 5e3, 0.0])
    start = np.array([0.02, 2.0, -1.0])
    far = {"ball": RigidBody(shape=BallShape(radius=0.01), fixed=True, position=[1.0, 0.0, 0.0])}
    result = simulate_world(
        BodyWorld(far, {"arm": arm}, {"arm": start}), t_end=0.2, pressures={"arm": pressure}
    )
    alone = simulate(arm, start, t_end=0.2, dt=1e-3, pressure=pressure, integrator="midpoint")
    # Both stop Newton's iteration at their own tolerance.
    np.testing.assert_allclose(result.q["arm"], alone.q, atol=1e-4)
    np.testing.assert_allclose(result.internal["arm"], alone.internal, atol=1e-4)


def test_an_arm_leans_on_a_wall_with_the_force_of_its_equilibrium():
    """The force on the wall is what holds the arm there: J' f balances its own forces at rest."""
    arm = SoftArm(load_robot("config/robots/tue_three_bellow.yaml"))
    wall = RigidBody(
        shape=BoxShape(size=[0.02, 0.2, 0.2]), fixed=True, position=[0.03, 0.0, 0.05], friction=0.0
    )
    pressure = np.array([0.0, 30e3, 30e3])
    result = simulate_world(BodyWorld({"wall": wall}, {"arm": arm}), t_end=2.0, pressures={"arm": pressure})
    force = result.contact_force("arm")[-1]
    assert force[0] < -0.02
    q = result.q["arm"][-1]
    assert np.abs(result.qd["arm"][-1]).max() < 1e-4
    rows = result.contacts.step == len(result.t) - 1
    own = arm.pressure_force(q, pressure) - arm.elastic_force(q) - arm.gravity_force(q)
    T, J = arm.pose_and_jacobian(q, arm.length)
    lever = result.contacts.point[rows] - T[:3, 3]
    pushes = result.contacts.force[rows] @ T[:3, :3]
    given = sum(
        J[3:].T @ f + J[:3].T @ (T[:3, :3].T @ np.cross(r, T[:3, :3] @ f))
        for r, f in zip(lever, pushes, strict=True)
    )
    np.testing.assert_allclose(own + given, 0.0, atol=0.02 * np.abs(given).max())


def test_an_arm_that_begins_in_a_body_is_refused():
    world = grip(BallShape(radius=0.03))
    with pytest.raises(ModelError, match=r"arm finger\d and body object overlap at the start by"):
        grasp(world)


@pytest.mark.slow
def test_arms_of_different_kinds_share_a_world():
    """One has a wrench place, the others have nothing that acts on them from outside."""
    arms = fingers()
    arms["finger0"] = SoftArm(arms["finger0"].robot.replace(wrench_places=[0.03]))
    mixed, plain = grasp(grip(arms=arms), t_end=1.5), grasp(grip(), t_end=1.5)
    np.testing.assert_allclose(mixed.place["object"], plain.place["object"], atol=1e-7)


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        ({"pressures": {"finger0": [0.0] * 2}}, "pressures: finger0"),
        ({"pressures": {"finger9": [0.0] * 3}}, "allowed: finger0, finger1, finger2"),
        ({"world": {"q0": {"finger0": [np.nan] * 3}}}, "not finite"),
    ],
)
def test_bad_inputs_of_arms_are_refused_in_one_line(inputs, said):
    with pytest.raises(ModelError) as error:
        simulate_world(grip(**inputs.pop("world", {})), t_end=0.01, **inputs)
    assert said in str(error.value)


def test_a_failed_arm_is_named():
    world = grip()
    result = simulate_world(world, t_end=1.0, pressures={**close(world), "finger1": [-1e7, -1e7, -1e7]})
    assert not result.status.ok
    assert "arm finger1" in result.status


@pytest.mark.slow
def test_three_fingers_and_an_object_are_faster_than_real_time(figure):
    world = grip()
    grasp(world, t_end=0.01)
    begun = time.process_time()
    result = grasp(world, t_end=2.0)
    factor = result.t[-1] / (time.process_time() - begun)
    figure(f"three fingers of one link and a ball: {factor:.1f} times real time")
    assert factor > 5.0  # alone on its core 26; a machine that stands still may take its share
