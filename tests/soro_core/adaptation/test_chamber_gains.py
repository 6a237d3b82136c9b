"""Gains of chambers and slopes of their areas that differ from the file, of arms whose force is known."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.adaptation import Learned, Learner, LearnerSample
from soro_core.adaptation.config import LearnerConfig
from soro_core.config import find_config
from soro_core.robot.parts import fields

FILE = load_robot(find_config("tue_three_bellow", "robots"))
DT = 0.005


def with_chambers(gains=(1.0, 1.0, 1.0), slope=0.0, robot=FILE):
    """The robot with gains over the file's, and an area slope beyond it."""
    link = fields(robot.links[0])
    chambers = []
    for chamber, gain in zip(robot.links[0].chambers, gains, strict=True):
        keys = fields(chamber)
        keys |= {name: gain * keys[name] for name in ("alpha_eps", "alpha_kappa")}
        chambers.append(keys | {"area_slope": keys["area_slope"] + slope})
    return robot.replace(links=[link | {"chambers": chambers}])


def taught(true, ticks=1200, **keys):
    """A learner of the file's arm that has seen the true one go round, and up and down."""
    arm, file = SoftArm(true), SoftArm(FILE)
    learner = Learner(file, LearnerConfig(noise=0.05, **keys))
    state, none, zero = learner.initial_state(), np.zeros(file.n_internal), np.zeros(3)
    for k in range(ticks):
        q = np.array([0.06 + 0.03 * np.sin(0.7e-2 * k), 6.0 * np.cos(2e-2 * k), 6.0 * np.sin(2e-2 * k)])
        force = arm.inverse_dynamics(q, zero, zero, zero) + arm.elastic_force(q)
        pressure = np.linalg.solve(arm.actuation_matrix(q), force)
        state = learner.step(state, LearnerSample(q, zero, pressure, none, 1e-8 * np.eye(3)), DT)
    return learner, state


def test_a_weak_chamber_is_found_and_named():
    learner, state = taught(with_chambers((1.0, 0.6, 1.0)))
    gains = learner.chambers.factor(state.chambers, np.zeros(3))
    print(gains, state.note)
    np.testing.assert_allclose(gains / gains[0], [1.0, 0.6, 1.0], atol=0.05)
    assert np.mean(gains) == pytest.approx(1.0, abs=1e-3)
    assert state.note.startswith("link0/chamber1 gives 0.")
    assert "chamber0" not in state.note


@pytest.mark.parametrize("gains", [(1.0, 1.0, 1.0), (0.8, 0.8, 0.8), (1.0, 0.9, 1.0)])
def test_no_chamber_is_named_that_is_like_the_others(gains):
    learner, state = taught(with_chambers(gains))
    assert state.note == ""
    # What all share is in mass and W.
    assert np.mean(learner.chambers.factor(state.chambers, np.zeros(3))) == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("slope", [4.6, 2.0, -2.0])
def test_an_area_slope_is_adopted_and_found(slope):
    _, state = taught(with_chambers(slope=slope))
    print(state.chambers, state.slopes)
    assert state.slopes.adopted
    assert state.chambers[3] == pytest.approx(slope, abs=0.3)
    assert state.note == ""


@pytest.mark.parametrize("gains", [(1.0, 1.0, 1.0), (1.0, 0.6, 1.0)])
def test_no_slope_is_adopted_that_predicts_nothing(gains):
    _, state = taught(with_chambers(gains))
    print(state.slopes)
    assert not state.slopes.adopted
    assert state.chambers[3] == 0.0


def test_the_force_of_the_chambers_is_what_the_file_makes_too_much():
    learner = Learner(SoftArm(FILE), LearnerConfig())
    arm, q, pressure = learner.arm, np.array([0.07, 3.0, -5.0]), np.array([20e3, 50e3, 35e3])
    values = np.array([0.1, -0.3, 0.2, 1.5])
    force, by_q = learner.chambers.force(values, q, pressure)
    beyond, change = learner.chambers.tangent(values, q, arm.actuation_matrix(q) * pressure)
    np.testing.assert_allclose(force, beyond + change @ values, rtol=1e-9)
    near_values = values + np.array([0.01, -0.01, 0.02, -0.1])
    of_near, _ = learner.chambers.force(near_values, q, pressure)
    np.testing.assert_allclose(beyond + change @ near_values, of_near, rtol=1e-2)
    e = learner.chambers.factor(values, q)
    np.testing.assert_allclose(force, arm.actuation_matrix(q) @ ((1.0 - e) * pressure), rtol=1e-9)
    moved = q + np.array([1e-3, 0.05, -0.05])
    there, _ = learner.chambers.force(values, moved, pressure)
    np.testing.assert_allclose(force + by_q @ (moved - q), there, rtol=2e-2)
    # The filter gets it as a tangent.
    told = Learned(np.zeros(15)).with_force(q, force, by_q, learner.force.scales)
    near = learner.force.with_mass(told, moved, np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(near, force + by_q @ (moved - q), rtol=1e-9)


def test_gains_keep_a_share_of_each_chamber():
    learner, state = taught(with_chambers((1.0, 0.02, 1.0)), ticks=600)
    for q in ([0.0, 0.0, 0.0], [0.5, 30.0, -30.0]):
        gains = learner.chambers.factor(state.chambers, np.array(q))
        assert (gains >= 0.2).all()
        assert (gains <= 4.0).all()


def test_a_slope_has_the_name_of_its_link():
    link = fields(FILE.links[0])
    robot = FILE.replace(links=[{k: v for k, v in link.items() if k != "chambers"}, link])
    names = Learner(SoftArm(robot), LearnerConfig()).chambers.names
    assert names == (*(f"link1/chamber{j}/gain" for j in range(3)), "link1/area_slope")
