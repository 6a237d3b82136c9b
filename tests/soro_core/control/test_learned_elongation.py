"""The elongation of a circle chosen anew by what is learned: as a right file would, and never unsaid."""

import math
from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.config import find_config, parse
from soro_core.control import Controller, ControllerConfig
from soro_core.control.motions import learned_elongation
from soro_core.control.motions.kinematics import mean_static_pressure
from soro_core.control.motions.learned_elongation import ElongationChoice
from soro_core.control.motions.pressure_feasibility import pressure_supply
from soro_core.control.reference.trajectory import Hold
from soro_core.control.retune import retune
from soro_core.frozen import replaced
from soro_core.robot.parts import fields

HANGING = load_robot(find_config("three_bellow_hanging", "robots"))
GAINS = np.array([1.15, 0.7, 1.15])
DT, CIRCLE = 0.005, {"curvature_per_m": 7.0, "mean_pressure_pa": 40e3, "start_s": 0.5, "period_s": 1.0}


def config(options=None, **keys):
    found = {"law": "composite", "law_options": options or {}, "reference": {**CIRCLE, **keys}}
    return parse(found, ControllerConfig, "test")


def with_gains(robot, gains):
    link = robot.links[0]
    chambers = [
        fields(one) | {"alpha_eps": gain * one.alpha_eps, "alpha_kappa": gain * one.alpha_kappa}
        for one, gain in zip(link.chambers, gains, strict=True)
    ]
    return robot.replace(links=[fields(link) | {"chambers": chambers}])


class Learned:
    """A controller in control that has learned these gains, and whose arm is where it ought to be."""

    def __init__(self, robot=HANGING, gains=GAINS, named="link0/chamber1 gives 0.61", lacks=True, **keys):
        self.controller, self.t, self.reference = Controller(robot, config(**keys)), 0.0, None
        self.state = self.controller.initial_state()
        self.run(1.0)
        law = self.controller.law.with_gains(self.state.law, gains - 1.0, np.full(3, 1e-3))
        law = replaced(law, learner=replaced(law.learner, named=named))
        saturated = "pressure saturated: link0/chamber1" if lacks else ""
        self.state = replace(self.state, law=law, watch=replace(self.state.watch, saturated=saturated))

    def run(self, seconds):
        for _ in range(round(seconds / DT)):
            point, self.t = self.state.point, self.t + DT
            q = self.controller.configured.sample(0.0).q if point is None else point.q
            self.state, command = self.controller.step(
                self.state, q, np.zeros(3), self.t, DT, self.state.model_pa, self.reference
            )
            assert command.status.ok, command.status
        return command

    def retune(self, **keys):
        new = retune(self.controller, self.state, config(**keys), self.t)
        self.controller, self.state = new.controller, new.state
        self.reference = new.reference if new.moves else self.reference

    def elongation(self):
        return self.state.following.wanted.centre[0]


def test_the_elongation_is_the_one_that_a_right_file_gives():
    # The choice of a file leaves the force of non-uniform strain out.
    loop = Learned(options={"nonuniform_strain": False})
    of_file = loop.elongation()
    command = loop.run(0.1)
    truth = Controller(with_gains(HANGING, GAINS), config())
    assert loop.elongation() == pytest.approx(truth.configured.centre[0], abs=2e-4)
    assert of_file - loop.elongation() > 0.004
    circle, arm = loop.state.following.wanted, SoftArm(with_gains(HANGING, GAINS))
    at = circle.centre + circle.curvature_per_m * circle.across
    low, high = truth.minimum_pa, truth.maximum_pa
    assert mean_static_pressure(arm, truth.fields, at, low, high) == pytest.approx(40e3, abs=200.0)
    said = f"the circle has the elongation {loop.elongation():.3f} in place of {of_file:.3f}"
    assert said in command.status.note
    assert "40 kPa" in command.status.note


def test_the_tip_on_the_configured_circle_is_told_beside_that_of_the_reference():
    loop = Learned()
    assert loop.run(DT).configured_tip is None
    command = loop.run(1.0)
    own = loop.controller.configured.started_at(DT).sample(loop.t)
    assert command.configured_tip == pytest.approx(loop.controller.arm.pose(own.q, HANGING.length))
    away_mm = 1e3 * np.linalg.norm(command.configured_tip[:3, 3] - command.tip_reference[:3, 3])
    assert f"the tip {away_mm:.1f} mm away" in command.status.note
    assert away_mm > 0.2
    loop.reference = Hold(own.q)
    command = loop.run(DT)
    assert "elongation" not in command.status.note
    assert command.configured_tip == pytest.approx(command.tip_reference, abs=1e-12)


