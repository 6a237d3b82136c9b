"""Rigid bodies alone: closed forms, balances, and what is refused."""

import numpy as np
import pytest

from soro_core import BaseState
from soro_core.bodies import (
    BallShape,
    BodyWorld,
    BoxShape,
    CapsuleShape,
    CylinderShape,
    Hinge,
    RigidBody,
    simulate_world,
)
from soro_core.errors import ConfigError, ModelError
from tests.soro_core.bodies.scenes import WEIGHT, ground, tilt


def run(bodies, t_end=1.0, dt=1e-3, world=None, **inputs):
    result = simulate_world(BodyWorld(bodies, **(world or {})), t_end=t_end, dt=dt, **inputs)
    assert result.status.ok, result.status
    return result


def ball(**keys):
    return RigidBody(**{"shape": BallShape(radius=0.02), "mass": 0.03, **keys})


def test_a_ball_that_is_thrown_follows_the_parabola():
    result = run({"ball": ball(velocity=[1.0, 0.0, 2.0])}, dt=0.01)
    fallen = 2.0 * result.t - 0.5 * WEIGHT * result.t**2
    np.testing.assert_allclose(result.place["ball"][:, 2], fallen, atol=1e-12)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.8, 1.0])
def test_a_ball_bounces_off_with_its_restitution(restitution):
    start = ball(position=[0.0, 0.0, 0.5], restitution=restitution)
    result = run({"ground": ground(), "ball": start}, t_end=0.5, dt=5e-4)
    before, after = result.twist["ball"][:, 5].min(), result.twist["ball"][:, 5].max()
    assert before == pytest.approx(-np.sqrt(2.0 * WEIGHT * 0.48), rel=2e-3)
    assert after == pytest.approx(-restitution * before, abs=0.01)
    assert result.energy()[-1] <= result.energy()[0] + 1e-12


def test_a_ball_slides_and_then_rolls():
    """Friction brakes it by mu g, until it rolls with 5/7 of its speed, after 2 v / (7 mu g)."""
    start = ball(position=[0.0, 0.0, 0.02], velocity=[1.0, 0.0, 0.0], friction=0.3)
    result = run({"ground": ground(friction=1.0), "ball": start}, t_end=0.3)
    speed = result.twist["ball"][:, 3]
    rolls = 2.0 / (7.0 * 0.3 * WEIGHT)
    slides = result.t < rolls - 1e-3
    np.testing.assert_allclose(speed[slides], 1.0 - 0.3 * WEIGHT * result.t[slides], atol=2e-3)
    np.testing.assert_allclose(speed[result.t > rolls + 2e-3], 5.0 / 7.0, rtol=1e-4)
    np.testing.assert_allclose(result.twist["ball"][-1, 1], 5.0 / 7.0 / 0.02, rtol=1e-4)


def on_slope(deg, friction=0.3, shape=None):
    shape = shape or BoxShape(size=[0.04, 0.03, 0.02])
    out = np.array([np.sin(np.deg2rad(deg)), 0.0, np.cos(np.deg2rad(deg))])
    body = RigidBody(
        shape=shape, mass=0.05, position=list(0.01 * out), quaternion=tilt(deg), friction=friction
    )
    return run({"slope": ground(deg, friction=1.0), "body": body})


@pytest.mark.parametrize(
    "shape", [BoxShape(size=[0.04, 0.03, 0.02]), CylinderShape(radius=0.02, length=0.02)]
)
def test_a_body_slips_on_a_slope_at_the_angle_of_friction(shape):
    angle = np.rad2deg(np.arctan(0.3))
    held, slips = on_slope(angle - 0.2, shape=shape), on_slope(angle + 0.2, shape=shape)
    assert np.linalg.norm(held.twist["body"][-1, 3:]) < 1e-8
    expected = WEIGHT * (np.sin(np.deg2rad(angle + 0.2)) - 0.3 * np.cos(np.deg2rad(angle + 0.2)))
    assert np.linalg.norm(slips.twist["body"][-1, 3:]) == pytest.approx(expected, rel=0.02)


