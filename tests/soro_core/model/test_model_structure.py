"""Properties that must hold for every robot, state and strain set."""

import numpy as np
import pytest
from hypothesis import given
from sample_arms import SETTINGS, random_robot, random_state, seeds
from scipy.linalg import block_diag

from soro_core import SoftArm
from soro_core._jit import kernel
from soro_core.model.links.lie import stumpff, tangent_coefficients
from soro_core.robot import link_stiffness, shear_factors


def inertia_rate(arm, q, qd, step=1e-5):
    """Mdot along qd, central differences of order 4."""

    def M(h):
        return arm.inertia_matrix(q + h * qd)

    step /= 1 + np.linalg.norm(qd, np.inf)
    return (8 * (M(step) - M(-step)) - (M(2 * step) - M(-2 * step))) / (12 * step)


@SETTINGS
@given(seed=seeds)
def test_inertia_is_symmetric_positive_definite(seed):
    robot = random_robot(seed)
    M = SoftArm(robot).inertia_matrix(random_state(robot, seed)[0])
    np.testing.assert_array_equal(M, M.T)
    scale = 1 / np.sqrt(np.diag(M))
    assert np.linalg.eigvalsh(scale[:, None] * M * scale).min() > 0


@pytest.mark.parametrize("method", ["exact", "mde"])
@SETTINGS
@given(seed=seeds)
def test_kinetic_energy_is_that_of_the_inertia_matrix(method, seed):
    robot = random_robot(seed)
    arm = SoftArm(robot, method=method)
    q, qd = random_state(robot, seed)
    want = 0.5 * qd @ arm.inertia_matrix(q) @ qd
    assert arm.energy(q, qd)[0] == pytest.approx(want, rel=1e-10)


@SETTINGS
@given(seed=seeds)
def test_inertia_rate_minus_twice_coriolis_is_skew(seed):
    robot = random_robot(seed)
    arm = SoftArm(robot)
    q, qd = random_state(robot, seed)
    x = np.random.default_rng(seed + 2).normal(size=arm.n_q) * np.abs(qd)
    C = arm.coriolis_matrix(q, qd)
    Mdot = inertia_rate(arm, q, qd)
    scale = np.abs(x) @ (np.abs(Mdot) + 2 * np.abs(C)) @ np.abs(x)
    assert abs(x @ (Mdot - 2 * C) @ x) < 1e-8 * scale


@SETTINGS
@given(seed=seeds)
def test_coriolis_force_is_that_of_christoffel(seed):
    robot = random_robot(seed, n_links=2)
    arm = SoftArm(robot)
    q, qd = random_state(robot, seed)
    n, step = arm.n_q, 1e-4
    dM = np.empty((n, n, n))
    for k, e in enumerate(np.eye(n)):

        def M(h, e=e):
            return arm.inertia_matrix(q + h * e)

        dM[k] = (8 * (M(step) - M(-step)) - (M(2 * step) - M(-2 * step))) / (12 * step)
    want = np.einsum("kij,k,j->i", dM, qd, qd) - 0.5 * np.einsum("ijk,j,k->i", dM, qd, qd)
    got = arm.coriolis_force(q, qd)
    assert np.abs(got - want).max() < 1e-7 * np.abs(want).max()


@SETTINGS
@given(seed=seeds)
def test_forces_are_gradients_of_the_energies(seed):
    robot = random_robot(seed)
    arm = SoftArm(robot)
    q, _ = random_state(robot, seed)
    rest, step = np.zeros(arm.n_q), 1e-4

    def gradient(part):
        def U(h, e):
            return arm.energy(q + h * e, rest)[part]

        return np.array(
            [
                (8 * (U(step, e) - U(-step, e)) - (U(2 * step, e) - U(-2 * step, e))) / (12 * step)
                for e in np.eye(arm.n_q)
            ]
        )

    for part, force in ((1, arm.gravity_force(q)), (2, arm.elastic_force(q))):
        want = gradient(part)
        assert np.abs(force - want).max() < 1e-7 * np.abs(want).max() + 1e-10


@SETTINGS
@given(seed=seeds)
def test_stiffness_is_the_gradient_of_the_elastic_force(seed):
    robot = random_robot(seed)
    arm = SoftArm(robot)
    q, _ = random_state(robot, seed)
    step = 1e-5
    K = np.array(
        [
            (arm.elastic_force(q + step * e) - arm.elastic_force(q - step * e)) / (2 * step)
            for e in np.eye(arm.n_q)
        ]
    )
    np.testing.assert_allclose(arm.stiffness_matrix(q), K, rtol=1e-6, atol=1e-6 * np.abs(K).max())


