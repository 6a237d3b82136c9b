"""The probe before control on twins that differ from their file in wiring, chambers, base or valves."""

import re
from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm
from soro_core.config import with_changes
from soro_core.control.probing.dead_time import judge_dead_time
from soro_core.control.probing.plan import ProbedArm, plan_probe
from soro_core.control.probing.procedure import Probe, ProbeSample
from soro_core.control.probing.stamps import StampedPosition, judge_stamps
from soro_core.errors import ConfigError
from soro_core.model.equilibrium.statics import stable_equilibrium
from soro_core.pneumatics import RegulatorModel
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix, rotation_exp
from soro_core.twin import Twin
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of
from tests.soro_core.loop.loop_harness import Harness, Setup

MOST_S = 20.0


def scene(name="hanging_arm", how="refuse", **changes):
    keys = {"mode": "lockstep", "platform": "", "controller.probe_at_enable": how, "twin.payload_kg": 0.01}
    return load_scene(name, keys | changes)


def chambers(robot, change, link=0):
    """The robot with other chambers in a link."""
    links = list(robot.links)
    links[link] = with_changes(links[link], chambers=tuple(change(list(links[link].chambers))))
    return robot.replace(links=tuple(links))


def swapped(robot):
    return chambers(robot, lambda all_: [all_[0], all_[2], all_[1]])


def rotated(robot):
    return chambers(robot, lambda all_: [*all_[1:], all_[0]])


def weak(robot, part=0.6):
    def change(all_):
        one = all_[1]
        all_[1] = with_changes(one, alpha_eps=part * one.alpha_eps, alpha_kappa=part * one.alpha_kappa)
        return all_

    return chambers(robot, change)


def tilted(robot, degrees):
    base = matrix_from_quaternion(np.asarray(robot.base_quaternion))
    turn = base @ rotation_exp(np.array([np.radians(degrees), 0.0, 0.0]))
    return robot.replace(base_quaternion=tuple(quaternion_from_matrix(turn)))


def probed(scene, true=None, regulator=None, most_s=MOST_S, load_steps=()):
    """Ticks of the loop until the law has begun, or for longer than the probe takes."""
    loop = loop_of(scene)
    regulator = regulator or scene.regulator
    setup = Setup(
        plant=true,
        payload_kg=scene.twin.payload_kg,
        refine=2,
        regulator=regulator,
        dt=1.0 / scene.rate_hz,
        load_steps=load_steps,
    )
    ticks, begun = [], False
    for tick in loop.run(Harness(scene.loaded_robot, setup), round(most_s / setup.dt), setup.dt):
        ticks.append(tick)
        note = tick.command.status.note
        begun = begun or note != "probing the chambers before the law begins"
        if begun and (tick.command.terms is not None or note == ticks[-2].command.status.note):
            break  # the law has begun, or the refusal stays
    return loop, ticks


def said(scene, true=None, **others):
    """What the probe has said, and whether the law has begun."""
    _, ticks = probed(scene, true, **others)
    command = ticks[-1].command
    assert ticks[-1].t_s > 1.0 or "probe" in command.status.note
    return command.status.note


@pytest.mark.slow
@pytest.mark.parametrize("load", [0.0, 0.03])
def test_an_arm_as_in_its_file_is_not_refused_under_any_load(load):
    loop, ticks = probed(scene(**{"twin.payload_kg": load}))
    assert ticks[-1].command.status.note == ""
    plan = loop.controller.probe.plan
    commands = np.array([tick.command.setpoint_pa for tick in ticks])
    assert (commands.max(axis=0) > 0.2 * plan.ceiling_pa).all()
    assert (commands <= plan.ceiling_pa).all()
    assert ticks[-1].t_s < (len(plan.names) + 3) * (plan.rise_s + plan.settle_s + plan.window_s)
    # One chamber after the other; what is left of the one before falls at the fastest rate.
    limits = loop.controller.pressures
    assert np.diff(commands, axis=0).max() <= limits.rise_pa_s * 5e-3 * (1.0 + 1e-9)
    assert (np.sort(commands, axis=1)[:, -2] < 1e3).mean() > 0.95


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (swapped, ("swapped", "link0/chamber1 acts as link0/chamber2", "tubes")),
        (rotated, ("rotated", "link0/chamber0 acts as link0/chamber1", "base_quaternion")),
        (weak, ("link0/chamber1 gives 0.", "leak")),
        (lambda robot: tilted(robot, 15.0), ("tilted by 1", "natural bend", "marker")),
    ],
)
@pytest.mark.parametrize("name", ["hanging_arm", "track_circle"])
def test_what_differs_from_the_file_is_named_and_refused(name, change, words):
    one = scene(name)
    if name == "track_circle":
        one = scene(name, **{"twin.payload_kg": 0.0})
    text = said(one, change(one.loaded_robot))
    assert text.startswith("probe: ")
    assert text.count("probe: ") == 1
    for word in words:
        assert word in text


