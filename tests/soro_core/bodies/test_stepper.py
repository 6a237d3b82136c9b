"""A world in pieces of time, and bodies that go where they say."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core.bodies import (
    BallShape,
    BodyMotion,
    BodyWorld,
    Hinge,
    RigidBody,
    WorldState,
    WorldStepper,
    simulate_world,
)
from soro_core.errors import ConfigError, ModelError
from tests.soro_core.bodies.scenes import WEIGHT, close, grip, ground

SINKS = BodyMotion(at_s=[1.0, 3.0], displacement_m=[[0.0, 0.0, 0.0], [0.0, 0.0, -0.04]])


def grip_over_a_table_that_sinks():
    world = grip()
    table = RigidBody(**{**world.bodies["table"].model_dump(), "motion": SINKS})
    return replace(world, bodies={**world.bodies, "table": table})


def in_pieces(world, t_end, dt, pressures):
    stepper = WorldStepper(world)
    state = stepper.initial_state()
    for k in range(round(t_end / dt)):
        t = k * dt
        ways = {name: np.stack((of(t), of(t + dt))) for name, of in pressures.items()}
        result = stepper.step(state, ways, dt, t)
        assert result.status.ok, result.status
        state = WorldState.last_of(result)
    return state


def test_pieces_of_time_are_the_whole():
    """Three fingers hold the object, and the table has left it; contacts go on from piece to piece."""
    world = grip_over_a_table_that_sinks()
    whole = simulate_world(world, t_end=2.5, pressures=close(world))
    last = in_pieces(world, 2.5, 0.005, close(world))
    assert whole.place["object"][-1, 2] > -0.065
    assert whole.place["table"][-1, 2] < -0.11
    for b, name in enumerate(world.bodies):
        np.testing.assert_allclose(last.place[b], whole.place[name][-1], atol=1e-12)
        np.testing.assert_allclose(last.twist[b], whole.twist[name][-1], atol=1e-9)
    for name, state in last.arms.items():
        np.testing.assert_allclose(state.q, whole.q[name][-1], atol=1e-10)
        np.testing.assert_allclose(state.internal, whole.internal[name][-1], atol=1e-10)


def test_a_hinged_body_swings_on_from_piece_to_piece():
    hinge = Hinge(point=[0.0, 0.0, 0.5], axis=[0.0, 1.0, 0.0])
    ball = RigidBody(shape=BallShape(radius=0.02), mass=0.1, position=[0.3, 0.0, 0.5], hinge=hinge)
    world = BodyWorld({"ball": ball})
    whole = simulate_world(world, t_end=0.4)
    last = in_pieces(world, 0.4, 0.004, {})
    assert abs(whole.angle["ball"][-1, 0]) > 0.5
    np.testing.assert_allclose(last.angle[0], whole.angle["ball"][-1], atol=1e-10)


def test_a_motion_rests_at_each_place():
    there = BodyMotion(
        at_s=[0.5, 1.5, 2.0], displacement_m=[[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.2, 0.0]]
    )
    for t, x in (
        (-1.0, [0, 0, 0]),
        (0.5, [0, 0, 0]),
        (1.0, [0.05, 0, 0]),
        (1.5, [0.1, 0, 0]),
        (9.0, [0.1, 0.2, 0]),
    ):
        np.testing.assert_allclose(there(t).displacement, x, atol=1e-15)
    for t in (0.5, 1.5, 2.0):
        np.testing.assert_allclose(there(t).velocity, 0.0, atol=1e-15)
    h = 1e-6
    for t in (0.7, 1.2, 1.8):
        slope = (np.array(there(t + h).displacement) - there(t - h).displacement) / (2 * h)
        np.testing.assert_allclose(there(t).velocity, slope, atol=1e-9)
        bend = (np.array(there(t + h).velocity) - there(t - h).velocity) / (2 * h)
        np.testing.assert_allclose(there(t).acceleration, bend, atol=1e-8)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"motion": {"at_s": [1.0], "displacement_m": [[0.0, 0.0, 0.0]]}, "mass": 1.0}, "beside fixed: true"),
        ({"motion": {"at_s": [1.0], "displacement_m": []}, "fixed": True}, "not 1 times and 0 rows"),
        ({"motion": {"at_s": [1.0, 0.5], "displacement_m": [0.0] * 6}, "fixed": True}, "that increase"),
    ],
)
def test_bad_motions_are_refused_in_one_line(keys, said):
    with pytest.raises(ConfigError, match=said) as error:
        RigidBody(shape={"kind": "ball", "radius": 0.1}, **keys)
    assert "\n" not in str(error.value)


def test_bodies_that_overlap_are_refused_before_the_first_step():
    ball = RigidBody(shape=BallShape(radius=0.02), mass=0.1, position=[0.0, 0.0, 0.015])
    with pytest.raises(ModelError, match=r"body \w+ and body \w+ overlap at the start by 5 mm"):
        WorldStepper(BodyWorld({"ground": ground(), "ball": ball}))


def test_a_body_that_leaves_ends_the_step_with_the_cause():
    ball = RigidBody(shape=BallShape(radius=0.02), mass=0.1)
    stepper = WorldStepper(BodyWorld({"ball": ball}, reach=0.5), 0.01)
    result = stepper.step(stepper.initial_state(), {}, 1.0)
    assert "body ball has left the world, beyond its reach of 0.5 m" in result.status
    assert result.t[-1] == pytest.approx(np.sqrt(2 * 0.5 / WEIGHT), abs=0.01)
