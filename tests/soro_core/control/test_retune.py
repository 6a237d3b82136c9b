"""Keys that change while the arm is controlled: at once, without a step, nothing learned is lost."""

from dataclasses import replace

import control_samples
import numpy as np
import pytest

from soro_core import robot_from_dict
from soro_core.config import parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.force import tip_stiffness
from soro_core.control.retune import retune
from soro_core.errors import ConfigError
from soro_core.model.equilibrium import finer_arm as finer
from tests.refused import fails

DT = 0.005
ROBOT = robot_from_dict({**control_samples.ROBOT, "links": [control_samples.LINK]})
Q = np.array([-0.02, 1.0, -0.7])
HOLD = {"reference": {"kind": "set_point", "start_s": 0.2, "set_point": [0.05, 0.0, 0.0]}}
GAINS = {"k_p": [20.0, 2e-3, 2e-3], "k_d": [0.5, 1e-4, 1e-4], "lambda_per_s": [5.0, 5.0, 5.0]}


def config(**keys):
    return parse({"law": "composite", **HOLD, **keys}, ControllerConfig, "test")


class Loop:
    """A controller whose arm stays at `Q`, off its reference."""

    def __init__(self, **keys):
        self.controller = Controller(ROBOT, config(**keys))
        self.state, self.reference, self.t = self.controller.initial_state(), None, 0.0
        self.run(0.5)

    def run(self, seconds):
        commands = []
        for _ in range(round(seconds / DT)):
            self.t += DT
            self.state, command = self.controller.step(
                self.state, Q, np.zeros(3), self.t, DT, self.state.model_pa, self.reference
            )
            assert command.status.ok
            commands.append(command)
        return commands

    def retune(self, **keys):
        new = retune(self.controller, self.state, config(**keys), self.t)
        self.controller, self.state = new.controller, new.state
        self.reference = new.reference if new.moves else self.reference
        return new


def largest_step(commands, before):
    forces = np.array([before.desired_force, *(c.desired_force for c in commands)])
    return np.abs(np.diff(forces, axis=0)).max(axis=0)


def test_what_a_touch_needs_is_made_with_the_controller_and_kept(monkeypatch):
    loop = Loop()
    monkeypatch.setattr(tip_stiffness, "SoftArm", None)
    monkeypatch.setattr(finer, "SoftArm", None)
    before = loop.controller.force_loop
    loop.retune(force={"rate_per_s": 3.0})
    after = loop.controller.force_loop
    assert (before.config.rate_per_s, after.config.rate_per_s) == (1.0, 3.0)
    assert after.stiffness.nonuniformity(Q, np.array([1.0, 0.0, 0.0])) > 1.1


def test_other_gains_act_soon_and_without_a_step():
    loop, target = Loop(gains=GAINS), Loop(gains={**GAINS, "k_p": [200.0, 2e-2, 2e-2]})
    before, wanted = loop.run(DT)[-1], target.run(DT)[-1]
    whole = np.abs(wanted.desired_force - before.desired_force)
    assert whole.min() > 1e-3 * np.abs(before.desired_force).max()
    loop.retune(gains={**GAINS, "k_p": [200.0, 2e-2, 2e-2]})
    commands = loop.run(3.0)
    assert np.all(largest_step(commands, before) < 0.03 * whole)
    assert commands[-1].desired_force == pytest.approx(target.run(3.0)[-1].desired_force, rel=1e-3)
    assert loop.state.transfer.difference is None


def test_gains_that_are_set_anew_take_back_what_a_limit_cycle_has_lowered():
    loop = Loop(gains=GAINS)
    loop.state = replace(loop.state, limit_cycle=replace(loop.state.limit_cycle, part=0.25, note="swings"))
    whole = Loop(gains=GAINS).run(DT)[-1].terms["proportional"]
    left = loop.run(DT)[-1]
    np.testing.assert_allclose(left.terms["proportional"], 0.25 * whole)
    assert "swings" in left.status.note
    loop.retune(adapt=False, gains=GAINS)
    assert loop.state.limit_cycle.part == 0.25
    loop.retune(adapt=False, gains={**GAINS, "lambda_per_s": [4.0, 4.0, 4.0]})
    assert loop.state.limit_cycle.part == 1.0
    assert not loop.run(DT)[-1].status.note


def test_without_a_change_nothing_is_added():
    loop, other = Loop(), Loop()
    loop.retune()
    one, two = loop.run(1.0)[-1], other.run(1.0)[-1]
    assert one.desired_force.tolist() == two.desired_force.tolist()


