"""Twins and bodies in one world: a tick of all of them is that of `simulate_world`."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core.bodies import (
    Attachment,
    BallShape,
    BodyWorld,
    BoxShape,
    Hinge,
    RigidBody,
    simulate_world,
)
from soro_core.bodies.body import HingeDrive
from soro_core.config import with_changes
from soro_core.errors import ConfigError, ModelError
from soro_core.robot import load_robot
from soro_core.twin import Twin, TwinConfig
from soro_core.twin.bodies import BodyTick, TwinBodies

CONFIG = TwinConfig(refine=1, bodies_file="scene.yaml", pressures="measured")
WALL = {
    "wall": RigidBody(
        shape=BoxShape(size=[0.02, 0.2, 0.2]), fixed=True, position=[0.03, 0.0, 0.05], friction=0.0
    ),
    "ball": RigidBody(shape=BallShape(radius=0.01), mass=0.02, position=[0.0, 0.5, 0.0]),
}
PRESSURE = np.array([0.0, 30e3, 30e3])
END_S, RAMP_S = 1.0, 0.2


@pytest.fixture(scope="module", params=[200, 100])
def leaning(request):
    """An arm that leans on a wall: the twin after one second, the bodies there, and what it has published."""
    twin = Twin(load_robot("tue_three_bellow"), with_changes(CONFIG, rate_hz=request.param))
    state = twin.initial()
    bodies = TwinBodies(WALL, {"arm": twin}, [state])
    for tick in range(1, round(END_S / twin.dt) + 1):
        part = min(tick * twin.dt / RAMP_S, 1.0)
        (state,) = bodies.move([state], [twin.step_pressures(state, part * PRESSURE)])
    return twin, state, bodies.now


def test_the_arm_is_where_the_library_has_it(leaning):
    twin, state, now = leaning
    assert state.status.ok
    assert state.tick * twin.dt == pytest.approx(END_S)
    start = twin.initial().arm.q
    world = BodyWorld(WALL, {"arm": twin.plant.arm}, {"arm": start})
    whole = simulate_world(world, t_end=END_S, pressures={"arm": lambda t: PRESSURE * min(t / RAMP_S, 1.0)})
    steps = round(twin.dt / 1e-3)
    np.testing.assert_allclose(state.arm.q, whole.q["arm"][-1], atol=1e-9)
    np.testing.assert_allclose(now.state.place[1], whole.place["ball"][-1], atol=1e-12)
    force = whole.contact_force("wall")[-steps:].mean(axis=0)
    assert force[0] > 0.02
    np.testing.assert_allclose(now.wrench("wall", np.zeros(3))[0], force, atol=1e-9)
    normal = now.pushes["arm", "wall"] if ("arm", "wall") in now.pushes else now.pushes["wall", "arm"]
    assert normal[2] == pytest.approx(whole.normal_force("wall")[-steps:].mean())


def driven_hand(**keys):
    """The twin of a muscle, and a hand that hangs on it."""
    hand = RigidBody(
        shape=BoxShape(size=[0.18, 0.08, 0.03]),
        mass=0.4,
        position=[0.09, 0.0, 0.0],
        attached=Attachment(),
        hinge=Hinge(
            point=[0.0, 0.0, 0.0],
            axis=[0.0, 1.0, 0.0],
            drive=HingeDrive(at_s=[0.1], angle_rad=[0.3], **keys),
        ),
    )
    return Twin(load_robot("wrist_muscle"), with_changes(CONFIG, robot="wrist_muscle")), hand


def test_an_arm_that_holds_a_body_begins_straight_and_tells_who_drives_it():
    """As its file places it: at rest a slender one has sunk, and would hold the body elsewhere."""
    twin, hand = driven_hand()
    at_rest = replace(twin.initial(), start_tick=0)
    assert np.abs(at_rest.arm.q).max() > 0.1
    bodies = TwinBodies({"hand": hand}, {"arm": twin}, [at_rest])
    (state,) = bodies.begins
    np.testing.assert_array_equal(state.arm.q, 0.0)
    joint = twin.plant.arm.pose(state.arm.q, twin.length)[:3, 3]
    efforts, apart = [], 0.0
    for _ in range(60):
        (state,) = bodies.move([state], [twin.step_pressures(state, np.array([40e3]))])
        efforts.append(bodies.now.efforts["hand"])
        tip = twin.plant.arm.pose(state.arm.q, twin.length)[:3, 3]
        lever = bodies.now.state.rotation[0].T @ (tip - bodies.now.state.place[0])
        apart = max(apart, float(np.linalg.norm(lever - (joint - hand.position))))
    assert apart < 5e-4  # the tip stays where it holds the hand
    assert efforts[:20] == [0.0] * 20
    assert 0.5 < efforts[20] < 8.0 * 0.3 + 0.5
    assert abs(efforts[-1]) < 0.1  # the muscle bears most of it


def test_the_twin_of_a_carried_arm_sees_all_from_the_tip_that_carries_it():
    hanging = load_robot("tue_three_bellow").replace(base_quaternion=[1.0, 0.0, 0.0, 0.0])
    seen = hanging.replace(base_quaternion=[0.0, 0.0, 0.0, 1.0], gravity=[0.0, 0.0, 9.81])
    twins = {"upper": Twin(hanging, CONFIG), "lower": Twin(seen, CONFIG)}
    wall = RigidBody(shape=BoxShape(size=[0.02, 0.2, 0.2]), fixed=True, position=[0.035, 0.0, -0.12])
    mounts = {"lower": "upper"}
    states = [twin.initial() for twin in twins.values()]
    bodies = TwinBodies({"wall": wall}, twins, states, mounts)
    pressures = {"upper": 0.0 * PRESSURE, "lower": np.array([0.0, 60e3, 60e3])}
    for _ in range(200):
        air = [
            twin.step_pressures(state, pressures[name])
            for (name, twin), state in zip(twins.items(), states, strict=True)
        ]
        states = bodies.move(states, air)
    upper, lower = (twin.observe(state)[1] for twin, state in zip(twins.values(), states, strict=True))
    ends = {name: state.arm.q for name, state in zip(twins, states, strict=True)}
    world = bodies.now.result.world
    np.testing.assert_allclose(upper.tip, world.frame_of("lower", ends), atol=1e-12)
    there = upper.tip @ lower.tip
    assert np.linalg.norm(upper.tip[:2, 3]) > 1e-3  # the wall has pushed the carrier, too
    force = bodies.now.wrench("lower", np.zeros(3))[0]
    assert force[0] < -1e-3
    np.testing.assert_allclose(upper.tip[:3, :3] @ lower.contact_n, force, atol=1e-12)
    assert there[0, 3] == pytest.approx(0.025 - 0.013, abs=1e-3)  # its skin lies on the wall


def test_the_carrier_of_an_arm_that_holds_a_body_begins_straight_too():
    level = load_robot("tue_three_bellow").replace(base_quaternion=[0.0, 0.70710678, 0.0, 0.70710678])
    seen = level.replace(base_quaternion=[0.0, 0.0, 0.0, 1.0], gravity=[-9.81, 0.0, 0.0])
    twins = {"upper": Twin(level, CONFIG), "lower": Twin(seen, CONFIG)}
    twins["other"] = Twin(level.replace(base_position=[0.0, 0.2, 0.0]), CONFIG)
    ball = RigidBody(
        shape=BallShape(radius=0.004),
        mass=0.005,
        position=[0.128, 0.0, 0.0],
        attached=Attachment(arm="lower"),
    )
    states = [twin.initial() for twin in twins.values()]
    begins = TwinBodies({"ball": ball}, twins, states, {"lower": "upper"}).begins
    assert [bool(np.any(state.arm.q)) for state in begins] == [False, False, True]


def test_a_drive_that_would_ring_is_refused():
    twin, hand = driven_hand(stiffness=1e3)
    with pytest.raises(ModelError, match="body hand: its drive is too stiff for ticks of 5 ms"):
        TwinBodies({"hand": hand}, {"arm": twin}, [twin.initial()])


def test_the_true_force_on_the_arm_is_that_of_the_bodies(leaning):
    twin, state, now = leaning
    _, seen = twin.observe(state)
    np.testing.assert_allclose(seen.contact_n, -now.wrench("wall", np.zeros(3))[0], atol=1e-12)
    tip = twin.plant.arm.pose(state.arm.q, twin.length)
    np.testing.assert_allclose(seen.tip, tip)


def test_a_torque_is_that_about_a_point(leaning):
    _, _, now = leaning
    force, about_origin = now.wrench("wall", np.zeros(3))
    _, about_point = now.wrench("wall", np.array([0.0, 0.0, 0.1]))
    np.testing.assert_allclose(about_point, about_origin - np.cross([0.0, 0.0, 0.1], force))
    assert np.abs(about_origin).max() > 1e-4


def test_an_arm_that_touches_itself_is_pushed_by_nothing(leaning):
    _, _, now = leaning
    tick = BodyTick(now.state, None, now.names)
    vars(tick)["pushes"] = {("arm", "arm"): (np.ones(3), np.ones(3), 1.0)}
    for part in tick.wrench("arm", np.zeros(3)):
        np.testing.assert_array_equal(part, 0.0)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"imu": {"enabled": True}}, "no imu"),
        ({"wall": {"stiffness": 100.0}}, "no wall"),
        ({"wrench": {"at_s": [1.0], "force_n": [0.1, 0.0, 0.0]}}, "no wrench"),
        ({"base_by_topic": True}, "no base_by_topic"),
        ({"base_shake": {"amplitude_m": [0.01, 0.0, 0.0]}}, "no base_shake"),
        ({"payload_changes": {"at_s": [1.0], "payload_kg": [0.1]}}, "no payload_changes"),
        ({"air": "states", "pressures": "regulators"}, "air: lag"),
    ],
)
def test_a_twin_has_nothing_that_bodies_do_not_know(keys, said):
    with pytest.raises(ConfigError, match=f"{said}.* beside bodies"):
        with_changes(CONFIG, **keys)
