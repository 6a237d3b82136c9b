"""An arm that bears the weight of a hand."""

import math

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.bodies import Attachment, BodyWorld, BoxShape, Hinge, RigidBody, simulate_world
from soro_core.bodies.counterbalance import (
    Counterbalance,
    CounterbalanceSettings,
    CounterbalanceState,
    LimbMoments,
    limb_moments,
)
from soro_core.errors import ConfigError, ModelError
from soro_core.model.discretised import discretised
from soro_core.robot import Discretisation

WRIST = Hinge(point=(0.0, 0.0, 0.0), axis=(0.0, 1.0, 0.0), stiffness=1.0, damping=0.05)
MUSCLE = SoftArm(load_robot("wrist_muscle"))
# A moment that does not depend on the angle, 10 mN m a kPa.
PLAIN = LimbMoments(np.array([-1.0, 1.0]), np.zeros(2), np.full(2, -1e-5))


def test_the_moment_holds_a_hand_where_the_world_rests():
    """The world of arm and hand, whose joint and hinge know nothing of the table, comes to rest there."""
    angles = np.linspace(-0.6, 0.6, 25)
    moments = limb_moments(MUSCLE, WRIST, angles)
    hand = RigidBody(
        shape=BoxShape(size=(0.18, 0.08, 0.03)),
        mass=0.4,
        position=(0.09, 0.0, 0.0),
        hinge=WRIST,
        attached=Attachment(),
    )
    for pressure in (20e3, 60e3):
        run = simulate_world(
            BodyWorld({"hand": hand}, {"muscle": MUSCLE}),
            t_end=4.0,
            dt=2e-3,
            pressures={"muscle": [pressure]},
        )
        assert run.status.ok, run.status
        angle = run.angle["hand"][-1, 0]
        assert abs(run.angle["hand"][-1, 1]) < 1e-3
        assert abs(angle) < 0.6
        without, per_pa = moments.at(angle)
        weight, spring = 9.81 * 0.4 * 0.09 * math.cos(angle), -WRIST.stiffness * angle
        assert abs(spring) > 0.03
        assert without + per_pa * pressure == pytest.approx(-weight - spring, rel=0.01)


def test_the_weight_is_learned_while_the_limb_is_relaxed_and_frozen_then():
    law, state, dt = Counterbalance(PLAIN, (0.0, 3e5)), CounterbalanceState(), 0.01
    for _ in range(299):  # to 2.99 s
        state, _ = law.step(state, 0.0, 0.0, 40e3, dt)
    assert state.weight == pytest.approx(-0.4)
    state, setpoint = law.step(state, 0.0, 0.0, 90e3, 2.0 * dt)
    assert setpoint == pytest.approx(40e3)
    # Whatever the wearer does: the moment of the weight at that angle alone.
    later, setpoint = law.step(state, 0.5, 3.0, 10e3, dt)
    assert setpoint == pytest.approx(40e3 * math.cos(0.5))
    assert later.weight == state.weight


def test_set_points_stay_in_their_range():
    law = Counterbalance(PLAIN, (15e3, 30e3))
    held = CounterbalanceState(t_s=1.6)
    for angle, expected in ((1.0, 30e3), (-1.2, 15e3)):
        _, setpoint = law.step(held, angle, 0.0, 0.0, 0.01)
        assert setpoint == expected


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_hold_brings_a_limb_level_whichever_way_pressure_turns_it(side):
    """A limb of 4 g m2 and 0.35 N m, which the moment of the arm turns."""
    law = Counterbalance(LimbMoments(PLAIN.angle_rad, np.zeros(2), side * np.full(2, 1e-5)), (0.0, 3e5), 0.1)
    state, angle, rate, pressure, dt = CounterbalanceState(), 0.4, 0.0, 0.0, 2e-3
    for _ in range(round(3.5 / dt)):
        state, pressure = law.step(state, angle, rate, pressure, dt)
        moment = side * 1e-5 * pressure - side * 0.35 * math.cos(angle - 0.1)
        rate += dt * moment / 4e-3
        angle += dt * rate
    assert state.weight == pytest.approx(side * 0.35, rel=5e-3)
    assert angle == pytest.approx(0.1, abs=0.02)


def test_a_limb_that_hangs_on_a_stop_is_lifted_and_not_thrown():
    """The muscle turns it less the lower it hangs; its pressure rises by 200 kPa a second at most."""
    law = Counterbalance(limb_moments(MUSCLE, WRIST, np.linspace(-0.8, 0.7, 31)), (0.0, 3e5))
    stop, inertia, dt = 0.6, 4.3e-3, 2.5e-3
    state, angle, rate, pressure, ways = CounterbalanceState(), 0.0, 0.0, 0.0, []
    for _ in range(round(3.2 / dt)):
        state, setpoint = law.step(state, angle, rate, pressure, dt)
        pressure += min(max(setpoint - pressure, -200e3 * dt), 200e3 * dt)
        without, per_pa = law.moments.at(angle)
        rate += dt * (without + per_pa * pressure + 0.35 * math.cos(angle)) / inertia
        angle = min(angle + dt * rate, stop)
        rate = 0.0 if angle == stop else rate
        ways.append(angle)
    assert ways[100] > stop - 1e-3  # it has fallen, and hangs
    assert min(ways[200:]) > -0.05
    assert state.weight == pytest.approx(-0.35, rel=0.01)


def test_the_hold_does_not_wind_up_at_a_bound():
    law, state = Counterbalance(PLAIN, (0.0, 40e3)), CounterbalanceState(t_s=1.6)
    for _ in range(30):
        state, setpoint = law.step(state, 0.3, 0.0, 40e3, 0.01)
    assert setpoint == 40e3
    assert state.integral == 0.0
    _, setpoint = law.step(state, -0.1, 0.0, 40e3, 0.01)
    assert setpoint < 40e3