@pytest.mark.slow
def test_a_weak_chamber_of_the_standing_arm_is_named_under_its_load():
    one = scene("track_circle", **{"twin.payload_kg": 0.02})
    assert "link0/chamber1 gives 0.7" in said(one, weak(one.loaded_robot))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "at_s", "load"), [("track_circle", 5.8, 0.02), ("hanging_arm", 2.5, 0.04)])
def test_a_load_that_changes_while_the_probe_runs_is_named_as_that(name, at_s, load):
    text = said(scene(name, **{"twin.payload_kg": 0.0}), load_steps=((at_s, load),))
    assert "probe: the load has changed by +" in text
    assert "leave the load as it is" in text


def test_a_small_tilt_warns_and_the_law_begins():
    one = scene()
    _, ticks = probed(one, tilted(one.loaded_robot, 5.0))
    command = ticks[-1].command
    assert "tilted by" in command.status.note
    assert command.terms is not None  # of the law


@pytest.mark.slow
def test_a_refusal_vents_and_stays_and_a_warning_does_not():
    one = scene(how="refuse")
    true = swapped(one.loaded_robot)
    _, ticks = probed(one, true)
    assert np.all(ticks[-1].command.setpoint_pa == 0.0)
    assert ticks[-1].command.terms is None
    _, ticks = probed(scene(how="warn"), true)
    assert "swapped" in ticks[-1].command.status.note
    assert ticks[-1].command.terms is not None


@pytest.mark.slow
def test_a_dead_time_is_named_and_a_longer_lag_is_none():
    one = scene()
    text = said(one, regulator=RegulatorModel(delay_s=0.1))
    assert "set points act after 1" in text
    assert "declared: 10 ms" in text
    assert "delay_s" in text
    assert said(one, regulator=RegulatorModel(tau_s=0.15)) == ""


def test_the_dead_time_of_commands_and_readings_alone():
    t = np.arange(0.0, 3.0, 5e-3)
    command = np.where((t > 0.5) & (t < 1.5), 5e3, 0.0)[:, None]
    noise = 100.0 * np.random.default_rng(1).standard_normal(t.size)

    def reading(dead_s, lag_s):
        value, found = 0.0, []
        for at in t:
            value += (np.interp(at - dead_s, t, command[:, 0]) - value) * 5e-3 / lag_s
            found.append(value)
        return (np.array(found) + noise)[:, None]

    for dead_s, named in ((0.01, False), (0.02, False), (0.06, True), (0.2, True)):
        found = judge_dead_time(("a",), t, command, reading(dead_s, 0.06), 0.015)
        assert bool(found) == named, dead_s
    assert judge_dead_time(("a",), t, command, reading(0.015, 0.3), 0.015) == []


class Shifted(Harness):
    """Poses are stamped later than they are taken, and come when the stamp is past."""

    shift_s = 0.0

    def observe(self, world):
        world, seen = super().observe(world)
        late = tuple(replace(pose, stamp_s=pose.stamp_s + self.shift_s) for pose in seen.poses)
        return world, replace(seen, poses=late)


def shifted(shift_s, name="hanging_arm", true=None, payload_kg=0.01, **changes):
    """What the probe says of poses that are stamped late by a time."""
    one = scene(name, **{"twin.payload_kg": payload_kg})
    loop, dt = loop_of(one), 1.0 / one.rate_hz
    delay = max(1, int(np.ceil(shift_s / dt + 0.5)))
    setup = Setup(
        plant=true and true(one.loaded_robot),
        payload_kg=payload_kg,
        refine=2,
        regulator=one.regulator,
        dt=dt,
        pose_delay=delay,
        **changes,
    )
    plant = Shifted(one.loaded_robot, setup)
    plant.shift_s = shift_s
    for tick in loop.run(plant, round(MOST_S / dt), dt, before_s=0.0):
        command = tick.command
        if command.terms is not None or (tick.t_s > 1.0 and "probing" not in command.status.note):
            return command.status.note
    raise AssertionError("the probe has no end")


