"""The two methods against each other, and the front's refusals."""

import numpy as np
import pytest
from sample_arms import chambers, law_link, random_robot, random_state

from soro_core import SoftArm, robot_from_dict
from soro_core.errors import ModelError
from tests.refused import fails


@pytest.mark.parametrize("term", ["inertia_matrix", "coriolis_matrix", "gravity_force", "pose"])
def test_mde_converges_to_exact_with_order_two(term):
    robot = random_robot(4, n_links=3)
    q, qd = random_state(robot, 4)

    def value(arm):
        if term == "coriolis_matrix":
            return arm.coriolis_matrix(q, qd)
        return arm.pose(q, arm.length) if term == "pose" else getattr(arm, term)(q)

    want = value(SoftArm(robot, nodes=20))
    steps = (64, 128, 256)
    errors = [np.abs(value(SoftArm(robot, method="mde", steps=n)) - want).max() for n in steps]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(2.0, abs=0.1), (errors, orders)


def test_default_nodes_are_enough_for_a_half_circle():
    robot = robot_from_dict({"links": [law_link(np.random.default_rng(0))] * 2})
    q = np.tile([0.1, np.pi / robot.links[0].length, 5.0], 2)
    qd = np.ones(6)
    coarse, fine = SoftArm(robot), SoftArm(robot, nodes=24)
    for name, arguments in (("inertia_matrix", (q,)), ("coriolis_matrix", (q, qd)), ("gravity_force", (q,))):
        got, want = getattr(coarse, name)(*arguments), getattr(fine, name)(*arguments)
        assert np.abs(got - want).max() < 1e-8 * np.abs(want).max()


def test_forward_dynamics_solves_the_equation_of_motion():
    rng = np.random.default_rng(8)
    link = law_link(
        rng,
        chambers=chambers(rng, area_slope=-3.0),
        damping=[0.1, 1e-5, 2e-5],
        creep=[{"tau": 0.02, "stiffness": [10.0, 1e-3, 1e-3]}],
        hysteresis=[{"stiffness": [5.0, 1e-4, 1e-4], "range": [0.01, 1.0, 1.0]}],
    )
    robot = robot_from_dict({"links": [link, law_link(rng)], "tip_mass": 0.03})
    arm = SoftArm(robot)
    q, qd = random_state(robot, 2)
    p, z, w = rng.uniform(0, 5e4, 3), rng.normal(size=arm.n_internal) * 0.1, rng.normal(size=6)
    qdd = arm.forward_dynamics(q, qd, p, wrench=w, internal=z)
    left = (
        arm.inertia_matrix(q) @ qdd
        + arm.coriolis_force(q, qd)
        + arm.gravity_force(q)
        + arm.elastic_force(q)
        + arm.damping_force(q, qd)
        + arm.internal_force(q, z)
    )
    right = arm.actuation_matrix(q) @ p + arm.jacobian(q, arm.length).T @ w
    np.testing.assert_allclose(left, right, atol=1e-9 * np.abs(right).max())
    mde = SoftArm(robot, method="mde", steps=400).forward_dynamics(q, qd, p, wrench=w, internal=z)
    np.testing.assert_allclose(mde, qdd, atol=2e-3 * np.abs(qdd).max())


def test_chamber_signs():
    """A chamber pushes the arm away from itself: at +x it bends the tip towards -x, at +y towards -y."""
    for angle, axis in ((0.0, 0), (np.pi / 2, 1)):
        link = law_link(
            np.random.default_rng(0), chambers=[{"angle_rad": angle, "area_m2": 2e-5, "offset_m": 0.01}]
        )
        arm = SoftArm(robot_from_dict({"links": [link]}))
        H = arm.actuation_matrix(np.zeros(3))[:, 0]
        L = link["length"]
        np.testing.assert_allclose(
            H, [2e-5 * L, -2e-7 * L * np.cos(angle), -2e-7 * L * np.sin(angle)], atol=1e-20
        )
        tip = arm.pose(H / np.abs(H).max() * 3, arm.length)[:3, 3]
        assert tip[axis] < -1e-6


def test_chamber_force_is_the_gradient_of_its_volume():
    rng = np.random.default_rng(1)
    robot = robot_from_dict({"links": [law_link(rng, chambers=chambers(rng, area_slope=-2.5))]}).refine(2)
    arm = SoftArm(robot)
    q, _ = random_state(robot, 0)
    assert (
        np.abs(arm.actuation_matrix(q) - arm.actuation_matrix()).max()
        > 0.05 * np.abs(arm.actuation_matrix()).max()
    )
    step = 1e-6
    for u in range(3):
        slope = np.array(
            [
                (arm.actuation_matrix(q + step * e)[:, u] - arm.actuation_matrix(q - step * e)[:, u])
                / (2 * step)
                for e in np.eye(arm.n_q)
            ]
        )
        np.testing.assert_allclose(slope, slope.T, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize(
    ("call", "key", "names"),
    [
        (lambda arm: arm.inertia_matrix(np.zeros(2)), "q", ("(2,)", "(3,)")),
        (lambda arm: arm.inertia_matrix([0, np.nan, 0]), "q", ("nan",)),
        (lambda arm: arm.coriolis_force(np.zeros(3), [0, np.inf, 0]), "qd", ("inf",)),
        (lambda arm: arm.gravity_force([-1.0, 0, 0]), "elongation", ("-1",)),
        (
            lambda arm: arm.forward_dynamics([-1.5, 0, 0], np.zeros(3), np.zeros(3)),
            "elongation",
            ("-1",),
        ),
        (lambda arm: arm.forward_dynamics(np.zeros(3), np.zeros(3), [0, np.nan, 0]), "p", ("nan",)),
        (lambda arm: arm.forward_dynamics(np.zeros(3), np.zeros(3), np.zeros(2)), "p", ("(2,)",)),
        (lambda arm: arm.forward_dynamics(np.zeros(3), [np.nan, 0, 0], np.zeros(3)), "qd", ("nan",)),
        (lambda arm: arm.pose(np.zeros(3), -1e-3), "s", ("0",)),
        (lambda arm: arm.jacobian(np.zeros(3), arm.length + 1e-6), "s", ("0",)),
        (lambda arm: arm.pose(np.zeros(3), float("nan")), "s", ("0",)),
        (lambda arm: arm.inertia_matrix("abc"), "q", ("3",)),
        (lambda arm: SoftArm(arm.robot, method="magic"), "method", ("exact", "mde")),
        (lambda arm: SoftArm(arm.robot, nodes=0), "nodes", ("0",)),
        (lambda arm: SoftArm(arm.robot, method="mde", steps=2.5), "steps", ("2.5",)),
    ],
)
def test_wrong_use_is_refused(call, key, names):
    rng = np.random.default_rng(0)
    arm = SoftArm(robot_from_dict({"links": [law_link(rng, chambers=chambers(rng))]}))
    with fails(ModelError, *names, key=key):
        call(arm)


def test_ends_are_clamped_within_round_off():
    arm = SoftArm(robot_from_dict({"links": [law_link(np.random.default_rng(0))] * 3}))
    q = np.tile([0.1, 3.0, -2.0], 3)
    np.testing.assert_array_equal(arm.pose(q, arm.length + 5e-10), arm.pose(q, arm.length))
    np.testing.assert_array_equal(arm.pose(q, -5e-10), arm.pose(q, 0.0))
    np.testing.assert_array_equal(arm.pose(q, 0.0), np.eye(4))