def test_what_is_held_at_half_the_limit_does_not_creep():
    deg = np.rad2deg(np.arctan(0.15))
    result = on_slope(deg)
    place = result.place["body"]
    assert np.linalg.norm(place[-1] - place[500]) / 0.5 < 1e-7  # asked: 1e-6 m/s
    force = result.contact_force("body")[-1]
    np.testing.assert_allclose(force, [0.0, 0.0, 0.05 * WEIGHT], atol=1e-8)
    assert result.normal_force("body")[-1] == pytest.approx(0.05 * WEIGHT * np.cos(np.deg2rad(deg)))


def test_sliding_friction_is_on_the_cone_and_against_the_motion():
    body = RigidBody(
        shape=BoxShape(size=[0.04, 0.04, 0.01]),
        mass=0.1,
        position=[0.0, 0.0, 0.005],
        velocity=[0.6, 0.8, 0.0],
    )
    result = run({"ground": ground(friction=0.4), "box": body}, t_end=0.1)
    force = result.contact_force("box")[10:]
    across = force[:, :2] / (0.4 * force[:, 2:])
    np.testing.assert_allclose(across, np.tile([-0.6, -0.8], (len(across), 1)), atol=0.02)


def pendulum(dt, start=0.2, **keys):
    """A rod that hangs from a hinge at its end and swings from an angle."""
    place = [0.1 * float(np.sin(start)), 0.0, -0.1 * float(np.cos(start))]
    rod = RigidBody(
        shape=BoxShape(size=[0.01, 0.01, 0.2]),
        mass=0.05,
        position=place,
        quaternion=tilt(-np.rad2deg(start)),
        hinge=Hinge(point=[0.0, 0.0, 0.0], axis=[0.0, 1.0, 0.0], **keys),
    )
    return run({"rod": rod}, t_end=2.0, dt=dt)


def test_a_pendulum_has_its_period_and_keeps_its_energy():
    result = pendulum(1e-3)
    about = 0.05 * (0.01**2 + 0.2**2) / 12.0 + 0.05 * 0.1**2
    period = 2.0 * np.pi * np.sqrt(about / (0.05 * WEIGHT * 0.1)) * (1.0 + 0.2**2 / 16.0)
    rate = result.angle["rod"][:, 1]
    crossings = result.t[1:][(rate[:-1] < 0.0) != (rate[1:] < 0.0)]
    assert 2.0 * np.diff(crossings).mean() == pytest.approx(period, rel=2e-3)
    assert np.ptp(result.energy()) < 1e-5 * 0.05 * WEIGHT * 0.1


def test_a_hinge_stops_at_its_limit_and_rests_on_its_spring():
    low = pendulum(1e-3, limits_rad=(-0.1, 1.0), damping=1e-3)
    angle = low.angle["rod"][:, 0]  # it falls in the direction of positive angles about y
    assert angle.max() <= 1.0
    assert angle.min() >= -0.1 - 1e-6
    sprung = pendulum(1e-3, start=0.0, stiffness=0.2, damping=2e-3)
    np.testing.assert_allclose(sprung.angle["rod"], 0.0, atol=1e-12)


