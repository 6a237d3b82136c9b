"""Damping that differs from the file: how it is learned, kept, and forgotten."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot, robot_from_dict
from soro_core.adaptation import Learned, Learner, LearnerSample
from soro_core.adaptation.config import LearnerConfig
from soro_core.adaptation.damping import damping_model
from soro_core.adaptation.kept import keep
from soro_core.adaptation.kernel.information import LearningRule, gain
from soro_core.config import find_config
from soro_core.control.laws.composite import CompositeOptions
from soro_core.estimation.config import EstimatorConfig
from soro_core.estimation.filter import Filter
from soro_core.estimation.learned_input import LearnedInput
from soro_core.robot.parts import fields

FILE = load_robot(find_config("tue_three_bellow", "robots"))
ARM = SoftArm(FILE)
DT = 0.005


def with_damping(stretch_s, bend_s):
    """The file's robot with so much more damping over stiffness."""
    stiffness = np.diag(ARM.stiffness_matrix(np.zeros(3)))
    more = stiffness * [stretch_s, bend_s, bend_s]
    link = fields(FILE.links[0])
    return FILE.replace(links=[link | {"damping": tuple(np.add(link["damping"], more))}])


@pytest.mark.parametrize("order", [1, 2])
def test_at_its_bound_the_damping_of_a_taper_still_takes_energy(order):
    """Along a taper the stiffness couples the coefficients of a strain; the damping of the file does not."""
    varies = {"basis": "legendre", "order": order}
    link = {
        "length": 0.2,
        "density": 1070.0,
        "material": {"youngs_modulus": 3e5, "shear_modulus": 1e5},
        "sections": [{"place": 0.0, "radius": 0.012}, {"place": 0.2, "radius": 0.006}],
        "strains": {"bending_x": varies, "bending_y": varies, "elongation": {}},
        "damping": [*[1e-4] * (2 * order + 2), 0.5],
        "chambers": [{"angle_rad": a, "area_m2": 2e-5, "offset_m": 4e-3} for a in (0.0, 2.1, 4.2)],
    }
    arm = SoftArm(robot_from_dict({"links": [link]}))
    model, damping = damping_model(arm), arm.damping_matrix()
    least = damping + model.lower[model.number][:, None] * model.matrix
    assert np.linalg.eigvalsh(least).min() > 0.09 * np.linalg.eigvalsh(damping).min()


def taught(true, ticks=1600, forget_at=None, **keys):
    """A learner of the file's arm that has seen the true one swing, with what it learns at each tick."""
    arm = SoftArm(true)
    learner = Learner(ARM, LearnerConfig(**keys))
    state, none, found = learner.initial_state(), np.zeros(ARM.n_internal), []
    for k in range(ticks):
        t = DT * k
        q = np.array([0.06 + 0.03 * np.sin(1.4 * t), 6.0 * np.cos(4.0 * t), 6.0 * np.sin(4.0 * t)])
        qd = np.array([0.042 * np.cos(1.4 * t), -24.0 * np.sin(4.0 * t), 24.0 * np.cos(4.0 * t)])
        qdd = np.array([-0.0588 * np.sin(1.4 * t), -96.0 * np.cos(4.0 * t), -96.0 * np.sin(4.0 * t)])
        force = arm.inverse_dynamics(q, qd, qd, qdd) + arm.elastic_force(q) + arm.damping_force(q, qd)
        pressure = np.linalg.solve(arm.actuation_matrix(q), force)
        state = learner.step(state, LearnerSample(q, qd, pressure, none, 1e-8 * np.eye(3)), DT)
        found.append(state.learned.damping_s(3))
    return learner, state, np.array(found)


def test_damping_far_from_the_file_is_found():
    learner, state, found = taught(with_damping(0.5, 0.2))
    print(found[-1], learner.deviations(state)[13:15])
    np.testing.assert_allclose(found[-1], [0.5, 0.2], rtol=0.15)
    assert learner.names[13:15] == ("link0/stretch_damping", "link0/bend_damping")


def test_damping_that_is_right_stays():
    critical_s = Learner(ARM, LearnerConfig()).force.damping.critical_s
    found = taught(FILE)[2]
    print(np.abs(found).max(axis=0) / critical_s)
    assert (np.abs(found).max(axis=0) < 0.05 * critical_s).all()


