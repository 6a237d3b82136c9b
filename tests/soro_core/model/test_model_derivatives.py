"""Derivatives of the forward dynamics against extrapolated differences, and what has none."""

import numpy as np
import pytest
from differences import extrapolated, worst
from outside_arms import PLANE, arm_of, state_of
from sample_arms import chambers, random_robot, random_state
from shaped_arms import shaped_arm

from soro_core import SoftArm, load_robot, robot_from_dict
from soro_core.errors import ModelError
from tests.refused import fails

# Of the largest entry of each matrix.
ALLOWED = 1e-8
FIELDS = ("by_q", "by_qd", "by_p")
WRENCH = np.array([0.01, 0.02, -0.01, 0.3, 0.2, -0.5])


def errors(arm, q, qd, p, wrench=None, internal=None):
    """Error of each of the three matrices."""
    q, qd, p = (np.asarray(x, float) for x in (q, qd, p))
    angular = [name.split("/")[1].startswith(("bending", "torsion")) for name in arm.robot.coordinate_names]
    step = np.where(angular, 1.0, 0.02)
    got = arm.derivatives(q, qd, p, wrench, internal)

    def f(*state):
        return arm.forward_dynamics(*state, wrench, internal)

    wanted = (
        extrapolated(lambda x: f(x, qd, p), q, step),
        # Quadratic in the velocities, and nearly linear in the pressures: no step is too large.
        extrapolated(lambda x: f(q, x, p), qd, 300.0 * step),
        extrapolated(lambda x: f(q, qd, x), p, np.full(arm.n_u, 1e4)),
    )
    return {name: worst(a, b) for name, a, b in zip(FIELDS, got, wanted, strict=True)}


@pytest.mark.parametrize("number", range(25))
def test_golden_arms(golden, number):
    case = golden[number]
    arm = SoftArm(robot_from_dict(case))
    found = errors(arm, case["q"], case["qd"], np.zeros(arm.n_u), wrench=0.1 * WRENCH)
    assert max(found.values()) < ALLOWED, found


@pytest.mark.parametrize("seed", range(6))
def test_arms_of_any_strains_base_laws_and_chambers(seed):
    robot = random_robot(seed)
    found = errors(SoftArm(robot), *random_state(robot, seed), np.full(robot.n_u, 2e4), WRENCH)
    assert max(found.values()) < ALLOWED, found


def mixed_arm():
    """Links of constant and of varying strain: polynomials and modes; chambers whose area changes; losses."""
    samples = [[1.0, 0.2], [0.8, -0.5], [0.3, 0.4], [0.0, 1.0]]
    rng = np.random.default_rng(0)
    common = {"length": 0.1, "radius": 0.01, "density": 1100.0}
    material = {"youngs_modulus": 2e5, "shear_modulus": 7e4, "viscosity": 300.0}
    varying = {
        "strains": {
            "bending_x": {"basis": "legendre", "order": 2},
            "torsion": {"basis": "constant"},
            "bending_y": {"basis": "chebyshev", "order": 1},
            "elongation": {"basis": "legendre", "order": 1},
        },
        "material": material,
        "chambers": chambers(rng, area_slope=-1.5),
    }
    plain = {"k_e": [400.0, 200.0, 30.0], "k_b": [0.02, 0.01, 0.6], "damping": [0.1, 1e-5, 1e-5]}
    plain |= {"creep": [{"tau": 0.1, "stiffness": [1.0, 1e-3, 1e-3]}]}
    plain |= {"hysteresis": [{"stiffness": [1.0, 1e-3, 1e-3], "range": [0.1, 1.0, 1.0]}]}
    plain |= {"chambers": chambers(rng, area_slope=1.0)}
    modes = {
        "strains": {"bending_x": {"basis": "pod", "samples": samples}, "shear_x": {}},
        "material": material,
    }
    robot = {"links": [common | varying, common | plain, common | modes], "tip_mass": 0.02}
    return SoftArm(robot_from_dict(robot | {"base_quaternion": [0.1, 0.7, 0.1, 0.7]}))


@pytest.mark.parametrize(
    "make", [mixed_arm, shaped_arm, lambda: arm_of(2, "legendre"), lambda: arm_of(1, "constant")]
)
def test_varying_strain_area_losses_and_internal_states(make):
    arm = make()
    z = np.random.default_rng(3).normal(size=arm.n_internal)
    found = errors(arm, *state_of(arm), np.full(arm.n_u, 2e4), WRENCH, z)
    assert max(found.values()) < ALLOWED, found