def test_adaptation_that_is_switched_off_keeps_what_is_learned():
    learnt = {"parameters": ["a1"], "gain": [1e5], "lower": [100.0], "upper": [2e4]}
    adaptive = {"law": "adaptive", "adaptation": learnt}
    loop = Loop(**adaptive)
    before = loop.run(1.0)[-1]
    loop.retune(**adaptive, adapt=False)
    frozen = loop.state.law.estimate.tolist()
    assert frozen != loop.controller.law.parameters.nominal.tolist()
    commands = loop.run(1.0)
    assert loop.state.law.estimate.tolist() == frozen
    assert np.all(largest_step(commands, before) <= 1e-6 + 0.05 * np.abs(before.desired_force))
    loop.retune(**adaptive, adapt=True)
    loop.run(1.0)
    assert loop.state.law.estimate.tolist() != frozen


@pytest.mark.slow
def test_another_reference_is_reached_by_a_passage():
    loop = Loop()
    before = loop.state.point.q
    goal = [0.1, 3.0, 2.0]
    new = loop.retune(reference={**HOLD["reference"], "set_point": goal})
    assert new.moves
    points = np.array([before, *(command.reference.q for command in loop.run(3.0))])
    assert points[-1] == pytest.approx(goal)
    rates = np.abs(np.diff(points, axis=0)).max(axis=0) / DT
    assert rates[0] <= 0.3 * (1 + 1e-6)  # stretch_rate_per_s
    assert rates[1:].max() <= 2.0 / 0.064 * (1 + 1e-6)  # bend_rate_rad_s
    loop.retune(reference={"kind": "circle"})
    assert not np.allclose(loop.run(2.0)[-1].reference.qd, 0.0)
    loop.retune(reference={"kind": "hold"})
    held = loop.run(5.0)
    assert held[-1].reference.qd == pytest.approx(np.zeros(3), abs=1e-9)
    assert held[-1].reference.q == pytest.approx(held[-200].reference.q)


def test_before_the_first_tick_the_other_reference_is_the_first():
    controller = Controller(ROBOT, config())
    new = retune(controller, controller.initial_state(), config(reference={"kind": "circle"}), 0.0)
    assert new.moves
    assert new.reference is None
    assert new.controller.configured is not None
    assert controller.configured != new.controller.configured


def test_narrower_pressures_bound_the_next_commands():
    loop = Loop()
    assert max(command.setpoint_pa.max() for command in loop.run(0.1)) > 10e3
    loop.retune(pressures={"maximum_pa": 10e3})
    assert max(command.setpoint_pa.max() for command in loop.run(1.0)[-50:]) <= 10e3


@pytest.mark.parametrize(
    ("keys", "key"),
    [
        ({"law": "adaptive"}, "law"),
        ({"reference": {**HOLD["reference"], "stretch_limit": 0.5}}, "reference.stretch_limit"),
        ({"pressures": {"regularisation": 1e-6}}, "pressures.regularisation"),
        ({"law_options": {"nonuniform_strain": False}}, "law_options"),
        ({"reference": {**HOLD["reference"], "set_point": [0.9, 0.0, 0.0]}}, "reference.set_point"),
    ],
)
def test_what_cannot_change_now_or_does_not_fit_is_refused_and_changes_nothing(keys, key):
    loop = Loop()
    before = loop.controller, loop.controller.config, loop.state
    with fails(ConfigError, key=key):
        loop.retune(**keys)
    assert before == (loop.controller, loop.controller.config, loop.state)


@pytest.mark.slow
def test_gains_of_a_law_with_a_trial_wait_for_the_next_configure():
    lagless = {"law": "tip_pid", "pressures": {"lag_s": 0.0, "dead_time_s": 0.0, "preview_s": 0.0}}
    controller = Controller(ROBOT, config(**lagless))
    assert controller.law.trial_loads_kg()
    state = replace(controller.initial_state(), point=None)
    with fails(ConfigError, "next configure", key="gains"):
        retune(controller, state, config(**lagless, gains=GAINS), 0.0)


def test_a_pushed_tip_gives_way_by_the_stiffness_that_is_set_anew():
    loop = Loop(force={"stiffness_factor": 0.5})
    away = np.eye(3), np.eye(3)
    loop.state = replace(loop.state, force=replace(loop.state.force, yields=away))
    loop.retune(force={"stiffness_factor": 2.0})
    assert loop.state.force.yields is None
