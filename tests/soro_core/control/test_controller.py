"""The controller as a whole: commands are always finite and within bounds; references; nonsense."""

from dataclasses import fields

import control_samples
import numpy as np
import pytest

from soro_core import SoftArm, robot_from_dict
from soro_core.config import find_config, load, parse, with_changes
from soro_core.control import Controller, ControllerConfig
from soro_core.control.config import Gains
from soro_core.control.motions.kinematics import (
    elongation_for_pressure,
    inverse_kinematics,
    mean_static_pressure,
)
from soro_core.errors import ConfigError
from soro_core.robot.coordinates import strain_fields
from tests.refused import refused

LINK = {**control_samples.LINK, "creep": [{"tau": [0.025], "stiffness": [0.0, 2e-5, 2e-5]}]}
ROBOT = {**control_samples.ROBOT, "links": [LINK]}
DT = 0.005


def config(**changes):
    return parse({"law": "adaptive", **changes}, ControllerConfig, "test")


def controller(links=1, **changes):
    return Controller(robot_from_dict({**ROBOT, "links": [LINK] * links}), config(**changes))


def rest(control):
    return np.zeros(control.arm.n_q)


def run(control, seconds, q=None, qd=None, state=None, start=0.0, reference=None):
    state = state if state is not None else control.initial_state()
    q, qd = rest(control) if q is None else q, rest(control) if qd is None else qd
    for k in range(round(seconds / DT)):
        state, command = control.step(state, q, qd, start + k * DT, DT, state.model_pa, reference)
    return state, command


@pytest.mark.parametrize("seed", range(5))
def test_commands_stay_finite_within_bounds_and_slew(seed):
    rng = np.random.default_rng(seed)
    control = controller(
        adaptation={
            "parameters": ["tip_mass", "a1", "chamber_gain"],
            "gain": [1.0, 1e6, 1e-3],
            "lower": [0.0, 1000.0, 0.5],
            "upper": [0.1, 2e4, 2.0],
        }
    )
    state, before = control.initial_state(), np.zeros(3)
    for k in range(300):
        wild = 10.0 ** rng.uniform(-3, 3)
        q = np.array([0.1, 10.0, 10.0]) * wild * rng.standard_normal(3)
        qd = np.array([1.0, 100.0, 100.0]) * wild * rng.standard_normal(3)
        if k % 7 == 0:
            q[rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf])
        measured = rng.uniform(0, 9e4, 3)
        if k % 5 == 0:
            measured[0] = np.nan
        state, command = control.step(state, q, qd, k * DT, DT, measured)
        assert np.all(np.isfinite(command.setpoint_pa))
        assert np.all(command.setpoint_pa >= 0.0)
        assert np.all(command.setpoint_pa <= 90e3)
        assert np.all(command.setpoint_pa - before <= 200e3 * DT * (1 + 1e-9))
        assert np.all(before - command.setpoint_pa <= 400e3 * DT * (1 + 1e-9))
        assert control.law.parameters.polytope.contains(state.law.estimate)
        before = command.setpoint_pa


def test_a_state_that_is_no_state_holds_the_command():
    control = controller()
    state, _ = run(control, 1.0)
    for q, qd, t, dt in [
        (np.full(3, np.nan), np.zeros(3), 1.0, DT),
        (np.zeros(3), np.full(3, np.inf), 1.0, DT),
        (np.zeros(2), np.zeros(3), 1.0, DT),
        (np.zeros(3), np.zeros(3), np.nan, DT),
        (np.zeros(3), np.zeros(3), 1.0, 0.0),
    ]:
        after, command = control.step(state, q, qd, t, dt, np.zeros(3))
        assert after.watch.refused == state.watch.refused + 1
        # By identity: arrays have no truth value, which `==` of dataclasses asks for from Python 3.13 on.
        kept = [field.name for field in fields(state) if field.name != "watch"]
        assert all(getattr(after, name) is getattr(state, name) for name in kept)
        assert not command.status.ok
        assert command.status.message
        assert command.setpoint_pa.tolist() == state.setpoint_pa.tolist()


