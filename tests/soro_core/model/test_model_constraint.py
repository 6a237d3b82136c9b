"""The tip held at a point of the world."""

import numpy as np
import pytest
from outside_arms import CASES, arm_of, gradient, state_of

from soro_core import SoftArm, simulate
from soro_core.errors import ConfigError, ModelError
from soro_core.model.equilibrium.statics import equilibrium
from tests.refused import fails

HELD = {"point": [0.02, 0.01, 0.08]}


def tip_of(arm, q):
    return arm.pose(q, arm.length)[:3, 3]


@pytest.mark.slow
@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_force_is_the_gradient_of_the_stored_energy(n_links, basis):
    arm = arm_of(n_links, basis, tip_constraint=HELD)
    q, _ = state_of(arm)
    found = arm.external_forces(q)
    off = tip_of(arm, q) - HELD["point"]
    np.testing.assert_allclose(found.force, [-1e5 * off], rtol=1e-9, atol=1e-7)
    assert found.energy == pytest.approx(0.5e5 * off @ off)
    slope = gradient(lambda x: arm.external_forces(x).energy, q)
    np.testing.assert_allclose(found.generalised, -slope, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("axes", [("x",), ("z", "y")])
def test_holds_the_axes_that_it_is_told_to(axes):
    arm = arm_of(2, "constant", tip_constraint={**HELD, "axes": list(axes)})
    q, qd = state_of(arm)
    force = arm.external_forces(q, qd).force[0]
    J, R = arm.jacobian(q, arm.length)[3:], arm.pose(q, arm.length)[:3, :3]
    whole = -1e5 * (tip_of(arm, q) - HELD["point"]) - 100.0 * R @ J @ qd
    np.testing.assert_allclose(force, whole * [axis in axes for axis in "xyz"], atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["trapezoidal", "tr_bdf2"])
@pytest.mark.parametrize(("n_links", "basis"), CASES)
def test_tip_stays_where_it_is_held(n_links, basis, integrator):
    """Under its weight and a wrench the arm moves, its tip by some micrometres."""
    free = arm_of(n_links, basis)
    q0 = np.zeros(free.n_q)
    point = tip_of(free, q0)
    arm = SoftArm(free.robot.replace(tip_constraint={"point": point.tolist()}))
    wrench = [0.01, 0.005, 0.0, 0.2, 0.1, 0.0]
    moved = simulate(free, t_end=0.3, dt=2e-3, wrench=wrench, integrator=integrator)
    held = simulate(arm, t_end=0.3, dt=2e-3, wrench=wrench, integrator=integrator)
    assert moved.status.ok, moved.status
    assert held.status.ok, held.status
    assert max(np.linalg.norm(tip_of(free, q) - point) for q in moved.q) > 5e-3
    assert np.abs(held.q).max() > 0.05
    assert max(np.linalg.norm(tip_of(arm, q) - point) for q in held.q) < VIOLATION


# Measured: 4 to 16 um, which is the largest force over 1e5 N/m.
VIOLATION = 3e-5


def test_stiffer_is_nearer_to_rigid_and_no_harder():
    free = arm_of(2, "legendre")
    point = tip_of(free, np.zeros(free.n_q))
    worst = []
    for stiffness in (1e5, 1e8):
        hold = {"point": point.tolist(), "stiffness": stiffness, "damping": 1e-3 * stiffness}
        arm = SoftArm(free.robot.replace(tip_constraint=hold))
        run = simulate(arm, t_end=0.2, dt=2e-3, wrench=[0.0, 0.0, 0.0, 0.2, 0.1, 0.0])
        assert run.status.ok, run.status
        worst.append(max(np.linalg.norm(tip_of(arm, q) - point) for q in run.q))
    assert worst[1] < 1e-7
    assert worst[1] < 0.01 * worst[0]


def test_pulled_to_its_point_it_loses_energy():
    arm = arm_of(
        3, "constant", tip_constraint={"point": [0.02, 0.0, 0.25], "stiffness": 500.0, "damping": 1.0}
    )
    result = simulate(arm, t_end=0.5, dt=1e-3, integrator="tr_bdf2")
    assert result.status.ok, result.status
    rows = list(zip(result.q, result.qd, strict=True))
    energy = np.array([sum(arm.energy(q, v)) + arm.external_forces(q, v).energy for q, v in rows])
    assert np.diff(energy).max() < 1e-12 * np.ptp(energy)


@pytest.mark.slow
def test_a_run_comes_to_rest_at_the_equilibrium():
    link = {"length": 0.1, "radius": 0.01, "density": 1100.0, "damping": [1.0, 1e-3, 1e-3]}
    link |= {"material": {"youngs_modulus": 5e5, "shear_modulus": 2e5, "viscosity": 5e3}}
    arm = arm_of(1, "constant", tip_constraint={"point": [0.02, 0.0, 0.09], "stiffness": 1e3})
    arm = SoftArm(arm.robot.replace(links=[link]))
    result = simulate(arm, t_end=3.0, dt=5e-3)
    assert result.status.ok, result.status
    np.testing.assert_allclose(equilibrium(arm, [], start=result.q[-1]), result.q[-1], atol=1e-6)
    assert np.abs(result.q[-1]).max() > 1.0


@pytest.mark.parametrize(
    ("keys", "key", "allowed"),
    [
        ({"axes": ["x", "x"]}, "tip_constraint.axes", "at most once"),
        ({"axes": ["w"]}, "tip_constraint.axes[0]", "'x', 'y' or 'z'"),
        ({"axes": []}, "tip_constraint.axes", "at least 1"),
        ({"point": [0.0, 0.0]}, "tip_constraint.point", "3 numbers"),
        ({"stiffness": -1.0}, "tip_constraint.stiffness", "greater than 0"),
    ],
)
def test_bad_constraints(keys, key, allowed):
    with pytest.raises(ConfigError) as caught:
        arm_of(1, "constant", tip_constraint={**HELD, **keys})
    assert caught.value.key == key
    assert allowed in caught.value.allowed


def test_method_mde_refuses():
    arm = arm_of(1, "constant", tip_constraint=HELD)
    with fails(ModelError, "mde", "exact", key="tip_constraint"):
        SoftArm(arm.robot, method="mde")
