"""Chambers whose area grows with the strain of their fibre, section by section."""

import numpy as np
import pytest

from soro_core import SoftArm, robot_from_dict
from soro_core._box import view
from soro_core._jit import kernel
from soro_core.integrate.air import add_air_stiffness
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.model.forces.chambers import add_pressure_stiffness
from soro_core.pneumatics import ValveModel, make_gas
from soro_core.robot import shape_values

LENGTH, AREA, SLOPE = 0.19, 5e-5, -4.0
STRAINS = ("elongation", "bending_x", "bending_y")
FIELDS = (
    {"basis": "legendre", "order": 3},
    {"basis": "chebyshev", "order": 2},
    {"basis": "pod", "samples": [[1.0, 0.2], [0.8, -0.5], [0.3, 0.4], [0.0, 1.0]]},
    {"basis": "constant"},
)
PRESSURE = np.array([0.0, 4e4, 2e4])


def robot(field, slope=SLOPE):
    """Soft rod, clamped level, with three chambers."""
    chambers = [
        {"angle_rad": 2.0 * np.pi / 3.0 * k, "area_m2": AREA, "offset_m": 0.012, "area_slope": slope}
        for k in range(3)
    ]
    link = {
        "length": LENGTH,
        "radius": 0.015,
        "mass": 0.1,
        "material": {"youngs_modulus": 1e5, "shear_modulus": 3e4},
        "strains": dict.fromkeys(STRAINS, field),
        "chambers": chambers,
    }
    root = np.sqrt(0.5)
    return robot_from_dict({"links": [link], "base_quaternion": [0.0, root, 0.0, root]})


def state(arm):
    """Fibres that get up to a fifth longer or shorter."""
    scale = np.repeat([0.05, 6.0, 6.0], arm.n_q // 3)
    return np.random.default_rng(arm.n_q).normal(size=arm.n_q) * scale


def differences(function, q):
    """Derivatives by every coordinate, first axis, by central differences."""
    steps = np.repeat([1e-5, 1e-3, 1e-3], len(q) // 3)
    return np.array(
        [
            (function(q + h * e) - function(q - h * e)) / (2 * h)
            for h, e in zip(steps, np.eye(len(q)), strict=True)
        ]
    )


@kernel
def pressure_stiffness(t, q, pressure, K):
    add_pressure_stiffness(t, q, pressure, 1.0, K)


@kernel
def air_stiffness(gas, box, q, slope, K):
    arm = view(box)
    arm.work.block[:] = 0.0
    add_air_stiffness(gas, arm.tables, arm.work, q, slope, 1.0)
    K[:] = arm.work.block


@pytest.mark.slow
@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field["basis"])
def test_volume_force_and_stiffness_are_derivatives_of_each_other(field):
    arm = SoftArm(robot(field))
    q = state(arm)
    H = arm.actuation_matrix(q)
    scale = np.abs(H).max(axis=1)
    np.testing.assert_allclose(
        differences(arm.displaced_volume, q) / scale[:, None], H / scale[:, None], atol=1e-8
    )
    K = np.zeros((arm.n_q, arm.n_q))
    pressure_stiffness(arm.tables, q, PRESSURE, K)
    slopes = differences(lambda x: arm.actuation_matrix(x) @ PRESSURE, q)
    each = np.sqrt(np.outer(np.abs(np.diag(K)), np.abs(np.diag(K))))
    np.testing.assert_allclose(K / each, -slopes / each, atol=1e-7)
    K[:] = 0.0
    gas = make_gas(ValveModel(), np.full(3, LENGTH * AREA))
    air_stiffness(gas, arm._box, q, np.array([-1e9, -2e9, -3e9]), K)
    np.testing.assert_allclose(K, (H * [1e9, 2e9, 3e9]) @ H.T, atol=1e-12 * np.abs(K).max())


@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field["basis"])
def test_the_local_area_counts(field):
    """Against the integral itself, by a rule of its own."""
    arm = SoftArm(robot(field), nodes=48)
    q = state(arm)
    s = (np.arange(2000) + 0.5) / 2000 * LENGTH
    terms = q[:, None] * shape_values(arm.robot.links[0], s)
    eps, kx, ky = terms.reshape(3, -1, len(s)).sum(axis=1)
    for u in range(3):
        phi = 2.0 * np.pi / 3.0 * u
        delta = eps - 0.012 * (kx * np.cos(phi) + ky * np.sin(phi))
        volume = AREA * LENGTH * (np.expm1(SLOPE * delta) / SLOPE).mean()
        assert arm.displaced_volume(q)[u] == pytest.approx(volume, rel=1e-4)


def test_order_zero_is_constant_strain():
    """A sum over the nodes against one look."""
    closed, summed = SoftArm(robot({})), SoftArm(robot({"basis": "legendre", "order": 0}))
    q = np.array([0.1, 5.0, -3.0])
    np.testing.assert_allclose(summed.actuation_matrix(q), closed.actuation_matrix(q), rtol=1e-13)
    np.testing.assert_allclose(summed.displaced_volume(q), closed.displaced_volume(q), rtol=1e-13)


@pytest.mark.parametrize("field", FIELDS, ids=lambda field: field["basis"])
def test_a_small_slope_is_near_none(field):
    none, small = SoftArm(robot(field, 0.0)), SoftArm(robot(field, 1e-9))
    q = state(none)
    scale = np.abs(none.actuation_matrix()).max()
    np.testing.assert_allclose(small.actuation_matrix(q), none.actuation_matrix(), atol=1e-8 * scale)


def test_pieces_of_constant_strain_converge_to_a_link_of_varying_strain():
    """Sagging and bent by pressure: the error falls with the square of the number of pieces."""

    def tip(arm):
        return arm.pose(equilibrium(arm, PRESSURE), LENGTH)[:3, 3]

    cubic, right = (tip(SoftArm(robot({"basis": "legendre", "order": k}))) for k in (3, 6))
    counts = (4, 8, 16)
    errors = [np.linalg.norm(tip(SoftArm(robot({}).refine(n))) - right) / LENGTH for n in counts]
    assert np.linalg.norm(cubic - right) < 1e-4 * LENGTH
    assert errors[-1] < 1e-3
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.1)