def test_the_same_law_with_adaptation_off():
    """The first tick, before anything was learnt, is the same; afterwards the estimates stay put."""
    on, off = controller(), controller(adapt=False)
    q, qd = np.array([0.01, 0.5, -0.5]), np.array([0.1, 2.0, 3.0])
    _, one = on.step(on.initial_state(), q, qd, 0.0, DT, np.zeros(3))
    _, two = off.step(off.initial_state(), q, qd, 0.0, DT, np.zeros(3))
    assert one.desired_force.tolist() == two.desired_force.tolist()
    assert one.setpoint_pa.tolist() == two.setpoint_pa.tolist()
    state, _ = run(off, 3.0, q=q)
    assert state.law.estimate.tolist() == off.law.parameters.nominal.tolist()
    moved, _ = run(on, 3.0, q=q)
    assert moved.law.estimate.tolist() != on.law.parameters.nominal.tolist()


def test_the_reference_starts_where_the_arm_is_and_becomes_the_circle():
    control = controller(reference={"elongation": 0.05, "choose_elongation": False, "curvature_per_m": 6.0})
    q = np.array([0.02, 1.0, -2.0])
    state, first = control.step(control.initial_state(), q, np.zeros(3), 0.0, DT, np.zeros(3))
    assert first.reference.q == pytest.approx(q)
    assert first.reference.qd == pytest.approx(np.zeros(3), abs=1e-12)
    _, later = run(control, 4.0, q=q, state=state, start=DT)
    assert later.reference.q[0] == pytest.approx(0.05)
    assert np.hypot(*later.reference.q[1:]) == pytest.approx(6.0)
    assert later.tip_reference == pytest.approx(control.arm.pose(later.reference.q, 0.064))


@pytest.mark.slow
def test_a_new_reference_is_approached_smoothly_and_kept():
    control = controller()
    state, before = run(control, 5.0)
    goal = control.trajectory(5.0, control.robot.coordinate_names, [0.0], [[0.08, -2.0, 3.0]])
    state, after = control.step(state, rest(control), rest(control), 5.0, DT, np.zeros(3), goal)
    step = np.abs(after.reference.q - before.reference.q)
    assert np.all(step <= 2 * DT * np.abs(before.reference.qd) + 1e-6)
    state, end = run(control, 4.0, state=state, start=5.0 + DT, reference=goal)
    assert end.reference.q == pytest.approx([0.08, -2.0, 3.0])
    # And back to the configured circle, which went on meanwhile.
    state, back = run(control, 4.0, state=state, start=9.1)
    assert np.hypot(*back.reference.q[1:]) == pytest.approx(10.0)