def test_a_closed_system_keeps_its_momentum_and_gains_no_energy():
    bodies = {
        "a": ball(position=[-0.1, 0.0, 0.0], velocity=[1.0, 0.1, 0.0], angular_velocity=[0.0, 30.0, 0.0]),
        "b": RigidBody(
            shape=BoxShape(size=[0.04, 0.06, 0.05]),
            mass=0.08,
            position=[0.0, 0.01, 0.005],
            quaternion=tilt(20.0),
            angular_velocity=[3.0, 1.0, -2.0],
            restitution=0.5,
        ),
        "c": RigidBody(shape=CapsuleShape(radius=0.01, length=0.05), mass=0.02, position=[0.08, 0.0, 0.0]),
        "d": RigidBody(shape=CylinderShape(radius=0.02, length=0.04), mass=0.05, position=[0.15, 0.0, 0.01]),
    }
    result = run(bodies, t_end=0.4, world={"gravity": [0.0, 0.0, 0.0]})
    assert len(result.contacts.gap) > 2
    total, spin = 0.0, 0.0
    for name, body in bodies.items():
        momentum = body.mass * result.twist[name][:, 3:]
        own = np.einsum(
            "kij,j,klj,kl->ki", R := result.rotation[name], body.moments(), R, result.twist[name][:, :3]
        )
        total, spin = total + momentum, spin + own + np.cross(result.place[name], momentum)
    np.testing.assert_allclose(total - total[0], 0.0, atol=1e-9 * np.abs(total[0]).max())
    np.testing.assert_allclose(spin - spin[0], 0.0, atol=1e-9 * np.abs(spin[0]).max())
    energy = result.energy()
    # The springs of contacts return what they store, f^2 / (2 k).
    rises = np.diff(energy)
    assert rises[rises > 0.0].sum() < 1e-4 * energy[0]
    assert energy[-1] < 0.9 * energy[0]


@pytest.mark.parametrize(
    "shape",
    [
        BoxShape(size=[0.03, 0.04, 0.02]),
        CylinderShape(radius=0.02, length=0.02),
        CapsuleShape(radius=0.01, length=0.04),
    ],
)
@pytest.mark.parametrize("under", ["ground", "box"])
def test_bodies_come_to_rest_on_a_plate_and_carry_their_weight(shape, under):
    lies = {"quaternion": [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]} if isinstance(shape, CapsuleShape) else {}
    plate = RigidBody(shape=BoxShape(size=[0.2, 0.2, 0.02]), fixed=True, position=[0.0, 0.0, -0.01])
    plates = {"ground": ground(), "box": plate}
    result = run(
        {"plate": plates[under], "body": RigidBody(shape=shape, mass=0.05, position=[0, 0, 0.0101], **lies)}
    )
    assert np.abs(result.twist["body"][-1]).max() < 1e-8
    np.testing.assert_allclose(result.contact_force("body")[-1], [0.0, 0.0, 0.05 * WEIGHT], atol=1e-7)
    assert result.place["body"][-1, 2] == pytest.approx(0.01, abs=2e-5)


def test_crossed_edges_of_boxes_touch():
    """No corner lies in the other box: two bars on their edges, crosswise; the upper one then tips over."""
    eighth = float(np.sin(np.pi / 8))
    low = RigidBody(
        shape=BoxShape(size=[0.2, 0.02, 0.02]),
        fixed=True,
        quaternion=[eighth, 0.0, 0.0, float(np.cos(np.pi / 8))],
    )
    high = RigidBody(
        shape=BoxShape(size=[0.02, 0.2, 0.02]),
        mass=0.1,
        position=[0.0, 0.0, 0.02 * np.sqrt(2.0) + 1e-5],
        quaternion=tilt(45.0),
    )
    result = run({"low": low, "high": high}, t_end=0.1)
    assert result.place["high"][:, 2].min() > 0.02 * np.sqrt(2.0) - 2e-4
    assert result.contact_force("high")[5:, 2].mean() == pytest.approx(0.1 * WEIGHT, rel=0.1)


def test_a_moved_plate_carries_what_lies_on_it():
    plate = RigidBody(shape=BoxShape(size=[0.2, 0.2, 0.02]), fixed=True, position=[0.0, 0.0, -0.01])
    body = RigidBody(shape=BoxShape(size=[0.02] * 3), mass=0.05, position=[0.0, 0.0, 0.01])
    motion = {"plate": lambda t: BaseState(displacement=[t * t, 0.0, 0.0])}
    result = run({"plate": plate, "body": body}, t_end=0.3, motions=motion)
    np.testing.assert_allclose(result.place["body"][-1, 0], 0.09, atol=1e-3)
    assert result.contact_force("body")[-1, 0] == pytest.approx(0.05 * 2.0, rel=1e-3)


