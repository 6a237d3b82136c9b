"""The non-uniform strain of a link under load: the unmodelled force of constant strains, and who gets it."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.adaptation import Learned, Learner, LearnerSample
from soro_core.adaptation.config import LearnerConfig
from soro_core.adaptation.scales import scales_of
from soro_core.config import find_config, parse
from soro_core.control import Controller, ControllerConfig, Point
from soro_core.control.laws.protocol import ArmBelief, Preview
from soro_core.control.nonuniform_strain import NonuniformStrain, has_nonuniform_strain
from soro_core.model.discretised import discretised
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Discretisation
from soro_core.robot.parts import fields

ROBOT = load_robot(find_config("tue_three_bellow", "robots"))
ARM = SoftArm(ROBOT)
UNIT = scales_of(ARM).force
BENT = np.array([0.07, -6.0, 3.0])
LOAD_KG = 0.01


def still(q):
    return Point(q, np.zeros(3), np.zeros(3))


def found(q, mass_kg):
    nonuniform = NonuniformStrain(ARM)
    state = nonuniform.initial_state()
    for _ in range(16):  # finds every slope anew
        state, force = nonuniform.step(state, still(q), mass_kg)
    return force


def at_rest(arm, q, mass_kg):
    zero = np.zeros(arm.n_q)
    return arm.gravity_force(q) + arm.elastic_force(q) + mass_kg * arm.tip_mass_force(q, zero, zero)


def test_a_finer_arm_rests_where_the_coordinates_put_its_tip():
    pieces = 8
    finer = SoftArm(ROBOT.replace(tip_mass=LOAD_KG).refine(pieces))
    wanted = ARM.pose(BENT, ARM.length)[:3, 3]

    def beside(force):
        pressure = np.linalg.solve(ARM.actuation_matrix(BENT), force)
        q = equilibrium(finer, pressure, np.tile(BENT, pieces))
        return float(np.linalg.norm(finer.pose(q, finer.length)[:3, 3] - wanted))

    even = at_rest(ARM, BENT, LOAD_KG)
    with_it, without = beside(even + found(BENT, LOAD_KG).force), beside(even)
    print(f"beside: {1e3 * with_it:.3f} mm, {1e3 * without:.2f} mm with constant strains")
    assert with_it < 0.2e-3
    assert without > 1e-3


def test_its_pressures_accelerate_the_uneven_arm_as_wanted():
    nonuniform, wanted = (
        NonuniformStrain(ARM),
        Point(BENT, np.array([0.1, -10.0, 5.0]), np.array([1.0, 200.0, -100.0])),
    )
    state = nonuniform.initial_state()
    for _ in range(16):
        state, unmodelled = nonuniform.step(state, wanted, 0.0)
    q, qd, qdd = wanted.q, wanted.qd, wanted.qdd
    even = ARM.inverse_dynamics(q, qd, qd, qdd) + ARM.elastic_force(q)
    pressure = np.linalg.solve(ARM.actuation_matrix(q), even + unmodelled.force)
    x = nonuniform.spread @ q + state.deviation
    made = nonuniform.varying.forward_dynamics(x, state.moves @ qd, pressure)
    expected = state.moves @ qdd
    np.testing.assert_allclose(made / nonuniform.varying_unit, expected / nonuniform.varying_unit, atol=0.05)
    assert np.abs(expected / nonuniform.varying_unit).max() > 10.0


def test_its_changes_by_mass_and_coordinates_are_differences():
    force, h = found(BENT, LOAD_KG), 1e-4
    by_mass = (found(BENT, LOAD_KG + h).force - found(BENT, LOAD_KG - h).force) / (2.0 * h)
    np.testing.assert_allclose(force.by_mass / UNIT, by_mass / UNIT, atol=1e-3)
    for k, step in enumerate(np.diag(h * scales_of(ARM).q)):
        by_q = (found(BENT + step, LOAD_KG).force - found(BENT - step, LOAD_KG).force) / (2.0 * h)
        np.testing.assert_allclose(force.by_q[:, k] * scales_of(ARM).q[k] / UNIT, by_q / UNIT, atol=1e-4)


def test_one_step_a_tick_follows_a_line():
    nonuniform = NonuniformStrain(ARM)
    state = nonuniform.initial_state()
    for k in range(200):
        q = np.array([0.06, -7.0 + 0.07 * k, 0.0])
        state, force = nonuniform.step(state, still(q), 2.0 * LOAD_KG)
    np.testing.assert_allclose(force.force / UNIT, nonuniform.away(still(q), 2.0 * LOAD_KG) / UNIT, atol=0.01)
    assert np.abs(force.force / UNIT).max() > 0.5


def test_a_mass_far_beyond_the_arm_leaves_a_bounded_shape():
    nonuniform = NonuniformStrain(ARM)
    state = nonuniform.initial_state()
    for _ in range(60):
        state, force = nonuniform.step(state, still(BENT), 0.5)
        assert np.isfinite(force.force).all()
    assert np.abs(state.deviation / nonuniform.varying_unit).max() <= 2.0


@pytest.mark.parametrize(
    ("robot", "model", "bends"),
    [
        ("tue_three_bellow", Discretisation(), True),
        ("tue_three_bellow", Discretisation(basis="legendre", order=1), False),
        ("tue_three_bellow", Discretisation(links=2), False),  # six coordinates, three chambers
        ("six_link", Discretisation(), False),
    ],
)
def test_it_is_of_arms_whose_chambers_and_link_ends_determine_constant_strains(robot, model, bends):
    assert has_nonuniform_strain(discretised(load_robot(find_config(robot, "robots")), model)) is bends


def test_a_strain_that_varies_bends_by_itself():
    mode = {"basis": "pod", "samples": [[1.2], [1.1], [0.9], [0.8]]}
    link = {**fields(ROBOT.links[0]), "damping": None, "creep": []}
    arm = SoftArm(ROBOT.replace(links=[{**link, "strains": dict.fromkeys(ROBOT.links[0].strains, mode)}]))
    assert arm.n_q == 3
    assert not has_nonuniform_strain(arm)


def circling(nonuniform, state, k):
    """The sample of an arm with a load on a circle, and what the law knows at a mass of 0."""
    q = np.array([0.07, 10.0 * np.cos(0.02 * k), 10.0 * np.sin(0.02 * k)])
    state, known = nonuniform.step(state, still(q), 0.0)
    force = at_rest(ARM, q, LOAD_KG) + nonuniform.away(still(q), LOAD_KG) if k % 20 == 0 else None
    return q, state, known, force


def test_the_learner_finds_the_mass_of_an_uneven_arm():
    """Constant strains take the non-uniform strain for a heavier load and a W of the circle."""
    nonuniform, learner = NonuniformStrain(ARM), Learner(ARM, LearnerConfig(noise=0.05, forget_s=1e3))
    masses, none = [], np.zeros(ARM.n_internal)
    for told in (True, False):
        shape, state = nonuniform.initial_state(), learner.initial_state()
        for k in range(315):
            q, shape, known, force = circling(nonuniform, shape, k)
            if force is None:
                continue
            pressure = np.linalg.solve(ARM.actuation_matrix(q), force)
            at = LearnerSample(q, np.zeros(3), pressure, none, np.zeros((3, 3)), known if told else None)
            state = learner.step(state, at, 0.1)
        masses.append(state.learned.mass_kg)
    print(f"masses: {1e3 * masses[0]:.2f} g told, {1e3 * masses[1]:.2f} g not told, {1e3 * LOAD_KG:g} g true")
    assert abs(masses[0] - LOAD_KG) < 0.1 * LOAD_KG
    assert abs(masses[1] - LOAD_KG) > 0.2 * LOAD_KG


def test_the_filter_gets_its_tangent():
    controller = Controller(ROBOT, parse({"law": "composite"}, ControllerConfig, "test"))
    law, none = controller.law, np.zeros(3)
    point = controller.configured.sample(1.0)
    belief = ArmBelief(point.q, point.qd, None, True, np.zeros(ARM.n_internal), none, none > 0.0)
    state = law.initial_state()
    theta = np.concatenate([[LOAD_KG], np.linspace(-1.0, 1.0, 12), np.zeros(2)])
    learner = replace(state.learner, learned=Learned(theta))
    state = replace(state, learner=learner)
    state, _, terms = law.step(state, belief, Preview(point, point, 0.0), 0.005)
    at, learned = state.unmodelled.q, law.learner.force
    given, own = (learned.force(x, at, none, none) for x in (law.learned(state), learner.learned))
    np.testing.assert_allclose((given - own) / UNIT, terms["uneven"] / UNIT, atol=1e-9)
    assert np.abs(terms["uneven"] / UNIT).max() > 0.5
    assert law.learned(state).mass_kg == LOAD_KG


def test_a_plan_takes_it_where_the_path_is():
    controller = Controller(ROBOT, parse({"law": "composite"}, ControllerConfig, "test"))
    state, zero = controller.law.initial_state(), np.zeros(3)
    force = controller.law.reference_force(state, BENT, zero, zero)
    np.testing.assert_allclose(
        force / UNIT, (at_rest(ARM, BENT, 0.0) + found(BENT, 0.0).force) / UNIT, atol=1e-3
    )


def test_without_the_key_the_law_has_none():
    config = parse(
        {"law": "composite", "law_options": {"nonuniform_strain": False}}, ControllerConfig, "test"
    )
    controller = Controller(ROBOT, config)
    zero = np.zeros(3)
    force = controller.law.reference_force(controller.law.initial_state(), BENT, zero, zero)
    np.testing.assert_allclose(force / UNIT, at_rest(ARM, BENT, 0.0) / UNIT, atol=1e-12)