@pytest.mark.slow
@SETTINGS
@given(seed=seeds)
def test_jacobian_is_the_body_twist_of_the_pose(seed):
    robot = random_robot(seed)
    q, _ = random_state(robot, seed)
    place = np.random.default_rng(seed).uniform(0, robot.length)
    step = 1e-5
    for arm in (SoftArm(robot), SoftArm(robot, method="mde", steps=150)):
        for s in (0.0, place, arm.length):
            J, g = arm.jacobian(q, s), arm.pose(q, s)
            for column, e in enumerate(np.eye(arm.n_q)):
                rate = (arm.pose(q + step * e, s) - arm.pose(q - step * e, s)) / (2 * step)
                twist = np.linalg.inv(g) @ rate
                angular = 0.5 * np.array(
                    [twist[2, 1] - twist[1, 2], twist[0, 2] - twist[2, 0], twist[1, 0] - twist[0, 1]]
                )
                want = np.concatenate([angular, twist[:3, 3]])
                np.testing.assert_allclose(J[:, column], want, atol=1e-9 if arm.method == "exact" else 2e-5)


@pytest.mark.parametrize("tiny", [0.0, 1e-300, 1e-12, 1e-6])
def test_smooth_through_zero_curvature(tiny):
    """Value and derivative at almost no curvature are those of the straight arm, to first order in it."""
    robot = random_robot(11, n_links=2)
    arm = SoftArm(robot)
    qd = random_state(robot, 3)[1]
    direction = random_state(robot, 5)[0]
    q = tiny * direction
    straight = np.zeros(arm.n_q)
    for got, want in (
        (arm.inertia_matrix(q), arm.inertia_matrix(straight)),
        (arm.coriolis_matrix(q, qd), arm.coriolis_matrix(straight, qd)),
        (arm.gravity_force(q), arm.gravity_force(straight)),
        (arm.elastic_force(q), arm.elastic_force(straight)),
        (arm.pose(q, arm.length), arm.pose(straight, arm.length)),
        (arm.jacobian(q, arm.length), arm.jacobian(straight, arm.length)),
    ):
        assert np.isfinite(got).all()
        np.testing.assert_allclose(got, want, atol=30 * tiny * np.abs(want).max() + 3000 * tiny + 1e-15)


@kernel
def stumpff_and_tangent(y, c, a):
    stumpff(y, c)
    tangent_coefficients(c, a)


def test_series_and_closed_form_meet():
    """The Stumpff functions take one form below y = 4 and another above: no step between them."""
    values = []
    for y in (4 * (1 - 1e-15), 4.0):
        c, a = np.empty(8), np.empty(10)
        stumpff_and_tangent(y, c, a)
        values.append(np.concatenate([c, a]))
    np.testing.assert_allclose(values[0], values[1], rtol=1e-12)


@SETTINGS
@given(seed=seeds)
def test_regressors_are_the_change_with_each_parameter(seed):
    robot = random_robot(seed, n_links=2)
    arm = SoftArm(robot)
    q, qd = random_state(robot, seed)
    rng = np.random.default_rng(seed)
    v, a = rng.normal(size=(2, arm.n_q)) * 10

    def force(changed):
        return SoftArm(changed).inverse_dynamics(q, qd, v, a)

    Y = arm.mass_regressor(q, qd, v, a)
    masses = np.array([robot.tip_mass, *(link.mass for link in robot.links)])
    np.testing.assert_allclose(Y @ masses, force(robot), rtol=1e-9, atol=1e-12)
    heavier = robot.replace(tip_mass=robot.tip_mass + 0.3)
    np.testing.assert_allclose(force(heavier) - force(robot), 0.3 * Y[:, 0], rtol=1e-7, atol=1e-10)
    want = arm.inertia_matrix(q) @ a + arm.coriolis_matrix(q, qd) @ v + arm.gravity_force(q)
    np.testing.assert_allclose(arm.inverse_dynamics(q, qd, v, a), want, rtol=1e-9, atol=1e-11)

    Y = arm.elastic_regressor(q)
    parts = zip(robot.links, shear_factors(robot), strict=True)
    known = block_diag(*[link_stiffness(link, factor) for link, factor in parts]) @ q
    pi = np.concatenate([[law[0], law[1], law[3], law[4]] for law in arm.tables.law])
    np.testing.assert_allclose(Y @ pi + known, arm.elastic_force(q), rtol=1e-10, atol=1e-14)
