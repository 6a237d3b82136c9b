"""Equilibrium of arms that something holds: a balance of forces, wherever the held tip is."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from soro_core import SoftArm, robot_from_dict, simulate
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


def planar_rod(bending, axial, force, torque):
    """Tip (y, z) and turn to y of a clamped rod without weight under a wrench that turns with its tip."""

    def rates(s, state, p):
        (theta, moment), (turn,) = state[2:], p
        fy = force[0] * np.cos(turn) + force[1] * np.sin(turn)
        fz = force[1] * np.cos(turn) - force[0] * np.sin(turn)
        stretch = 1.0 + (fy * np.sin(theta) + fz * np.cos(theta)) / axial
        y, z = stretch * np.sin(theta), stretch * np.cos(theta)
        return np.array([y, z, moment / bending, y * fz - z * fy])

    def ends(start, end, p):
        return np.array([*start[:3], end[2] - p[0], end[3] - torque])

    s = np.linspace(0.0, LENGTH, 40)
    guess = np.vstack([0.0 * s, s, 0.0 * s, 0.0 * s])
    solved = solve_bvp(rates, ends, s, guess, p=[0.0], tol=1e-8)
    assert solved.success
    return solved.y[:3, -1]


@pytest.mark.parametrize(("force", "torque"), [((0.4, 0.1), 0.0), ((-0.2, -0.3), 0.03)])
def test_a_wrench_at_the_tip_bends_a_rod_as_its_boundary_value_problem(force, torque):
    field = {"basis": "legendre", "order": 4}
    material = {**ROD["material"], "shear_correction": False}  # of the theory that has no shear
    strains = {"elongation": field, "bending_y": field}
    link = {**ROD, "material": material, "length": LENGTH, "strains": strains}
    arm = SoftArm(robot_from_dict({"links": [link], "gravity": [0.0, 0.0, 0.0]}))
    q = equilibrium(arm, [], wrench=[-torque, 0.0, 0.0, 0.0, *force])
    area, second = np.pi * 0.01**2, np.pi * 0.01**4 / 4
    y, z, turn = planar_rod(5e5 * second, 5e5 * area, force, torque)
    tip = arm.pose(q, LENGTH)
    assert abs(y) > 0.03
    np.testing.assert_allclose(tip[:3, 3], (0.0, y, z), atol=2e-5)
    assert np.arctan2(tip[1, 2], tip[2, 2]) == pytest.approx(turn, abs=2e-4)


CHAMBER = {"angle_rad": 0.0, "area_m2": 1e-4, "offset_m": 0.008}
HANGS = {
    "links": [{**ROD, "strains": CONSTANT, "length": LENGTH / 2, "chambers": [CHAMBER]}] * 2,
    "base_quaternion": [1.0, 0.0, 0.0, 0.0],
}


def test_wrenches_pressures_and_contact_balance():
    """A run that begins there stays there."""
    wall = {"point": [-0.02, 0.0, 0.0], "normal": [1.0, 0.0, 0.0], "stiffness": 300.0}
    places = {"wrench_places": [0.1, LENGTH], "contacts": {"planes": [wall]}}
    arm = SoftArm(robot_from_dict(HANGS | places))
    wrench = [[0.0, 0.0, 0.0, 0.1, 0.05, 0.0], [0.001, 0.0, 0.0, -0.3, 0.0, 0.1]]
    given = {"pressure": [2e3, 1e3], "wrench": wrench}
    q = equilibrium(arm, **given)
    assert np.abs(equilibrium(arm, [2e3, 1e3]) - q).max() > 1e-2
    assert np.linalg.norm(arm.external_forces(q).force, axis=1).max() > 0.01  # it leans on the wall
    run = simulate(arm, q, t_end=0.1, dt=2e-3, **given)
    np.testing.assert_allclose(run.q, np.tile(q, (len(run.t), 1)), atol=1e-6)


@pytest.mark.slow
def test_tensions_stand_behind_the_pressures_or_alone():
    arm = SoftArm(robot_from_dict(HANGS | {"tendons": [{"angle_rad": 1.5, "offset_m": 0.009}]}))
    wrench = np.array([0.0, 0.0, 0.0, -0.1, 0.02, 0.0])
    q = equilibrium(arm, [2e3, 1e3], tension=[0.4], wrench=wrench)
    np.testing.assert_array_equal(q, equilibrium(arm, [2e3, 1e3, 0.4], wrench=wrench))
    carried = arm.pressure_force(q, [2e3, 1e3, 0.4]) + arm.jacobian(q, LENGTH).T @ wrench
    np.testing.assert_allclose(arm.gravity_force(q) + arm.elastic_force(q), carried, atol=1e-9)
    assert np.abs(equilibrium(arm, [2e3, 1e3], tension=[0.0], wrench=wrench) - q).max() > 1e-2


@pytest.mark.parametrize(
    ("keys", "names"),
    [
        ({"wrench": [1.0, 2.0]}, ("(2,)", "(6,)")),
        ({"wrench": [np.nan] * 6}, ("finite",)),
        ({"tension": [1.0]}, ("(1,)", "(0,)")),
    ],
)
def test_what_is_no_wrench_or_tension_is_refused(keys, names):
    arm = SoftArm(robot_from_dict({"links": [{**ROD, "length": LENGTH}]}))
    with fails(ModelError, *names, key=next(iter(keys))):
        equilibrium(arm, [], **keys)
