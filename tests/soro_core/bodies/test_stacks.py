"""Bodies with flat faces on each other, many contacts, short steps, fast spin, and inputs that are none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soro_core import BaseState
from soro_core.bodies import (
    BodyWorld,
    BoxShape,
    CapsuleShape,
    CylinderShape,
    Hinge,
    RigidBody,
    simulate_world,
)
from soro_core.errors import ModelError
from tests.soro_core.bodies.scenes import fingers, ground, tilt

CUBE, ROUND = BoxShape(size=[0.04] * 3), CylinderShape(radius=0.02, length=0.04)
BAR = BoxShape(size=[0.2, 0.02, 0.02])


def body(shape=CUBE, z=0.02, x=0.0, y=0.0, **keys):
    return RigidBody(**{"shape": shape, "mass": 0.1, "position": [x, y, z], **keys})


def run(bodies, t_end=1.0, dt=1e-3, **inputs):
    return simulate_world(BodyWorld(bodies), t_end=t_end, dt=dt, **inputs)


@pytest.mark.parametrize(
    "upper",
    [
        body(z=0.06),
        body(z=0.06, x=0.01),
        body(z=0.06, x=0.005, y=0.003),
        body(ROUND, z=0.06),
        body(BAR, z=0.05),
        body(BAR, z=0.05, x=0.015),
        body(CapsuleShape(radius=0.01, length=0.2), z=0.05, quaternion=tilt(90)),
    ],
    ids=["flush", "flush on two sides", "across", "round", "bar", "bar beside its middle", "capsule"],
)
def test_a_body_stays_on_the_face_below_it(upper):
    result = run({"ground": ground(), "lower": body(), "upper": upper})
    assert result.status.ok, result.status
    assert np.abs(result.place["upper"] - upper.position).max() < 1e-4
    assert np.abs(result.twist["upper"][-1]).max() < 1e-5


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        (body(ROUND), body(z=0.06)),
        (body(ROUND), body(ROUND, z=0.06)),
        (body(ROUND), body(ROUND, z=0.06, x=0.008, y=0.006)),
        (body(ROUND), body(CylinderShape(radius=0.012, length=0.04), z=0.06, x=0.012, y=-0.004)),
        (body(ROUND), body(CylinderShape(radius=0.03, length=0.04), z=0.06, y=0.015)),
        (body(ROUND), body(BAR, z=0.05, y=0.004)),
        (
            body(BoxShape(size=[0.02, 0.02, 0.04]), fixed=True),
            body(ROUND, z=0.06, x=0.003, y=0.003, quaternion=[0.0, 0.0, 0.4, 0.9165151389911681]),
        ),
        (body(BoxShape(size=[0.02, 0.02, 0.04]), fixed=True), body(ROUND, z=0.06, x=0.007, y=0.001)),
    ],
    ids=["box", "flush", "beside", "smaller", "larger", "bar", "corner", "edge"],
)
@pytest.mark.parametrize("first", ["lower", "upper"])
def test_a_body_stays_on_a_disc(lower, upper, first):
    bodies = {"lower": lower, "upper": upper}
    result = run({"ground": ground(), first: bodies.pop(first), **bodies})
    assert result.status.ok, result.status
    assert np.abs(result.place["upper"] - upper.position).max() < 1e-4
    assert np.abs(result.twist["upper"][-1]).max() < 1e-5


def test_a_tower_of_equal_boxes_stands():
    tower = {f"box{k}": body(z=0.02 + 0.04 * k) for k in range(5)}
    result = run({"ground": ground(), **tower})
    assert result.status.ok, result.status
    np.testing.assert_allclose(result.contact_force("box0")[-1, 2], 0.981, atol=2e-3)
    assert abs(result.place["box4"][-1, 2] - 0.18) < 1e-4


def test_bars_that_cross_in_one_place_overlap():
    with pytest.raises(ModelError, match="overlap at the start by 20 mm"):
        run({"one": body(BAR), "other": body(BoxShape(size=[0.02, 0.2, 0.02]))})


def test_many_boxes_rest_side_by_side():
    boxes = {f"box{k}": body(x=0.05 * (k % 6), y=0.05 * (k // 6)) for k in range(36)}
    assert run({"ground": ground(), **boxes}, t_end=0.02).status.ok


def test_a_short_step_adds_no_energy_where_a_box_rests():
    result = run({"ground": ground(), "box": body()}, t_end=0.01, dt=1e-6)
    assert np.abs(result.twist["box"][:, 5]).max() < 2.6e-3  # g / (e omega)
    assert result.place["box"][:, 2].max() <= 0.02


@pytest.mark.parametrize("rate", [1e2, 1e3, 1e4])
def test_a_fast_spin_keeps_its_momentum(rate):
    plate = RigidBody(shape=BoxShape(size=[0.1, 0.05, 0.02]), mass=0.1, angular_velocity=[rate, 1.0, 3.0])
    result = run({"plate": plate}, t_end=0.02)
    assert result.status.ok, result.status
    spin = np.einsum("kji,kj->ki", result.rotation["plate"], result.twist["plate"][:, :3])
    momentum = np.einsum("kij,kj->ki", result.rotation["plate"], spin * plate.moments())
    assert np.abs(momentum - momentum[0]).max() < 1e-9 * np.abs(momentum[0]).max()


def test_a_spin_beyond_the_shortest_step_ends_the_run():
    plate = RigidBody(shape=BoxShape(size=[0.1, 0.05, 0.02]), mass=0.1, angular_velocity=[1e9, 1.0, 3.0])
    assert "body plate turns too fast; use a smaller dt" in str(run({"plate": plate}).status)


def test_the_axis_of_a_hinge_has_any_length():
    bar = body(BAR, x=0.1, z=0.0, hinge=Hinge(point=[0.0, 0.0, 0.0], axis=[0.0, 1e-200, 0.0]))
    assert run({"bar": bar}, t_end=0.1).angle["bar"][-1, 0] > 0.1


WRONG = {
    "no bodies by name": (lambda: BodyWorld([body()]), "bodies: got"),
    "no arms by name": (
        lambda: BodyWorld({"box": body()}, None),
        "arms: got None; allowed: a mapping by name",
    ),
    "no starts by name": (lambda: BodyWorld({"box": body()}, q0=3), "q0: got 3; allowed: a mapping by name"),
    "one name twice": (lambda: BodyWorld({"finger0": body()}, fingers(1)), "arms: finger0 is a body too"),
    "a half point": (lambda: BodyWorld({"box": body()}, points_per_link=2.5), "points_per_link = 2.5"),
    "no motion": (
        lambda: run({"box": body(fixed=True)}, motions={"box": 3}),
        "motions: box: got 3; allowed: a f",
    ),
    "no rotation": (
        lambda: run(
            {"box": body(fixed=True)}, motions={"box": lambda t: BaseState(rotation=2.0 * np.eye(3))}
        ),
        "allowed: a rotation",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_world_is_refused_in_one_line(name):
    make, expected = WRONG[name]
    with pytest.raises(ModelError) as caught:
        make()
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def pile(seed):
    """Boxes, cylinders and capsules of any size and friction that fall onto each other."""
    rng, bodies = np.random.default_rng(seed), {"ground": ground(friction=1.0)}
    for i in range(int(rng.integers(2, 6))):
        kind, size = rng.integers(4), rng.uniform(0.01, 0.03, 3).tolist()
        shape = {
            1: CylinderShape(radius=size[0], length=2.0 * size[1]),
            2: CapsuleShape(radius=size[0], length=2.0 * size[1]),
        }.get(int(kind), BoxShape(size=[2.0 * one for one in size]))
        bodies[f"body{i}"] = RigidBody(
            shape=shape,
            mass=float(rng.uniform(0.01, 0.1)),
            position=[*rng.uniform(-0.01, 0.01, 2).tolist(), 0.08 + 0.12 * i],
            quaternion=Rotation.random(random_state=int(rng.integers(1e6))).as_quat().tolist(),
            friction=float(rng.uniform(0.2, 1.2)),
        )
    return bodies


@pytest.mark.parametrize("seed", [0, 7, 10])  # some of their steps take all the sweeps
def test_friction_of_a_falling_pile_is_within_its_cone(seed):
    bodies = pile(seed)
    result = run(bodies, t_end=0.5)
    assert result.status.ok, result.status
    assert len(result.contacts.gap) > 100
    names, contacts = list(bodies), result.contacts
    friction = np.array([min(bodies[names[i]].friction for i in sides) for sides in contacts.side])
    along = (contacts.force * contacts.normal).sum(axis=1)
    across = np.linalg.norm(contacts.force - along[:, None] * contacts.normal, axis=1)
    assert along.min() >= 0.0
    assert (across <= (1.0 + 1e-9) * friction * along + 1e-9).all()
