"""Equilibrium of arms that something holds: a balance of forces, wherever the held tip is."""

import numpy as np
import pytest

from soro_core import SoftArm, robot_from_dict
from soro_core.errors import ModelError
from soro_core.model.equilibrium.statics import equilibrium
from tests.refused import fails

pytestmark = pytest.mark.numerics

LENGTH = 0.2
ROD = {
    "radius": 0.01,
    "density": 1070.0,
    "material": {"youngs_modulus": 5e5, "shear_modulus": 1.7e5, "viscosity": 300.0},
}
CONSTANT = {key: {} for key in ("elongation", "bending_x", "bending_y")}
QUADRATIC = {key: {"basis": "legendre", "order": 2} for key in ("elongation", "bending_x")}
ALL = {key: {} for key in ("torsion", "bending_x", "bending_y", "elongation", "shear_x", "shear_y")}


def hanging(strains, links, point, **keys):
    link = {**ROD, "strains": strains, "length": LENGTH / links}
    held = {"point": point, "stiffness": 1e5, **keys}
    data = {"links": [link] * links, "base_quaternion": [1.0, 0.0, 0.0, 0.0], "tip_constraint": held}
    return SoftArm(robot_from_dict(data))


@pytest.mark.parametrize(
    "point", [(0.0, 0.0, -0.2), (0.0, 0.0, -0.22), (0.02, 0.0, -0.195), (0.05, 0.0, -0.18), (0.1, 0.0, -0.12)]
)
@pytest.mark.parametrize(("strains", "links"), [(CONSTANT, 4), (QUADRATIC, 1), (ALL, 2)])
def test_a_hanging_rod_with_its_tip_held(strains, links, point):
    """From the straight rod, whose tip is up to 0.13 m away from where it is held."""
    arm = hanging(strains, links, point)
    q = equilibrium(arm, [])
    outside = arm.external_forces(q)
    left = arm.gravity_force(q) + arm.elastic_force(q) - outside.generalised
    largest = np.abs(np.concatenate([arm.gravity_force(q), arm.elastic_force(q)])).max()
    assert np.abs(left).max() < 1e-6 * largest
    tip = arm.pose(q, LENGTH)[:3, 3]
    np.testing.assert_allclose(tip, point, atol=5e-4)  # the spring gives a little
    np.testing.assert_allclose(tip - point, outside.force[-1] / -1e5, atol=1e-9)


def test_where_the_search_fails_it_says_what_to_do():
    """The point is farther away than the rod stretches before it fails."""
    arm = hanging(QUADRATIC, 1, (0.1, 0.0, 0.5), stiffness=1e12)
    with fails(ModelError, "[] Pa", "robot", "(start)", key="equilibrium"):
        equilibrium(arm, [])
