"""A robot whose strains are expanded is the same physics, and what cannot be expanded is refused."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot, robot_from_dict
from soro_core.errors import ConfigError
from soro_core.robot import Discretisation, with_basis
from tests.refused import fails, refused

LINK = {
    "length": 0.1,
    "radius": 0.01,
    "mass": 0.03,
    "k_e": [800.0, 300.0, 20.0],
    "k_b": [0.02, 0.005, 0.7],
    "damping": [0.1, 1e-5, 2e-5],
    "creep": [{"tau": 0.05, "stiffness": [10.0, 1e-3, 2e-3]}],
    "chambers": [{"angle_rad": 1.0, "alpha_eps": 3e-6, "alpha_kappa": 2e-8, "area_slope": -1.5}],
}


def robot(**link):
    return robot_from_dict({"links": [{**LINK, **link}, {**LINK, **link, "length": 0.05}]})


def coefficients(values, size):
    """Uniform strain: the first coefficient of each strain."""
    q = np.zeros(len(values) * size)
    q[::size] = values
    return q


def test_uniform_strain_has_the_same_energy_and_power():
    plain, other = SoftArm(robot()), SoftArm(with_basis(robot(), "legendre", 3))
    q, qd = np.array([0.1, 5.0, -3.0, -0.05, 8.0, 2.0]), np.array([0.3, 10.0, 20.0, 0.2, 5.0, -4.0])
    many, rate = coefficients(q, 4), coefficients(qd, 4)
    np.testing.assert_allclose(other.energy(many, rate), plain.energy(q, qd), rtol=1e-9)
    z, zs = np.arange(1.0, 7.0), coefficients(np.arange(1.0, 7.0), 4)
    for power in (
        lambda arm, x, v, s: v @ arm.damping_force(x, v),
        lambda arm, x, v, s: v @ arm.internal_force(x, s),
        lambda arm, x, v, s: v @ arm.actuation_matrix(x) @ [1e4, 3e4],
    ):
        assert power(other, many, rate, zs) == pytest.approx(power(plain, q, qd, z), rel=1e-9)


def test_losses_of_varying_strain_are_those_of_many_pieces():
    """Power of a curvature rate a + b x, and of such a creep state: polynomials against 64 pieces."""
    poly, fine = SoftArm(with_basis(robot(), "legendre", 1)), SoftArm(robot().refine(64))
    x = (np.arange(64) + 0.5) / 32 - 1.0
    rate = np.zeros(poly.n_q)
    rate[2:4] = 3.0, 7.0  # bending_x of the first link
    rates = np.zeros(fine.n_q)
    rates[1 : 3 * 64 : 3] = 3.0 + 7.0 * x
    power = rates @ fine.damping_force(0 * rates, rates)
    assert rate @ poly.damping_force(0 * rate, rate) == pytest.approx(power, rel=1e-3)
    creep = rates @ fine.internal_force(0 * rates, rates)
    assert rate @ poly.internal_force(0 * rate, rate) == pytest.approx(creep, rel=1e-3)


def test_pieces_and_polynomials_go_together():
    both = Discretisation(basis="legendre", order=2, links=2).discretise(robot())
    assert len(both.links) == 4
    assert both.n_q == 4 * 9
    assert both.n_u == robot().n_u
    assert Discretisation().discretise(robot()) == robot()
    constant = Discretisation(basis="constant").discretise(load_robot("silicone_rod_planar"))
    assert constant.n_q == len(constant.links[0].strains)


def test_what_cannot_be_expanded_is_refused_by_key():
    hysteresis = [{"stiffness": [5.0, 1e-4, 1e-4], "range": [0.01, 1.0, 1.0]}]
    with refused("links[0].hysteresis"):
        with_basis(robot(hysteresis=hysteresis), "legendre", 2)
    with refused("links[0].damping", names=("legendre",)):
        with_basis(robot(), "chebyshev", 2)
    with refused("links[0].damping", names=("constant",)):
        with_basis(with_basis(robot(), "legendre", 2), "legendre", 1)


@pytest.mark.parametrize(
    ("keys", "found"),
    [
        ({"nodes": 1}, ("", "nodes:", "2")),
        ({"steps": 5}, ("", "no steps", "exact")),
        ({"method": "mde", "nodes": 3}, ("", "no nodes", "mde")),
        ({"basis": "legendre"}, ("", "order", "legendre")),
        ({"order": 2}, ("", "order", "chebyshev")),
    ],
)
def test_what_does_not_go_together_is_refused(keys, found):
    with fails(ConfigError, *found[1:], key=found[0]):
        Discretisation(**keys)