@pytest.mark.parametrize("eps", [-0.05, -0.2, -0.27])
def test_walls_that_touch(eps):
    """Far from the least elongation of -0.3, near it, and nearer."""
    link = {
        "length": 0.1,
        "radius": 0.02,
        "mass": 0.05,
        "k_e": [400.0, 150.0, 20.0],
        "k_b": [0.05, 0.01, 0.5],
    }
    link |= {"least_elongation": -0.3, "chambers": chambers(np.random.default_rng(0))}
    arm = SoftArm(robot_from_dict({"links": [link, link], "tip_mass": 0.02}))
    q = np.array([eps, 5.0, -2.0, 0.6 * eps, 3.0, 1.0])
    found = errors(arm, q, 0.5 * q, np.full(arm.n_u, 2e4), WRENCH)
    assert max(found.values()) < ALLOWED, found


def test_rest_and_straight_are_no_exception():
    arm = SoftArm(load_robot("tue_three_bellow"))
    q = np.zeros(arm.n_q)
    found = errors(arm, q, q, np.zeros(arm.n_u))
    assert max(found.values()) < ALLOWED, found


def test_same_bits_whatever_was_computed_before():
    arm, fresh = mixed_arm(), mixed_arm()
    q, qd = state_of(arm)
    p = np.full(arm.n_u, 1e4)
    arm.derivatives(-0.5 * q, 3.0 * qd, 2.0 * p, WRENCH)
    for got, wanted in zip(arm.derivatives(q, qd, p), fresh.derivatives(q, qd, p), strict=True):
        np.testing.assert_array_equal(got, wanted)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("contacts", {"planes": [PLANE]}),
        ("tip_constraint", {"point": [0.0, 0.0, 0.1], "stiffness": 1e3}),
        ("wrench_places", [0.05]),
    ],
)
def test_places_outside_have_no_derivatives(key, value):
    arm = arm_of(1, "constant", **{key: value})
    q, qd = state_of(arm)
    with fails(ModelError, "derivatives", key, key=key):
        arm.derivatives(q, qd, [])


def test_the_method_mde_has_no_derivatives():
    arm = SoftArm(load_robot("tue_three_bellow"), method="mde")
    with fails(ModelError, "derivatives", "mde", "exact", key="method"):
        arm.derivatives(np.zeros(3), np.zeros(3), np.zeros(3))


def test_bad_arguments_are_those_of_the_forward_dynamics():
    arm = SoftArm(load_robot("tue_three_bellow"))
    rest = np.zeros(3)
    with fails(ModelError, "not finite", key="q"):
        arm.derivatives([np.nan, 0.0, 0.0], rest, rest)
    with fails(ModelError, "(2,)", "(3,)", key="p"):
        arm.derivatives(rest, rest, np.zeros(2))
    with fails(ModelError, "2 states", "one", key="q"):
        arm.derivatives(np.zeros((2, 3)), np.zeros((2, 3)), rest)


def test_forward_dynamics_of_many_states_are_those_of_each():
    arm = mixed_arm()
    rng = np.random.default_rng(1)
    q, qd = rng.normal(size=(2, 5, arm.n_q)) * 0.1
    p, z = rng.uniform(0.0, 1e4, (5, arm.n_u)), rng.normal(size=(5, arm.n_internal))
    got = arm.forward_dynamics(q, qd, p, WRENCH, z)
    assert got.shape == (5, arm.n_q)
    for k in range(5):
        np.testing.assert_array_equal(got[k], arm.forward_dynamics(q[k], qd[k], p[k], WRENCH, z[k]))
    # One row of pressures is for all; lists are arrays too; no state is no acceleration.
    got = arm.forward_dynamics(q.tolist(), qd.tolist(), p[0])
    np.testing.assert_array_equal(got[3], arm.forward_dynamics(q[3], qd[3], p[0]))
    assert arm.forward_dynamics(q[:0], qd[:0], p[0]).shape == (0, arm.n_q)


def test_the_bad_one_of_many_states_is_named():
    arm = SoftArm(load_robot("tue_three_bellow"))
    q, rest = np.zeros((4, 3)), np.zeros(3)
    q[2, 0] = -1.0
    with fails(ModelError, "state 2", "-1", key="elongation"):
        arm.forward_dynamics(q, np.zeros((4, 3)), rest)
    with fails(ModelError, "(3,)", "(4, 3)", key="qd"):
        arm.forward_dynamics(q, rest, rest)
    with fails(ModelError, "(3, 3)", "(4, 3)", key="p"):
        arm.forward_dynamics(q, np.zeros((4, 3)), np.zeros((3, 3)))
    with fails(ModelError, "(4, 2)", "(4, 3)", key="q"):
        arm.forward_dynamics(np.zeros((4, 2)), np.zeros((4, 3)), rest)
