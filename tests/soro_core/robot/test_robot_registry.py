"""A basis that a package adds to the registry works everywhere: files, dynamics, pieces, expansion."""

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.special import comb

from soro_core import SoftArm, robot_from_dict
from soro_core.robot import Discretisation, bases, with_basis
from soro_core.robot.bases import Polynomial
from soro_core.robot.coordinates import strain_fields
from tests.refused import refused
from tests.small_links import ROD

DEGREE = 3


class Bernstein(Polynomial):
    """Polynomials that add up to 1."""

    def uniform(self, field, weight, mean):
        return np.ones(len(mean))


def bernstein(x, degree):
    t = (x[:, None] + 1.0) / 2.0
    k = np.arange(degree + 1)
    return comb(degree, k) * t**k * (1.0 - t) ** (degree - k)


@pytest.fixture
def registered(monkeypatch):
    monkeypatch.setitem(bases.BASES, "bernstein", Bernstein(bernstein))


def rod(basis):
    strains = {name: {"basis": basis, "order": DEGREE} for name in ("bending_x", "elongation")}
    return robot_from_dict({"links": [{**ROD, "strains": strains}]})


def test_dynamics_are_those_of_the_same_space(registered):
    """Bernstein and Legendre polynomials of one degree span one space: q_legendre = T q_bernstein."""
    own, known = SoftArm(rod("bernstein")), SoftArm(rod("legendre"))
    x = np.linspace(-1.0, 1.0, 20)
    change = np.linalg.lstsq(legendre.legvander(x, DEGREE), bernstein(x, DEGREE), rcond=None)[0]
    T = np.kron(np.eye(2), change)
    rng = np.random.default_rng(2)
    q, qd = rng.normal(size=8) * np.repeat([3.0, 0.05], 4), rng.normal(size=8) * np.repeat([3.0, 0.05], 4)
    np.testing.assert_allclose(
        T @ own.forward_dynamics(q, qd, []), known.forward_dynamics(T @ q, T @ qd, []), rtol=1e-8
    )
    np.testing.assert_allclose(own.pose(q, 0.13), known.pose(T @ q, 0.13), atol=1e-13)


def test_names_sizes_and_uniform_strains(registered):
    robot = rod("bernstein")
    assert robot.coordinate_names[:2] == ("link0/bending_x_0", "link0/bending_x_1")
    assert robot.n_q == 8
    fields = strain_fields(robot)
    np.testing.assert_allclose(fields.uniform @ fields.samples[:, :1], [2.0])


def test_links_are_split_and_expanded(registered):
    assert rod("bernstein").refine(2).n_q == 16
    plain = robot_from_dict({"links": [ROD]})
    assert Discretisation(basis="bernstein", order=2).discretise(plain).n_q == 9
    lossy = robot_from_dict({"links": [{**ROD, "damping": [0.1, 0.1, 0.1]}]})
    with refused("links[0].damping", names=("legendre", "bernstein")):
        Discretisation(basis="bernstein", order=2).discretise(lossy)


NAMES = ("constant", "legendre", "chebyshev", "bernstein")


def test_a_name_that_is_not_registered_is_refused_with_those_that_are(registered):
    with refused("links[0].strains.bending_x.basis", "fourier", (*NAMES, "pod")):
        rod("fourier")
    for name in ("pod", "fourier"):
        with refused("basis", name, NAMES):
            with_basis(rod("legendre"), name, 2)
    with refused("basis", "pod", ("robot", *NAMES)):
        Discretisation(basis="pod")