def soft_silicone(robot):
    """A robot that creeps by a quarter of its bending stiffness in 1.5 s, with friction of as much again."""
    part = 0.25 * float(SoftArm(robot).stiffness_matrix(np.zeros(3))[1, 1])
    return robot.with_(
        {
            "links[0].creep": [{"tau": [1.5], "stiffness": [0.0, part, part]}],
            "links[0].hysteresis": [{"stiffness": [0.0, part, part], "range": [1.0, 1.0, 1.0]}],
        }
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shift_s", "changes"),
    [
        (0.02, {}),
        (0.04, {"stiffness": 1.3}),
        (-0.02, {"damping": 2.0}),
        (0.04, {"name": "track_circle", "payload_kg": 0.0}),
        (0.06, {"pose_every": 8}),
        (0.02, {"true": soft_silicone}),
    ],
)
def test_poses_that_are_stamped_late_or_early_are_named(shift_s, changes):
    text = shifted(shift_s, **changes)
    found = re.search(r"poses are stamped (\d+) ms (late|early)", text)
    assert found, text
    assert float(found[1]) == pytest.approx(1e3 * abs(shift_s), abs=6.0)
    assert found[2] == ("late" if shift_s > 0.0 else "early")
    assert "when it is taken" in text or "at which it is taken" in text


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {"true": soft_silicone},
        {"stiffness": 0.7},
        {"stiffness": 1.3},
        {"damping": 2.0},
        {"payload_kg": 0.03},
        {"name": "track_circle", "payload_kg": 0.0, "damping": 2.0},
        {"name": "track_circle", "payload_kg": 0.02},
        {"pose_every": 8},
    ],
)
def test_an_arm_unlike_its_file_has_no_late_stamps(changes):
    assert "stamped" not in shifted(0.0, **changes)


def arm(controller):
    return ProbedArm(
        controller.arm,
        controller.fields,
        controller.limit,
        controller.pressures,
        controller.law.heaviest_kg(),
        controller.config.enable,
    )


def fed(probe, sample, seconds=8.0):
    """The end of a probe that is given samples."""
    state = probe.initial_state()
    for k in range(round(seconds / 5e-3)):
        state = probe.step(state, sample(k * 5e-3))
        if state.done:
            break
    return state


@pytest.fixture(scope="module")
def standing():
    return loop_of(scene("track_circle")).controller


@pytest.mark.slow
def test_an_arm_that_is_not_empty_or_moves_or_is_lost_is_refused_with_the_reason(standing):
    probe, zero = Probe(arm(standing), lenient=True), np.zeros(3)
    full = fed(probe, lambda t: ProbeSample(t, zero, zero, np.array([0.0, 5e3, 0.0])))
    assert "not empty: link0/chamber1 is at 5.0 kPa" in full.refusal
    swings = fed(probe, lambda t: ProbeSample(t, np.array([0.0, 3.0 * np.sin(9.0 * t), 0.0]), zero, zero))
    assert "the arm moves" in swings.refusal
    gone = fed(probe, lambda t: ProbeSample(t if t < 1.5 else t + 0.3, zero, zero, zero))
    assert "no estimate of the arm for 0.3" in gone.refusal
    falls = fed(probe, lambda t: ProbeSample(t, np.full(3, 1e3 * (t > 1.5)), zero, zero))
    assert falls.refusal == ""
    wild = fed(probe, lambda t: ProbeSample(t, np.full(3, 1e3 * (t > 3.0)), zero, zero))
    assert "falls over under its load with link0/chamber0" in falls.said
    assert "limits of motion with link0/chamber0" in wild.refusal
    none = fed(probe, lambda t: ProbeSample(t, zero, zero, np.full(3, np.nan)))
    assert "not finite" in none.refusal
    for state in (full, swings, gone, falls, wild, none):
        assert np.all(state.setpoint_pa == 0.0)


@pytest.mark.parametrize("phase", ["rest", "trial", "press", "fall"])
def test_a_state_that_no_arm_has_never_makes_a_pressure_beyond_the_limits(standing, phase):
    """So large that the tip has no place: every comparison with it is false."""
    probe, nan_like = Probe(arm(standing), lenient=True), np.array([0.0, 1e200, 0.0])
    state = probe.initial_state()
    for k in range(1500):
        q = nan_like if state.phase == phase else np.zeros(3)
        state = probe.step(state, ProbeSample(5e-3 * k, q, np.zeros(3), state.setpoint_pa))
        assert np.all((state.setpoint_pa >= 0.0) & (state.setpoint_pa <= probe.plan.ceiling_pa)), k
        if state.done:
            break
    assert "no arm has such a state" in state.refusal


@pytest.mark.parametrize("from_s", [0.0, 1.5, 3.0])
def test_a_state_for_which_the_model_has_no_value_ends_the_probe_at_zero(standing, from_s):
    probe, zero = Probe(arm(standing), lenient=True), np.zeros(3)
    collapsed = np.array([-2.0, 0.0, 0.0])
    state = fed(probe, lambda t: ProbeSample(t, collapsed if t > from_s else zero, zero, zero))
    assert "elongation" in state.refusal or "limits of motion" in state.refusal
    assert np.all(state.setpoint_pa == 0.0)