def test_a_trajectory_with_wrong_names_is_refused():
    with refused("joint_names"):
        controller().trajectory(0.0, ["a", "b", "c"], [0.0], [[0.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("link0/bending_x", 1e30, "-46.875 to 46.875"),
        ("link0/bending_y", -47.0, "-46.875 to 46.875"),
        ("link0/elongation", 0.61, "-0.6 to 0.6"),
    ],
)
def test_a_trajectory_beyond_the_limits_is_refused_by_coordinate(name, value, allowed):
    control = controller()
    names = list(reversed(control.robot.coordinate_names))
    point = [value if other == name else 0.0 for other in names]
    with pytest.raises(ConfigError) as caught:
        control.trajectory(0.0, names, [0.0, 1.0], [[0.0, 0.0, 0.0], point])
    assert str(caught.value) == f"trajectory: positions of {name}: got {value}; allowed: {allowed}"


def test_a_trajectory_may_reach_its_limits():
    control = controller()
    reference = control.trajectory(0.0, control.robot.coordinate_names, [0.0], [control.limit])
    assert reference.sample(0.0).q.tolist() == control.limit.tolist()


def test_the_chosen_elongation_takes_the_desired_pressure():
    arm = SoftArm(robot_from_dict(ROBOT))
    fields = strain_fields(arm.robot)
    low, high = np.zeros(3), np.full(3, 90e3)
    bent, stretch = np.array([0.0, 7.0, 0.0]), np.array([1.0, 0.0, 0.0])
    found = elongation_for_pressure(arm, fields, bent, stretch, 40e3, low, high)
    assert mean_static_pressure(arm, fields, bent + found * stretch, low, high) == pytest.approx(
        40e3, rel=1e-6
    )
    assert elongation_for_pressure(arm, fields, bent, stretch, 9e9, low, high) == 0.6
    assert elongation_for_pressure(arm, fields, bent, stretch, -9e9, low, high) == -0.3


@pytest.mark.parametrize("links", [1, 2])
@pytest.mark.parametrize("seed", range(6))
def test_inverse_kinematics_finds_reachable_tips(links, seed):
    control = controller(links)
    rng = np.random.default_rng(seed)
    q = np.tile([0.15, 12.0, 12.0], links) * rng.uniform(-1, 1, 3 * links)
    target = control.arm.pose(q, control.robot.length)
    start = np.zeros(3 * links)
    found = inverse_kinematics(control.arm, target[:3, 3], None, start, control.limit)
    assert found.position_error_m < 1e-8
    assert np.all(np.abs(found.q) <= control.limit)
    if links == 1:
        assert found.q == pytest.approx(q, abs=1e-5)


def test_a_tip_reference_out_of_reach_or_senseless_is_refused():
    control = controller()
    state = control.initial_state()
    reference = control.tip(state, np.array([0.01, 0.02, -0.06]), np.array([1.0, 0.0, 0.0, 0.0]))
    assert control.arm.pose(reference.sample(0.0).q, 0.064)[:3, 3] == pytest.approx(
        [0.01, 0.02, -0.06], abs=1e-7
    )
    with refused("position"):
        control.tip(state, np.array([0.0, 0.3, 0.0]))
    with refused("position"):
        control.tip(state, np.array([0.0, np.nan, 0.0]))
    with refused("orientation"):
        control.tip(state, np.array([0.0, 0.0, -0.06]), np.zeros(4))


def test_set_point_and_hold():
    q = np.array([0.03, 1.0, 2.0])
    _, command = run(controller(reference={"kind": "hold"}), 4.0, q=q)
    assert command.reference.q == pytest.approx(q)
    _, command = run(controller(reference={"kind": "set_point", "set_point": [0.05, 0.0, 3.0]}), 4.0, q=q)
    assert command.reference.q == pytest.approx([0.05, 0.0, 3.0])


def test_the_shipped_file_holds_the_defaults():
    shipped = load(find_config("adaptive_three_bellow", "controllers"), ControllerConfig)
    assert with_changes(shipped, robot="", gains=Gains()) == config()


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"gains": {"k_p": [1.0, 1.0]}}, "gains.k_p"),
        ({"gains": {"k_d": [-1.0, 1.0, 1.0]}}, "gains"),
        ({"gains": {"k_p": "auto"}}, "gains.k_p"),
        ({"gains": "automatic"}, "gains"),
        ({"pressures": {"minimum_pa": 95e3}}, ""),  # as of one file with the limits
        ({"pressures": {"minimum_pa": 91e3, "maximum_pa": 99e3, "preferred_pa": 95e3}}, "pressures"),
        ({"law": "pid"}, "law"),
        ({"reference": {"period_s": 0.0}}, "reference.period_s"),
        ({"referenze": {}}, "referenze"),
    ],
)
def test_wrong_configurations_are_refused_by_name(changes, key):
    with refused(key):
        controller(**changes)


def test_it_repeats_bit_by_bit():
    (one, a), (two, b) = (run(controller(), 1.0, q=np.array([0.01, 1.0, 2.0])) for _ in range(2))
    assert a.setpoint_pa.tobytes() == b.setpoint_pa.tobytes()
    assert one.law.estimate.tobytes() == two.law.estimate.tobytes()
