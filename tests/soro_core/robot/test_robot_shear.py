"""Shear correction on EI: of the planes whose shear is left out, known factors of the reference rod."""

import numpy as np
import pytest
from scipy.linalg import eigh

from soro_core.robot import link_stiffness, robot_from_dict, shear_factors, strain_rows
from tests.small_links import PLAIN, ROD


def test_shear_correction_of_the_rod():
    """Known: exact Timoshenko frequency 2.20762 Hz at shear factor 27/28, Euler-Bernoulli 2.23697 Hz
    without rotary inertia, which alone lowers it to 2.22970 Hz: factor (2.20762 / 2.22970)^2."""
    link = {**ROD, "material": {**ROD["material"], "shear_factor": 27 / 28}}
    robot = robot_from_dict({"links": [link]})
    known = (2.20762 / 2.22970) ** 2
    np.testing.assert_allclose(shear_factors(robot), [[known, known]], rtol=1e-5)
    np.testing.assert_allclose(shear_factors(robot.refine(4)), np.full((4, 2), 0.980297), rtol=1e-5)
    # Shear factor 1 leaves less shear out: 0.981.
    np.testing.assert_allclose(shear_factors(robot_from_dict({"links": [ROD]})), [[0.98097] * 2], atol=5e-5)
    off = {**ROD, "material": {**ROD["material"], "shear_correction": False}}
    np.testing.assert_array_equal(shear_factors(robot_from_dict({"links": [off]})), [[1.0, 1.0]])
    mixed = shear_factors(robot_from_dict({"links": [PLAIN, ROD]}))
    assert (mixed[0] == 1.0).all()
    assert ((mixed[1] > 0.8) & (mixed[1] < 1.0)).all()


@pytest.mark.parametrize(
    ("strains", "corrected"),
    [
        (("bending_x", "bending_y"), (True, True)),
        (("bending_x", "bending_y", "shear_x"), (False, True)),
        (("bending_x", "bending_y", "shear_y"), (True, False)),
        (("bending_x", "bending_y", "shear_x", "shear_y"), (False, False)),
        (("bending_x", "shear_x"), (False, False)),  # planar: nothing is left out
        (("bending_x", "shear_y"), (True, False)),
        (("torsion", "elongation"), (False, False)),
    ],
)
@pytest.mark.parametrize("field", [{"basis": "constant"}, {"basis": "legendre", "order": 3}])
def test_each_plane_whose_shear_is_left_out_is_corrected(strains, corrected, field):
    robot = robot_from_dict({"links": [{**ROD, "strains": dict.fromkeys(strains, field)}]})
    factors = shear_factors(robot)
    np.testing.assert_allclose(factors[0], np.where(corrected, 0.98097, 1.0), atol=5e-5)
    link = robot.links[0]
    ratio = np.diag(link_stiffness(link, factors[0])) / np.diag(link_stiffness(link))
    want = {"bending_x": factors[0, 0], "bending_y": factors[0, 1]}
    np.testing.assert_allclose(ratio, [want.get(name, 1.0) for name in strain_rows(link)], rtol=1e-14)


def first_frequency(links, factors, carried):
    """First frequency [rad/s] of the clamped chain from linear Timoshenko elements, one integration point.

    `factors` on EI; shear is rigid where it is not `carried`. An independent way, of second order in h.
    """
    elements = 30
    n = 2 * (elements * len(links) + 1)  # deflection and rotation of each node
    K, M = np.zeros((n, n)), np.zeros((n, n))
    for i, (link, factor, soft) in enumerate(zip(links, factors, carried, strict=True)):
        m, h = link.material, link.length / elements
        area, inertia = np.pi * link.radius**2, np.pi * link.radius**4 / 4
        shear = m.shear_factor * m.shear_modulus * area * (1.0 if soft else 1e4)
        turn, slide = np.array([0, -1, 0, 1]) / h, np.array([-1 / h, -0.5, 1 / h, -0.5])
        k = h * (factor * m.youngs_modulus * inertia * np.outer(turn, turn) + shear * np.outer(slide, slide))
        consistent = link.mass / link.length * h / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])
        mass = np.kron(consistent, np.diag([1.0, link.radius**2 / 4]))
        for j in range(i * elements, (i + 1) * elements):
            K[2 * j : 2 * j + 4, 2 * j : 2 * j + 4] += k
            M[2 * j : 2 * j + 4, 2 * j : 2 * j + 4] += mass
    last = len(K) - 3
    return eigh(M[2:, 2:], K[2:, 2:], eigvals_only=True, subset_by_index=[last, last])[0] ** -0.5


def test_planes_of_a_chain_are_corrected_apart():
    """Shear of y is carried by the first link alone: the second makes up for its own."""
    first = {**ROD, "strains": {name: {} for name in ("bending_x", "bending_y", "shear_y")}}
    second = {**ROD, "strains": {name: {} for name in ("bending_x", "bending_y")}}
    robot = robot_from_dict({"links": [first, second]})
    factors = shear_factors(robot)
    np.testing.assert_array_equal(
        factors[:, 0], shear_factors(robot_from_dict({"links": [second, second]}))[:, 0]
    )
    assert factors[0, 1] == 1.0
    whole = first_frequency(robot.links, [1.0, 1.0], [True, True])
    assert whole < 0.9995 * first_frequency(robot.links, [1.0, 1.0], [True, False])
    for plane, carried in enumerate(([False, False], [True, False])):
        assert first_frequency(robot.links, factors[:, plane], carried) == pytest.approx(whole, rel=1e-6)
