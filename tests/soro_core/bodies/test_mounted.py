"""Arms at the tip of another arm: they and their carrier act on each other."""

import numpy as np
import pytest

from soro_core import BaseState, SoftArm, load_robot
from soro_core.bodies import (
    Attachment,
    BallShape,
    BodyWorld,
    GroundShape,
    RigidBody,
    WorldState,
    WorldStepper,
    simulate_world,
)
from soro_core.errors import ConfigError, ModelError
from soro_core.rotation import quaternion_from_matrix

UPSIDE_DOWN, UPRIGHT = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]


def link(**changes):
    """A hanging arm of one link, and the same seen from the tip of another."""
    hanging = load_robot("config/robots/tue_three_bellow.yaml").replace(
        base_quaternion=UPSIDE_DOWN, **changes
    )
    return hanging, hanging.replace(base_quaternion=UPRIGHT)


def frictionless(robot):
    parts = [one.model_copy(update={"damping": (0.0, 0.0, 0.0), "creep": ()}) for one in robot.links]
    return robot.replace(links=parts)


def tilted(deg):
    half = np.deg2rad(deg) / 2.0
    return [0.0, float(np.sin(half)), 0.0, float(np.cos(half))]


def above(t):
    return 40e3 * np.array([min(t / 0.1, 1.0), 0.3 * np.sin(20.0 * t) ** 2, 0.0])


def below(t):
    return 50e3 * np.array([0.0, min(t / 0.05, 1.0), np.sin(13.0 * t) ** 2])


def chain(bodies, **keys):
    """The same two links: as one arm, and the second at the tip of the first."""
    first, second = link()
    whole = first.replace(links=[*first.links, *second.links], name="whole", tip_mass=0.02)
    one = BodyWorld(bodies, {"whole": SoftArm(whole)}, **keys)
    arms = {"upper": SoftArm(first), "lower": SoftArm(second.replace(tip_mass=0.02))}
    two = BodyWorld(bodies, arms, mounts={"lower": "upper"}, **keys)
    both = simulate_world(one, t_end=0.5, pressures={"whole": lambda t: np.concatenate((above(t), below(t)))})
    return both, simulate_world(two, t_end=0.5, pressures={"upper": above, "lower": below})


def test_a_chain_of_two_arms_moves_as_one_arm_of_two_links():
    one, two = chain({})
    assert one.status.ok
    assert two.status.ok
    shape = np.hstack([two.q["upper"], two.q["lower"]])
    assert np.abs(one.q["whole"]).max() > 5.0  # it swings, by 20 degrees a link and more
    np.testing.assert_allclose(shape, one.q["whole"], atol=2e-8)
    np.testing.assert_allclose(np.hstack([two.qd["upper"], two.qd["lower"]]), one.qd["whole"], atol=2e-6)
    np.testing.assert_allclose(two.energy(), one.energy(), atol=1e-10)


def test_what_the_outer_arm_meets_pushes_the_inner_one_too():
    ball = RigidBody(shape=BallShape(radius=0.02), mass=0.05, position=[-0.042, 0.0, -0.14], friction=0.5)
    floor = RigidBody(shape=GroundShape(), fixed=True, position=[0.0, 0.0, -0.16])
    one, two = chain({"ball": ball, "floor": floor}, touch_arms=False)
    assert np.linalg.norm(one.contact_force("whole"), axis=1).max() > 0.3
    assert np.linalg.norm(one.place["ball"][-1] - one.place["ball"][0]) > 5e-3
    np.testing.assert_allclose(two.place["ball"], one.place["ball"], atol=1e-6)
    np.testing.assert_allclose(np.hstack([two.q["upper"], two.q["lower"]]), one.q["whole"], atol=1e-4)


def two_fingers(**changes):
    first, second = link(**changes)
    fingers = {
        "left": second.replace(base_position=[0.03, 0.0, 0.005], base_quaternion=tilted(45.0)),
        "right": second.replace(
            base_position=[-0.03, 0.01, 0.0], base_quaternion=tilted(-60.0), tip_mass=0.01
        ),
    }
    return {"upper": first, **fingers}, {"left": "upper", "right": "upper"}