def test_a_chamber_whose_reading_does_not_rise_ends_the_probe(standing):
    probe, zero = Probe(arm(standing)), np.zeros(3)
    state = fed(probe, lambda t: ProbeSample(t, zero, zero, zero))
    assert "link0/chamber0 reads 0.0 kPa at a set point of" in state.refusal


def small(standing, top_pa):
    """A probe whose pressures are this small, as those of a standing arm near buckling are."""
    probe = Probe(arm(standing))
    probe.plan = replace(probe.plan, ceiling_pa=np.full(3, top_pa))
    return probe


def read(standing, top_pa, reading):
    """The end of a probe of an arm that rests; readings follow the set point, in noisy steps of 100 Pa."""
    probe, zero, rng = small(standing, top_pa), np.zeros(3), np.random.default_rng(1)
    state, rest = probe.initial_state(), stable_equilibrium(standing.arm, zero, None, 0.0)
    for k in range(3000):
        pressure = reading(state.setpoint_pa) + 100.0 * rng.standard_normal(3)
        state = probe.step(state, ProbeSample(5e-3 * k, rest, zero, 100.0 * np.round(pressure / 100.0)))
        if state.done:
            break
    return state


@pytest.mark.parametrize("top_pa", [800.0, 1200.0, 5000.0])
def test_a_dead_and_a_weak_valve_are_named_at_small_pressures_and_the_play_of_a_good_one_is_not(
    standing, top_pa
):
    half = 0.5 * standing.pressures.play_pa
    assert half == 450.0
    for part in (0.0, 0.3):
        state = read(standing, top_pa, lambda set_pa, part=part: part * np.maximum(set_pa - half, 0.0))
        assert f"link0/chamber0 reads {1e-3 * part * (top_pa - half):.1f} kPa at a set point" in state.refusal
    assert "reads" not in read(standing, top_pa, lambda set_pa: np.maximum(set_pa - half, 0.0)).said


def test_a_pressure_within_the_play_of_a_valve_says_that_nothing_is_judged(standing):
    state = read(standing, 500.0, lambda set_pa: 0.0 * set_pa)
    assert state.refusal == ""
    assert "link0/chamber1, link0/chamber2, 0.5 kPa, is within the play of its valve" in state.said


def test_no_pressure_leaves_the_limits_of_motion_by_the_model_under_its_heaviest_load(standing):
    known = arm(standing)
    plan = plan_probe(known)
    assert (plan.ceiling_pa <= standing.maximum_pa).all()
    for load in np.linspace(0.0, known.heaviest_kg, 4):
        rest = stable_equilibrium(known.arm, np.zeros(3), None, load)
        if (known.fields.peaks(rest) > known.limit).any():
            continue  # no pressure moves it there
        for k in range(3):
            q = stable_equilibrium(known.arm, plan.ceiling_pa[k] * np.eye(3)[k], rest, load)
            assert (known.fields.peaks(q) <= known.limit).all()
    tight = known._replace(limit=np.full(3, 1e-4))
    with pytest.raises(ConfigError, match="beyond the limits"):
        plan_probe(tight)


def test_without_the_key_nothing_is_probed():
    one = scene(how="off")
    assert loop_of(one).controller.probe is None
    unset = with_changes(one, controller=with_changes(one.controller, probe_at_enable="auto"))
    assert loop_of(unset).controller.probe is None
    assert loop_of(unset).controller.initial_state().probe is None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["six_links", "two_links", "imu_only"])
def test_other_arms_and_sensors_are_not_refused(name):
    one = load_scene(name, {"mode": "lockstep", "controller.probe_at_enable": "refuse"})
    loop = loop_of(one)
    twin = Twin(one.loaded_robot, with_changes(one.twin_node(), pressures="regulators"))
    for tick in loop.run(twin, 4000, 1.0 / one.rate_hz, before_s=-1.0 / one.rate_hz):
        if tick.command.terms is not None:
            break
    assert tick.command.status.note == ""
    assert tick.t_s > 3.0


@pytest.mark.parametrize(("moves_m", "named"), [(0.05, True), (0.0, False)])
@pytest.mark.filterwarnings("error")
def test_stamps_are_judged_by_poses_of_the_arm_alone(moves_m, named):
    t = 0.01 * np.arange(400.0)
    turn = np.sin(3.0 * t) * (t > 1.0)
    pressure = 1e4 * np.column_stack([turn, np.cos(2.0 * t)])
    bend = moves_m * np.column_stack([turn, np.cos(2.0 * t), np.zeros(t.size)])
    seen = [StampedPosition("pose", at + 0.05, place) for at, place in zip(t.tolist(), bend, strict=True)]
    seen[200] = seen[200]._replace(position=np.array([1e200, 0.0, -1e200]))
    found = judge_stamps(t, pressure, seen, 0.2)
    assert bool(found) == named
    assert not named or "stamped" in str(found[0])
