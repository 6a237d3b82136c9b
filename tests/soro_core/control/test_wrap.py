"""The law `wrap`: what it asks for, and what that holds in a world of bodies."""

import numpy as np
import pytest

from soro_core import load_robot
from soro_core.bodies import (
    BodyMotion,
    BodyWorld,
    BoxShape,
    CylinderShape,
    GroundShape,
    RigidBody,
    simulate_world,
)
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.laws import ArmBelief, Preview
from soro_core.control.reference.trajectory import Point
from soro_core.errors import ConfigError

ROBOT = load_robot("trunk")
LAID = np.tile([0.033, -22.2, 0.0], 6)
# The cylinder has this radius, and lies on blocks until they sink.
RADIUS, SINK_S = 0.035, (6.0, 7.0)


def law_of(**options):
    keys = {
        "law": "wrap",
        "law_options": options,
        "reference": {"kind": "set_point", "set_point": LAID.tolist()},
    }
    return Controller(ROBOT, parse(keys, ControllerConfig, "test")).law


def asked(law, times_s):
    """Desired force at each of these times [s], by steps of 0.05 s."""
    arm, dt = law.setting.arm, 0.05
    still = np.zeros(arm.n_q)
    belief = ArmBelief(still, still, None, True, np.zeros(arm.n_internal), np.zeros(18), np.zeros(18, bool))
    state, forces, k = law.initial_state(), [], 0
    here = Point(LAID, still, still)
    for time_s in times_s:
        while k * dt <= time_s:
            state, force, _ = law.step(state, belief, Preview(here, here, 0.0), dt)
            k += 1
        forces.append(force)
    return forces


def at_rest(law, q):
    return law.setting.arm.gravity_force(q) + law.setting.arm.elastic_force(q)


def test_links_bend_to_the_object_and_then_press():
    law = law_of(bend_s=2.0, press_part=0.5)
    half, laid, last = asked(law, [1.0, 2.0, 30.0])
    np.testing.assert_allclose(half, at_rest(law, 0.5 * LAID), rtol=1e-12)
    np.testing.assert_allclose(laid, at_rest(law, LAID), rtol=1e-12)
    pressed = LAID * np.tile([1.0, 1.5, 1.5], 6)
    np.testing.assert_allclose(last, at_rest(law, pressed), rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("press_part", "is_held"), [(1.0, True), (0.0, False)])
def test_what_it_presses_holds_a_cylinder(press_part, is_held):
    """Laid around without pressing, the arm lets it fall."""
    law = law_of(press_part=press_part)
    arm = law.setting.arm
    at = [-RADIUS - 0.012, 0.0, 0.3]
    sinks = BodyMotion(at_s=SINK_S, displacement_m=(0.0, 0.0, 0.0, 0.0, 0.0, -0.1))
    bodies = {
        "cylinder": RigidBody(
            shape=CylinderShape(radius=RADIUS, length=0.1),
            mass=0.03,
            friction=0.5,
            position=at,
            quaternion=(np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)),
        ),
        "floor": RigidBody(shape=GroundShape(), fixed=True, position=(0.0, 0.0, -0.15)),
    } | {
        f"block {side}": RigidBody(
            shape=BoxShape(size=(0.03, 0.015, 0.02)),
            fixed=True,
            position=(at[0], 0.04 * side, at[2] - RADIUS - 0.01),
            motion=sinks,
        )
        for side in (-1, 1)
    }
    times = np.arange(0.0, 9.0, 0.05)
    H = arm.actuation_matrix(LAID)
    rows = np.clip([np.linalg.lstsq(H, force, rcond=None)[0] for force in asked(law, times)], 0.0, 90e3)
    result = simulate_world(
        BodyWorld(bodies, {"arm": arm}),
        t_end=times[-1],
        dt=1e-3,
        pressures={"arm": lambda t: np.array([np.interp(t, times, row) for row in rows.T])},
    )
    assert result.status.ok, result.status
    height = result.place["cylinder"][:, 2]
    assert bool(height[-1] > at[2] - 0.02) == is_held
    if is_held:
        assert np.ptp(height[-500:]) < 1e-6


@pytest.mark.parametrize(
    "options", [{"bend_s": 0.0}, {"press_part": -1.0}, {"bend_s": "fast"}, {"radius": 1.0}]
)
def test_wrong_options_are_refused_in_one_line(options):
    with pytest.raises(ConfigError, match=next(iter(options))) as error:
        law_of(**options)
    assert "\n" not in str(error.value)