@pytest.mark.parametrize(("dt", "part"), [(1e-3, 1e-3), (5e-4, 2.5e-4)])
def test_two_arms_on_one_keep_their_energy(dt, part):
    robots, mounts = two_fingers()
    arms = {name: SoftArm(frictionless(robot)) for name, robot in robots.items()}
    start = {"upper": [0.0, 3.0, 1.0], "left": [0.0, 0.0, 4.0]}
    world = BodyWorld({}, arms, start, mounts=mounts, touch_arms=False)
    found = simulate_world(world, t_end=0.5, dt=dt)
    energy = found.energy()
    moved = sum(sum(arms[name].energy(q[0], 0 * q[0])[2:]) for name, q in found.q.items())
    assert found.status.ok
    assert np.ptp(found.q["upper"][:, 1]) > 5.0
    assert np.ptp(energy) < part * moved


def test_the_weight_of_what_is_carried_bends_the_host():
    """At rest a carried arm that is stiff is a mass at the place of its centre: here against statics."""
    first, _ = link()
    damped = [one.model_copy(update={"damping": (0.1, 2e-5, 2e-5)}) for one in first.links]
    first = first.replace(links=damped)
    host = first.replace(base_quaternion=tilted(90.0))  # level
    stiff = [one.model_copy(update={"k_e": (1e6, 0.0, 0.0), "k_b": (1e3, 0.0, 0.0)}) for one in first.links]
    mass, length = first.links[0].mass, first.length
    carried = first.replace(links=stiff, base_quaternion=UPRIGHT)
    world = BodyWorld({}, {"host": SoftArm(host), "rod": SoftArm(carried)}, mounts={"rod": "host"})
    found = simulate_world(world, t_end=6.0, dt=2e-3)
    q, arm = found.q["host"][-1], world.arms["host"]
    assert np.abs(found.qd["host"][-1]).max() < 1e-3
    pose, jacobian = arm.pose_and_jacobian(q, arm.length)
    weight = pose[:3, :3].T @ [0.0, 0.0, -9.81 * mass]
    wrench = np.concatenate([np.cross([0.0, 0.0, 0.5 * length], weight), weight])
    asked = arm.gravity_force(q) + arm.elastic_force(q)
    np.testing.assert_allclose(jacobian.T @ wrench, asked, rtol=2e-3, atol=2e-6)
    assert abs(q[1:]).max() > 3.0  # and it bends


def test_a_stepper_goes_as_the_whole_run_does():
    robots, mounts = two_fingers()
    world = BodyWorld({}, {name: SoftArm(robot) for name, robot in robots.items()}, mounts=mounts)
    whole = simulate_world(world, t_end=0.02, pressures={name: [30e3, 0.0, 0.0] for name in robots})
    stepper = WorldStepper(world)
    state = stepper.initial_state()
    for _ in range(4):
        part = stepper.step(state, {name: np.tile([30e3, 0.0, 0.0], (2, 1)) for name in robots}, 0.005)
        state = WorldState.last_of(part)
    np.testing.assert_allclose(state.arms["left"].q, whole.q["left"][-1], atol=1e-9)


def test_a_host_that_is_shaken_takes_what_it_carries_along():
    robots, mounts = two_fingers()
    world = BodyWorld({}, {name: SoftArm(robot) for name, robot in robots.items()}, mounts=mounts)

    def shake(t):
        w = 20.0
        return BaseState(
            displacement=[0.01 * (1.0 - np.cos(w * t)), 0.0, 0.0],
            velocity=[0.01 * w * np.sin(w * t), 0.0, 0.0],
            acceleration=[0.01 * w * w * np.cos(w * t), 0.0, 0.0],
        )

    still, shaken = simulate_world(world), simulate_world(world, motions={"upper": shake})
    assert np.abs(shaken.q["left"] - still.q["left"]).max() > 0.3
    with pytest.raises(ModelError, match="motions: got 'left'; allowed: upper"):
        simulate_world(world, motions={"left": shake})


def test_a_body_on_a_carried_arm_is_where_that_arm_is():
    robots, mounts = two_fingers()
    arms = {name: SoftArm(robot) for name, robot in robots.items()}
    frame = BodyWorld({}, arms, mounts=mounts).frame_of("left", {})
    tip = (frame @ arms["left"].pose(np.zeros(3), arms["left"].length))[:3, 3]
    ball = RigidBody(
        shape=BallShape(radius=0.004), mass=0.005, position=tip.tolist(), attached=Attachment(arm="left")
    )
    found = simulate_world(BodyWorld({"ball": ball}, arms, mounts=mounts, touch_arms=False), t_end=0.3)
    world = found.world
    ends = {name: rows[-1] for name, rows in found.q.items()}
    there = world.frame_of("left", ends) @ arms["left"].pose(ends["left"], arms["left"].length)
    assert np.linalg.norm(there[:3, 3] - tip) > 1e-3
    np.testing.assert_allclose(found.place["ball"][-1], there[:3, 3], atol=1e-4)