def test_some_of_the_files_damping_stays_whatever_pressures_say():
    learner = Learner(ARM, LearnerConfig())
    first = np.diag(ARM.damping_matrix()) / np.diag(ARM.stiffness_matrix(np.zeros(3)))
    assert (learner.lower[13:15] > -first[:2]).all()
    assert (learner.upper[13:15] == 3.0).all()


def test_the_learned_damping_is_that_of_an_arm_with_more():
    theta = np.concatenate([np.zeros(13), [0.5, 0.2]])
    qd = np.array([0.3, 20.0, -10.0])
    found = Learner(ARM, LearnerConfig()).force.force(Learned(theta), np.zeros(3), qd, np.zeros(3))
    more = SoftArm(with_damping(0.5, 0.2)).damping_matrix() - ARM.damping_matrix()
    np.testing.assert_allclose(found, more @ qd, rtol=1e-9)


@pytest.mark.parametrize("bend_s", [0.02, 0.2, 3.0])
def test_the_filter_predicts_as_that_of_an_arm_with_more_damping(bend_s):
    """Implicitly: 3 s are 7,500 times the file's, and no step diverges."""
    learned = LearnedInput(Learned(np.concatenate([np.zeros(13), [bend_s, bend_s]])), 0.0, 1.0)
    process = EstimatorConfig().process.model_dump()
    config = EstimatorConfig(learned_process=process)  # noise and fading alike with and without a force
    told, true = (Filter(SoftArm(robot), config) for robot in (FILE, with_damping(bend_s, bend_s)))
    start = np.concatenate([[0.05, 4.0, -3.0, 0.1, 20.0, -30.0], np.zeros(6)])
    found = []
    for filter_, known in ((told, learned), (true, LearnedInput())):
        belief = filter_.start()._replace(mean=start)
        for _ in range(100):
            belief, ok = filter_.predict(belief, np.full(3, 3e4), DT, known)
            assert ok
        found.append(belief)
    np.testing.assert_allclose(found[0].mean, found[1].mean, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found[0].covariance, found[1].covariance, rtol=1e-4, atol=1e-9)
    # What is no longer learned leaves nothing behind.
    again = told.predict(told.start()._replace(mean=start), np.full(3, 3e4), DT)[0]
    fresh = Filter(ARM, config).predict(told.start()._replace(mean=start), np.full(3, 3e4), DT)[0]
    np.testing.assert_array_equal(again.mean, fresh.mean)


def test_what_lasts_keeps_its_own_information_while_the_rest_is_forgotten():
    rng, n, far = np.random.default_rng(1), 3, np.full(2, 9.0)
    order = np.array([0, 1, 4, 5, 2, 3])
    rest, last = np.ix_(order[:-2], order[:-2]), np.ix_(order[-2:], order[-2:])
    spread = rng.standard_normal((6, 6))
    prior = np.diag(rng.uniform(0.5, 2.0, 6))
    information = prior + spread @ spread.T
    moment = rng.standard_normal(6)
    regressor, residual = np.zeros((n, 6)), np.zeros(n)  # a sample that says nothing
    dt, theta, after = 1e-4, np.linalg.solve(information, moment), (np.empty((6, 6)), np.empty(6))
    rule = LearningRule(5.0, 1.0, 1e4, 8.0, 0.0, prior, np.eye(n), np.zeros((n, n)), order, -far, far)
    assert gain(rule[:], dt, np.zeros((n, n)), (residual, regressor), (information, moment, *after), theta)
    np.testing.assert_allclose(information @ theta, moment)
    own = [np.linalg.inv(np.linalg.inv(one)[last]) for one in (information, after[0])]
    known = [one[rest] - prior[rest] for one in (information, after[0])]
    np.testing.assert_allclose(known[1], (1.0 - dt) * known[0], rtol=1e-9)
    np.testing.assert_allclose(own[1], own[0], rtol=1e-6)
    kept = [np.linalg.solve(a, b)[order[-2:]] for a, b in ((information, moment), after)]
    np.testing.assert_allclose(kept[1], kept[0], rtol=1e-6)


def test_damping_is_kept_for_the_next_run():
    learner, state, found = taught(with_damping(0.5, 0.2))
    theta = np.concatenate([state.learned.theta, state.chambers])
    names = dict(zip(learner.names, theta.tolist(), strict=True))
    kept = keep(FILE, names, dict.fromkeys(names, 0.1))
    start = Learner(ARM, CompositeOptions(learned=kept), kept=kept).initial_state()
    np.testing.assert_allclose(start.learned.damping_s(3), found[-1], rtol=1e-6)
    assert start.learned.mass_kg == 0.0