def test_the_same_run_gives_the_same_bits():
    start = {
        "ground": ground(),
        "box": RigidBody(
            shape=BoxShape(size=[0.02] * 3), mass=0.05, position=[0, 0, 0.05], quaternion=tilt(30)
        ),
    }
    one, other = run(start, t_end=0.3), run(start, t_end=0.3)
    assert np.array_equal(one.place["box"], other.place["box"])


def test_a_long_run_stores_all_contacts():
    box = RigidBody(shape=BoxShape(size=[0.02] * 3), mass=0.05, position=[0.0, 0.0, 0.01])
    result = run({"ground": ground(), "box": box}, t_end=2.0)
    assert result.contacts.behind[-1] == len(result.contacts.gap) == 4 * 2000
    np.testing.assert_allclose(result.contact_force("box")[50:, 2], 0.05 * WEIGHT, atol=1e-7)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"mass": None}, "a mass above 0"),
        ({"mass": 0.0}, "mass"),
        ({"shape": BallShape(radius=0.02), "mass": float("nan")}, "mass"),
        ({"inertia": [1.0, 1.0, 3.0]}, "none above the sum"),
        ({"fixed": True, "hinge": Hinge(point=[0, 0, 0], axis=[0, 0, 1])}, "not both"),
        ({"fixed": True, "velocity": [1.0, 0.0, 0.0]}, "free bodies alone"),
        ({"friction": -0.1}, "friction"),
    ],
)
def test_a_bad_body_is_refused_in_one_line(keys, said):
    with pytest.raises(ConfigError) as error:
        ball(**keys)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("radius", [0.0, -1.0, 1e-5, 500.0])
def test_an_absurd_size_is_refused(radius):
    with pytest.raises(ConfigError, match="radius"):
        BallShape(radius=radius)
    with pytest.raises(ConfigError, match="size"):
        BoxShape(size=[0.1, 0.1, radius])


def test_bodies_that_overlap_at_the_start_are_named_with_their_depth():
    bodies = {"one": ball(), "two": ball(position=[0.035, 0.0, 0.0])}
    with pytest.raises(ModelError, match="body one and body two overlap at the start by 5 mm"):
        run(bodies)


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        ({"wrenches": {"bal": np.zeros(6)}}, "'bal'; allowed: ball"),
        ({"motions": {"ball": lambda t: BaseState()}}, "allowed: ground"),
        ({"pressures": {"arm": [0.0]}}, "allowed: none"),
        ({"wrenches": {"ball": [np.nan] * 6}}, "not finite"),
        ({"wrenches": {"ball": [0.0] * 3}}, "shape"),
        ({"motions": {"ground": lambda t: 3}}, "BaseState"),
        ({"dt": 0.0}, "dt = 0"),
    ],
)
def test_bad_inputs_are_refused_in_one_line(inputs, said):
    with pytest.raises(ModelError) as error:
        run({"ground": ground(), "ball": ball(position=[0.0, 0.0, 0.02])}, **inputs)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_body_that_leaves_the_world_ends_the_run():
    result = simulate_world(BodyWorld({"ball": ball(velocity=[30.0, 0.0, 0.0])}), t_end=1.0)
    assert not result.status.ok
    assert "body ball has left the world, beyond its reach of 10 m" in result.status
    assert result.t[-1] == pytest.approx(10.0 / 30.0, abs=2e-3)


def test_bodies_that_pass_into_each_other_end_the_run():
    soft = {"stiffness": 2.0}
    result = simulate_world(
        BodyWorld({"ground": ground(), "ball": ball(position=[0.0, 0.0, 0.02])}, **soft), t_end=2.0
    )
    assert not result.status.ok
    assert "body ground and body ball have sunk" in result.status
