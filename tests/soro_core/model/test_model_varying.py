"""Links of varying strain: Magnus steps and the articulated chain against energies and differences."""

import numpy as np
import pytest

from soro_core import SoftArm, robot_from_dict
from soro_core.robot.basis import strain_rows

STRAINS = {
    "bending_x": {"basis": "legendre", "order": 3},
    "torsion": {"basis": "constant"},
    "elongation": {"basis": "chebyshev", "order": 2},
    "bending_y": {"basis": "legendre", "order": 2},
    "shear_x": {"basis": "constant"},
}
SCALE = {"bending_x": 5.0, "bending_y": 5.0, "torsion": 4.0, "elongation": 0.05, "shear_x": 0.05}
MATERIAL = {"youngs_modulus": 1e6, "shear_modulus": 4e5, "viscosity": 100.0}
STEP = 1e-6


def robot(n_links=2, strains=STRAINS):
    link = {
        "length": 0.2 / n_links,
        "radius": 0.01,
        "density": 1100.0,
        "material": MATERIAL,
        "strains": strains,
    }
    return robot_from_dict(
        {"links": [link] * n_links, "tip_mass": 0.01, "base_quaternion": [0.5, 0.5, 0.5, 0.5]}
    )


def state(description, seed):
    scale = np.concatenate([[SCALE[name] for name in strain_rows(link)] for link in description.links])
    return np.random.default_rng(seed).normal(size=(2, description.n_q)) * scale


def slope(function, q):
    """Derivative of a function of q along every coordinate, first axis."""
    return np.array([(function(q + STEP * e) - function(q - STEP * e)) / (2 * STEP) for e in np.eye(len(q))])


@pytest.fixture(scope="module")
def arm():
    return SoftArm(robot(), nodes=10)


@pytest.mark.parametrize("seed", range(3))
def test_inertia_and_coriolis_are_those_of_one_kinetic_energy(arm, seed):
    q, qd = state(arm.robot, seed)
    M, C = arm.inertia_matrix(q), arm.coriolis_matrix(q, qd)
    assert np.array_equal(M, M.T)
    assert np.linalg.eigvalsh(M).min() > 0.0
    rates = slope(arm.inertia_matrix, q)
    along = (arm.inertia_matrix(q + STEP * qd) - arm.inertia_matrix(q - STEP * qd)) / (2 * STEP)
    skew = along - 2 * C
    assert np.abs(skew + skew.T).max() < 1e-7 * np.abs(along).max()
    christoffel = along @ qd - 0.5 * np.einsum("ijk,j,k->i", rates, qd, qd)
    np.testing.assert_allclose(arm.coriolis_force(q, qd), christoffel, atol=1e-6 * np.abs(christoffel).max())
    np.testing.assert_allclose(C @ qd, arm.coriolis_force(q, qd), atol=1e-13 * np.abs(christoffel).max())


@pytest.mark.parametrize("seed", range(3))
def test_gravity_elasticity_and_jacobian_are_derivatives(arm, seed):
    q, _ = state(arm.robot, seed)
    rest = np.zeros(arm.n_q)
    for part, force in ((1, arm.gravity_force(q)), (2, arm.elastic_force(q))):
        np.testing.assert_allclose(
            force, slope(lambda x, part=part: arm.energy(x, rest)[part], q), atol=1e-6 * np.abs(force).max()
        )
    for s in (0.0, 0.03, 0.1, 0.17, 0.2):
        inverse = np.linalg.inv(arm.pose(q, s))
        twists = inverse @ slope(lambda x, s=s: arm.pose(x, s), q)
        rows = [twists[:, 2, 1], twists[:, 0, 2], twists[:, 1, 0], *twists[:, :3, 3].T]
        np.testing.assert_allclose(arm.jacobian(q, s), rows, atol=1e-7)


def test_forward_dynamics_solves_the_equation_of_motion(arm):
    q, qd = state(arm.robot, 5)
    bias = arm.coriolis_force(q, qd) + arm.gravity_force(q) + arm.elastic_force(q) + arm.damping_force(q, qd)
    residual = arm.inertia_matrix(q) @ arm.forward_dynamics(q, qd, []) + bias
    assert np.abs(residual).max() < 1e-10 * np.abs(bias).max()


def test_magnus_steps_are_of_fourth_order():
    description = robot(1)
    q, _ = state(description, 1)
    right = SoftArm(description, nodes=96).pose(q, 0.2)
    nodes = np.array([12, 16, 24, 32])
    errors = [np.abs(SoftArm(description, nodes=int(n)).pose(q, 0.2) - right).max() for n in nodes]
    order = -np.polyfit(np.log(nodes), np.log(errors), 1)[0]
    assert order == pytest.approx(4.0, abs=0.35)  # the nodes are not equally spaced


def test_mde_converges_to_the_same_arm(arm):
    q, qd = state(arm.robot, 2)
    right = SoftArm(arm.robot, nodes=48).coriolis_force(q, qd)
    errors = [
        np.abs(SoftArm(arm.robot, method="mde", steps=n).coriolis_force(q, qd) - right).max()
        for n in (80, 160)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_constant_strain_by_magnus_steps_is_the_closed_form():
    closed = SoftArm(robot(2, {"bending_x": {}, "bending_y": {}, "elongation": {}}), nodes=8)
    fields = {name: {"basis": "legendre", "order": 0} for name in ("bending_x", "bending_y", "elongation")}
    stepped = SoftArm(robot(2, fields), nodes=8)
    q, qd = np.array([[8.0, -5.0, 0.1, 3.0, 9.0, -0.1], [1.0, 2.0, 0.3, -4.0, 5.0, 0.6]])
    for name, arguments in (
        ("inertia_matrix", (q,)),
        ("coriolis_force", (q, qd)),
        ("gravity_force", (q,)),
        ("forward_dynamics", (q, qd, [])),
    ):
        want = getattr(closed, name)(*arguments)
        np.testing.assert_allclose(
            getattr(stepped, name)(*arguments), want, atol=1e-11 * np.abs(want).max(), rtol=1e-9
        )