@pytest.mark.parametrize(
    ("mounts", "text"),
    [
        (
            {"left": "nobody"},
            "arms.left.mounted_on: got 'nobody'; allowed: an arm that no other one carries, before it: upper",
        ),
        ({"upper": "left"}, "arms.upper.mounted_on: got 'left'; allowed: .*there is none"),
        ({"left": "upper", "right": "left"}, "arms.right.mounted_on: got 'left'; allowed: .*: upper"),
        ({"thumb": "upper"}, "mounts: got 'thumb'; allowed: upper, left, right"),
    ],
)
def test_who_cannot_carry_is_refused_in_one_line(mounts, text):
    robots, _ = two_fingers()
    arms = {name: SoftArm(robot) for name, robot in robots.items()}
    with pytest.raises(ConfigError, match=text) as error:
        BodyWorld({}, arms, mounts=mounts)
    assert "\n" not in str(error.value)


def test_what_a_carried_arm_cannot_have_is_refused():
    robots, mounts = two_fingers()
    arms = {name: SoftArm(robot) for name, robot in robots.items()}
    wall = load_robot("config/robots/three_bellow_at_a_wall.yaml")
    with pytest.raises(ModelError, match="arms: left: contacts or tip_constraint of an arm that another one"):
        BodyWorld({}, arms | {"left": SoftArm(wall)}, mounts=mounts)
    frame = BodyWorld({}, arms, mounts=mounts).frame_of("left", {})
    tip = (frame @ arms["left"].pose(np.zeros(3), arms["left"].length))[:3, 3]
    held = RigidBody(
        shape=BallShape(radius=0.004), mass=0.005, position=tip.tolist(), attached=Attachment(arm="left")
    )
    world = BodyWorld({"ball": held}, arms, mounts=mounts)
    with pytest.raises(ModelError, match="motions: upper is displaced at 0 s, which would tear a joint"):
        simulate_world(world, motions={"upper": lambda t: BaseState(displacement=[0.05, 0.0, 0.0])})


def test_the_base_of_one_arm_may_move_while_another_rests():
    first, _ = link()
    arms = {"one": SoftArm(first), "two": SoftArm(first.replace(base_position=[0.2, 0.0, 0.0]))}
    world = BodyWorld({}, arms, {"two": [0.0, 3.0, 0.0]})
    still = simulate_world(world, t_end=0.2)
    shaken = simulate_world(
        world, t_end=0.2, motions={"one": lambda t: BaseState(acceleration=[5.0, 0.0, 0.0])}
    )
    np.testing.assert_allclose(shaken.q["two"], still.q["two"], atol=1e-9)
    assert np.abs(shaken.q["one"] - still.q["one"]).max() > 0.5


def test_fingers_on_a_stiff_arm_press_each_other_as_those_on_a_wall_do():
    first, second = link()
    stiff = [one.model_copy(update={"k_e": (1e7, 0.0, 0.0), "k_b": (1e4, 0.0, 0.0)}) for one in first.links]
    host = SoftArm(first.replace(links=stiff))
    fingers = {
        "left": second.replace(base_position=[0.025, 0.0, 0.0], base_quaternion=tilted(-8.0)),
        "right": second.replace(base_position=[-0.025, 0.0, 0.0], base_quaternion=tilted(8.0)),
    }
    arms = {name: SoftArm(robot) for name, robot in fingers.items()}
    on_arm = BodyWorld({}, {"host": host} | arms, mounts=dict.fromkeys(arms, "host"))
    at_wall = {}
    for name, arm in arms.items():
        base = on_arm.frame_of(name, {}) @ arm.pose(np.zeros(3), 0.0)
        place = {"base_position": base[:3, 3].tolist()}
        place["base_quaternion"] = quaternion_from_matrix(base[:3, :3]).tolist()
        at_wall[name] = SoftArm(fingers[name].replace(**place))
    press = {"left": [60e3, 0.0, 0.0], "right": [0.0, 40e3, 40e3]}
    one, other = (
        simulate_world(world, t_end=0.6, pressures=press) for world in (BodyWorld({}, at_wall), on_arm)
    )
    assert one.normal_force("left")[-1] > 0.02
    for name in arms:
        np.testing.assert_allclose(other.q[name][-1], one.q[name][-1], atol=2e-2)
    np.testing.assert_allclose(other.normal_force("left")[-1], one.normal_force("left")[-1], rtol=1e-2)
