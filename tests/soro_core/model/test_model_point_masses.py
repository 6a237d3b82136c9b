"""Point masses: their share of inertia, Coriolis force and weight, wherever they sit."""

import numpy as np
import pytest
from outside_arms import CASES, arm_of, gradient, state_of

from soro_core import SoftArm, robot_from_dict, simulate
from soro_core.errors import ConfigError, ModelError
from tests.refused import fails
from tests.small_links import LAW

MASSES = ((0.037, 0.2), (0.1, 0.05), (0.0371, 0.1))  # the second at the end of the first link


def pair(n_links, basis, masses=MASSES, **keys):
    """The same arm with the masses, and with zeros in their places: equal quadrature."""
    arms = []
    for factor in (1.0, 0.0):
        carried = [{"place": place, "mass": factor * mass} for place, mass in masses]
        arms.append(arm_of(n_links, basis, point_masses=carried, **keys))
    return arms


@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_inertia_and_weight(n_links, basis):
    heavy, light = pair(n_links, basis, gravity=[1.0, -2.0, 9.0])
    q, _ = state_of(heavy)
    M, G, U = np.zeros((heavy.n_q, heavy.n_q)), np.zeros(heavy.n_q), 0.0
    for place, mass in MASSES:
        g, J = heavy.pose(q, place), heavy.jacobian(q, place)[3:]
        M += mass * J.T @ J
        G -= mass * J.T @ g[:3, :3].T @ heavy.tables.gravity
        U -= mass * g[:3, 3] @ heavy.tables.gravity
    np.testing.assert_allclose(
        heavy.inertia_matrix(q) - light.inertia_matrix(q), M, atol=1e-11 * np.abs(M).max()
    )
    np.testing.assert_allclose(
        heavy.gravity_force(q) - light.gravity_force(q), G, atol=1e-11 * np.abs(G).max()
    )
    assert heavy.energy(q, q)[1] - light.energy(q, q)[1] == pytest.approx(U, rel=1e-9)


@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_gravity_is_the_gradient_of_its_potential(n_links, basis):
    heavy, _ = pair(n_links, basis)
    q, qd = state_of(heavy)
    slope = gradient(lambda x: heavy.energy(x, qd)[1], q)
    np.testing.assert_allclose(heavy.gravity_force(q), slope, atol=1e-7 * np.abs(slope).max())


@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_the_rate_of_inertia_less_twice_coriolis_is_skew(n_links, basis):
    heavy, _ = pair(n_links, basis)
    q, qd = state_of(heavy)
    h = 1e-6
    rate = (heavy.inertia_matrix(q + h * qd) - heavy.inertia_matrix(q - h * qd)) / (2 * h)
    skew = rate - 2 * heavy.coriolis_matrix(q, qd)
    np.testing.assert_allclose(skew + skew.T, 0.0, atol=1e-6 * np.abs(rate).max())


@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_at_the_tip_it_is_the_tip_mass(n_links, basis):
    tip = arm_of(n_links, basis, tip_mass=0.3)
    point = arm_of(n_links, basis, point_masses=[{"place": 0.1 * n_links, "mass": 0.3}])
    q, qd = state_of(tip)
    np.testing.assert_allclose(
        point.forward_dynamics(q, qd, []), tip.forward_dynamics(q, qd, []), rtol=1e-9, atol=1e-9
    )
    # Both at once add up.
    both = SoftArm(point.robot.replace(tip_mass=0.1))
    want = SoftArm(tip.robot.replace(tip_mass=0.4))
    np.testing.assert_allclose(both.inertia_matrix(q), want.inertia_matrix(q), rtol=1e-9, atol=1e-12)


def test_forward_dynamics_and_a_run_keep_their_energy():
    heavy, _ = pair(2, "legendre")
    soft = heavy.robot.links[0].material.model_dump() | {"viscosity": 0.0}
    links = [{**link.model_dump(exclude_unset=True), "material": soft} for link in heavy.robot.links]
    arm = SoftArm(heavy.robot.replace(links=links))
    result = simulate(arm, t_end=0.1, dt=5e-4, integrator="midpoint")
    assert result.status.ok, result.status
    energy = np.array([sum(arm.energy(q, v)) for q, v in zip(result.q, result.qd, strict=True)])
    kinetic = max(arm.energy(q, v)[0] for q, v in zip(result.q, result.qd, strict=True))
    assert kinetic > 0.01
    assert np.ptp(energy) < 2e-3 * kinetic


def test_regressor_is_by_the_masses_that_are_adapted():
    """Columns per kg of tip and links: a point mass belongs to none of them."""
    heavy, light = pair(2, "constant", tip_mass=0.05)
    q, qd = state_of(heavy)
    v, a = state_of(heavy, 1)
    Y = heavy.mass_regressor(q, qd, v, a)
    np.testing.assert_allclose(Y, light.mass_regressor(q, qd, v, a), rtol=1e-9, atol=1e-12)
    masses = np.array([0.05, *(link.mass for link in heavy.robot.links)])
    np.testing.assert_allclose(Y @ masses, light.inverse_dynamics(q, qd, v, a), rtol=1e-9, atol=1e-10)


def test_parts_of_a_refined_link_carry_the_same():
    heavy, _ = pair(2, "constant")
    fine = SoftArm(heavy.robot.refine(3))
    q, _ = state_of(heavy)
    expand = np.kron(np.eye(2), np.kron(np.ones((3, 1)), np.eye(6)))
    np.testing.assert_allclose(
        expand.T @ fine.inertia_matrix(expand @ q) @ expand, heavy.inertia_matrix(q), rtol=1e-7, atol=1e-12
    )


@pytest.mark.parametrize(
    ("point", "key", "allowed"),
    [
        ({"place": 0.11, "mass": 0.1}, "point_masses", "length of the arm, 0.1 m"),
        ({"place": 0.0, "mass": 0.1}, "point_masses[0].place", "greater than 0"),
        ({"place": 0.05, "mass": -0.1}, "point_masses[0].mass", "greater than or equal to 0"),
        ({"place": 0.05}, "point_masses[0].mass", "required"),
    ],
)
def test_bad_point_masses(point, key, allowed):
    with pytest.raises(ConfigError) as caught:
        robot_from_dict({"links": [LAW], "point_masses": [point]})
    assert caught.value.key == key
    assert allowed in caught.value.allowed


def test_method_mde_refuses():
    heavy, _ = pair(1, "constant", masses=((0.05, 0.1),))
    with fails(ModelError, "mde", "exact", key="point_masses"):
        SoftArm(heavy.robot, method="mde")