@pytest.mark.parametrize(
    ("law", "angles", "match"),
    [
        (Counterbalance(PLAIN, (0.0, 30e3)), [0.0], "at 30 kPa, its bound"),
        (Counterbalance(PLAIN, (0.0, 3e5)), [-0.05, 0.05], "moved by 0.1 rad"),
        (Counterbalance(PLAIN, (0.0, 1e6)), [0.5], "0.5 rad off level"),
    ],
)
def test_a_weight_that_the_arm_did_not_hold_is_refused(law, angles, match):
    state = CounterbalanceState()
    for k in range(299):
        state, _ = law.step(state, angles[k % len(angles)], 0.0, 40e3, 0.01)
    for _ in range(2):  # again and again, because the state is that of before
        with pytest.raises(ModelError, match=match):
            law.step(state, 0.0, 0.0, 40e3, 0.02)


def test_nothing_measured_is_no_weight():
    law = Counterbalance(PLAIN, (0.0, 3e5))
    state, _ = law.step(CounterbalanceState(), 0.0, 0.0, 0.0, 1.0)
    with pytest.raises(ModelError, match="nothing was measured"):
        law.step(state, 0.0, 0.0, 0.0, 3.0)


@pytest.mark.parametrize("dt", [0.0, -0.01, math.nan, math.inf])
def test_times_that_are_none_are_refused(dt):
    with pytest.raises(ModelError, match="dt = "):
        Counterbalance(PLAIN, (0.0, 3e5)).step(CounterbalanceState(), 0.0, 0.0, 0.0, dt)


def test_moments_and_ranges_of_no_use_are_refused():
    for per_pa in ([-1e-5, 1e-5], [-1e-5, 0.0], [math.nan, -1e-5]):
        with pytest.raises(ModelError, match=r"all above 0 or all below|not finite"):
            Counterbalance(LimbMoments(PLAIN.angle_rad, np.zeros(2), np.array(per_pa)), (0.0, 3e5))
    with pytest.raises(ModelError, match="not finite"):
        Counterbalance(LimbMoments(PLAIN.angle_rad, np.array([0.0, math.nan]), PLAIN.per_pa), (0.0, 3e5))
    with pytest.raises(ModelError, match="from low to high"):
        Counterbalance(PLAIN, (3e5, 0.0))
    with pytest.raises(ConfigError, match="stiffness: got nan"):
        CounterbalanceSettings(stiffness=math.nan)


@pytest.mark.parametrize("values", [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 0.0, math.nan)])
def test_what_is_not_finite_is_refused_before_it_is_limited(values):
    with pytest.raises(ModelError, match="not finite"):
        Counterbalance(PLAIN, (0.0, 3e5)).step(CounterbalanceState(), *values, 0.01)


def test_a_limb_that_hangs_is_not_weighed():
    wide = LimbMoments(np.array([-2.0, 2.0]), np.zeros(2), np.full(2, -1e-5))
    with pytest.raises(ModelError, match="of level"):
        Counterbalance(wide, (0.0, 3e5)).step(CounterbalanceState(), 1.5, 0.0, 0.0, 0.01)


@pytest.mark.parametrize("t_s", [0.0, 9.0])
@pytest.mark.parametrize(("angle", "rate"), [(3.1, 0.0), (-1.3, 0.0), (0.0, 40.0)])
def test_an_encoder_that_slips_jumps_or_wraps_is_refused_at_any_time(t_s, angle, rate):
    """Its table ends at 1 rad. A limb there, or beyond it by less than a stop gives way, is none of these."""
    law, state = Counterbalance(PLAIN, (0.0, 3e5)), CounterbalanceState(t_s=t_s, weight=-0.4)
    law.step(state, 1.1, 20.0, 40e3, 0.01)
    with pytest.raises(ModelError, match="the limb is at"):
        law.step(state, angle, rate, 40e3, 0.01)


def test_the_set_point_is_for_the_angle_at_which_it_acts():
    law, state = Counterbalance(PLAIN, (0.0, 3e5)), CounterbalanceState(t_s=9.0, weight=-0.4)
    for ahead_s, then in ((0.0, 0.3), (0.05, 0.4), (1.0, 1.0)):  # the table ends there
        _, setpoint = law.step(state, 0.3, 2.0, 40e3, 0.01, ahead_s)
        assert setpoint == pytest.approx(40e3 * math.cos(then))


def test_arms_that_cannot_be_used_are_refused():
    with pytest.raises(ModelError, match="3 chambers"):
        limb_moments(SoftArm(load_robot("tue_three_bellow")), WRIST, [0.0])
    link = MUSCLE.robot.links[0].model_dump(exclude={"least_elongation"}, exclude_none=True)
    joint = SoftArm(MUSCLE.robot.replace(links=[{**link, "strains": {"bending_x": {}}, "damping": [1e-5]}]))
    refined = discretised(MUSCLE.robot, Discretisation(links=2))
    with pytest.raises(ModelError, match="do not follow from the tip"):
        limb_moments(refined, WRIST, [0.0])
    chamber = {"angle_rad": 0.0, "offset_m": 0.0, "area_m2": 1e-4, "dead_band_pa": 1e3}
    swelling = SoftArm(MUSCLE.robot.replace(links=[{**link, "chambers": [chamber]}]))
    with pytest.raises(ModelError, match="no line over pressure"):
        limb_moments(swelling, WRIST, [0.0])
    with pytest.raises(ModelError, match="cannot follow the limb"):
        limb_moments(joint, WRIST, [0.0, 0.5])