@pytest.mark.parametrize(
    "changes",
    [
        {"learned_elongation": False},
        {"choose_elongation": False, "elongation": 0.09},
        {"named": ""},
        {"lacks": False},
        {"kind": "set_point", "set_point": (0.05, 1.0, 0.0)},
        {"mean_pressure_pa": 60e3, "elongation": 0.0, "gains": np.ones(3)},
        {
            "robot": HANGING.replace(
                contacts={"spheres": [{"centre": [0.2, 0, 0], "radius": 0.02, "stiffness": 1e3}]}
            )
        },
    ],
    ids=["key", "stated", "as in its file", "enough pressure", "no circle", "right gains", "obstacles"],
)
def test_the_circle_stays_where_the_user_or_the_arm_gives_no_reason(changes):
    loop = Learned(**changes)
    before = loop.state.following.wanted
    command = loop.run(0.1)
    assert loop.state.following.wanted is before
    assert "elongation" not in command.status.note
    assert command.configured_tip is None


def test_a_reference_that_is_given_goes_first():
    loop = Learned()
    loop.reference = Hold(np.array([0.05, 1.0, 0.0]))
    loop.run(0.1)
    assert loop.state.following.wanted is loop.reference


def test_the_circle_returns_when_no_chamber_differs_any_more_or_the_key_is_taken_back():
    for back in (lambda loop: None, lambda loop: loop.retune(learned_elongation=False)):
        loop = Learned()
        of_file = loop.elongation()
        loop.run(0.1)
        assert loop.elongation() < of_file
        back(loop)
        if loop.controller.config.reference.learned_elongation:
            learner = replaced(loop.state.law.learner, named="")
            loop.state = replace(loop.state, law=replaced(loop.state.law, learner=learner))
        command = loop.run(1.1)
        assert loop.elongation() == of_file
        assert "elongation" not in command.status.note


def test_another_motion_begins_with_the_elongation_of_the_file_and_other_keys_leave_the_choice():
    loop = Learned()
    loop.run(0.1)
    chosen = loop.elongation()
    loop.retune(rotation_weight_m=0.01)
    assert "elongation" in loop.run(DT).status.note
    assert loop.elongation() == chosen
    loop.retune(curvature_per_m=6.0)
    command = loop.run(DT)
    assert loop.elongation() == loop.controller.configured.centre[0] != chosen
    assert "elongation" not in command.status.note
    loop.state = replace(loop.state, watch=replace(loop.state.watch, saturated="pressure saturated: a"))
    loop.run(1.2)
    assert loop.elongation() < loop.controller.configured.centre[0]


def test_a_tick_tries_one_elongation_and_a_search_without_an_end_leaves_the_circle():
    loop = Learned()
    control = loop.controller
    supply = pressure_supply(control.law, loop.state.law, loop.state.creep, control.setpoints)
    tried = []

    def actuation(q):
        tried.append(q[0])
        return supply.actuation(q)

    counted, choice, own = replace(supply, actuation=actuation), ElongationChoice(), control.configured
    while choice.chosen_s > 0.0:
        before = len(tried)
        choice, circle = choice.renewed(counted, control.config.reference, own, own, "a")
        assert len(tried) == before + 1
    assert tried[0] == own.centre[0]
    assert len(tried) <= 5
    assert circle is choice.circle
    # More pressure the shorter the arm is: there is no way to go.
    odd = replace(supply, force=lambda q, qd, qdd: np.array([150.0 - 1000.0 * q[0], 0.0, 0.0]))
    choice, ticks = ElongationChoice(), 0
    while choice.chosen_s > 0.0:
        choice, circle = choice.renewed(odd, control.config.reference, own, own, "a")
        ticks += 1
    assert (circle is own, choice.circle, ticks) == (True, None, 3)


def test_where_the_model_has_no_value_the_circle_stays(monkeypatch):
    loop = Learned()
    before = loop.elongation()
    found = iter([60e3])  # too high at first: shorter ones are tried
    monkeypatch.setattr(learned_elongation, "mean_holding_pressure", lambda *of: next(found, math.nan))
    loop.run(0.1)
    assert loop.elongation() == before
