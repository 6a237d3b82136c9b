"""A robot model in place of the robot: rest, forced motion, release."""

import numpy as np
import pytest

from benchmarks.segment_runs import forced_curvature, release_bend
from soro_core.errors import ModelError
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot import Robot, load_robot, robot_from_dict
from soro_lab.identification import ForcedRun
from tests.refused import fails


@pytest.fixture(scope="module")
def arm() -> SoftArm:
    return SoftArm(load_robot("tue_three_bellow"))


def test_nothing_moves_from_an_equilibrium(arm: SoftArm) -> None:
    pressure = np.array([30e3, 10e3, 12e3])
    q = equilibrium(arm, pressure)
    assert np.hypot(q[1], q[2]) > 3.0
    moved = simulate(arm, q, np.zeros(3), t_end=0.5, dt=1e-3, pressure=pressure).q
    np.testing.assert_allclose(moved, np.broadcast_to(q, moved.shape), atol=1e-6)


def test_an_equilibrium_of_many_links(arm: SoftArm) -> None:
    fine = SoftArm(arm.robot.refine(3))
    pressure = np.array([30e3, 10e3, 12e3])
    q = equilibrium(fine, pressure)
    force = fine.gravity_force(q) + fine.elastic_force(q) - fine.actuation_matrix(q) @ pressure
    assert np.abs(force).max() < 1e-9


def test_no_equilibrium_is_an_error(arm: SoftArm) -> None:
    with fails(ModelError, key="equilibrium"):
        equilibrium(SoftArm(arm.robot.replace(tip_mass=1000.0)), np.zeros(3))


def test_a_window_keeps_the_time_of_the_run(arm: SoftArm) -> None:
    t = np.linspace(0, 2, 201)
    pressure = np.column_stack([1e4 + 5e3 * t, 1e4 + 0 * t, 1e4 + 0 * t])
    run = ForcedRun(t, pressure, np.zeros((201, 2))).window(1.0, 1.5)
    time, curvature = forced_curvature(arm, run, dt=0.01)
    assert time[0] == pytest.approx(1.0)
    assert time[-1] == pytest.approx(run.t[-1])
    np.testing.assert_allclose(curvature[0], equilibrium(arm, pressure[100])[1:], atol=1e-8)
    assert curvature[-1, 0] < curvature[0, 0] - 0.3


def test_a_release_starts_where_it_is_told_and_ends_straight(arm: SoftArm) -> None:
    t, bend = release_bend(arm, 0.3, 2.0)
    assert (t[0], bend[0]) == (0.0, pytest.approx(0.3))
    assert abs(bend[-1]) < 1e-3


def test_a_release_starts_from_the_internal_state_that_it_is_given(arm: SoftArm) -> None:
    """Bent at once, creep holds all of its force, and the arm springs back faster than one held bent."""
    _, held = release_bend(arm, 0.3, 0.1)
    kappa = 0.3 / (arm.robot.length * (1.0 + equilibrium(arm, np.zeros(3))[0]))
    _, sudden = release_bend(arm, 0.3, 0.1, internal=[0.0, 0.0, -kappa])
    assert sudden[0] == pytest.approx(held[0])
    assert sudden[5] < held[5] - 1e-3
    np.testing.assert_array_equal(release_bend(arm, 0.3, 0.1, internal=np.zeros(3))[1], held)
    q0 = equilibrium(arm, np.zeros(3)) + np.array([0.0, 0.0, kappa])
    alone = simulate(arm, q0, np.zeros(3), t_end=0.1, dt=1e-3, internal0=[0.0, 0.0, -kappa])
    np.testing.assert_allclose(sudden, alone.q[:, 2] * arm.robot.length * (1.0 + alone.q[:, 0]), rtol=1e-12)
    with fails(ModelError, "(2,)", "(3,)", key="internal0"):
        release_bend(arm, 0.3, 0.1, internal=[0.0, 0.0])


def varying(robot: Robot, order: int) -> Robot:
    """Legendre polynomials for every strain of the bellow, losses shared out as those of a uniform strain."""
    data = robot.model_dump(exclude_unset=True)
    for link in data["links"]:
        link["strains"] = {
            name: {"basis": "legendre", "order": order} for name in ("elongation", "bending_x", "bending_y")
        }
        share = 1.0 / (2.0 * np.arange(order + 1) + 1.0)
        link["damping"] = np.kron(link["damping"], share).tolist()
        for branch in link["creep"]:
            branch["stiffness"] = np.kron(branch["stiffness"], share).tolist()
    return robot_from_dict(data)


def test_runs_of_order_zero_are_those_of_constant_strain(arm: SoftArm) -> None:
    other = SoftArm(varying(arm.robot, 0))
    t = np.linspace(0, 0.5, 51)
    run = ForcedRun(t, np.column_stack([1e4 + 5e3 * t, 1e4 + 0 * t, 2e4 + 0 * t]), np.zeros((51, 2)))
    (_, one), (_, two) = (forced_curvature(which, run) for which in (arm, other))
    np.testing.assert_allclose(one, two, atol=1e-7)
    (_, one), (_, two) = (release_bend(which, 0.3, 0.3) for which in (arm, other))
    np.testing.assert_allclose(one, two, atol=1e-8)


def test_runs_of_varying_strain_are_near_those_of_constant_strain(arm: SoftArm) -> None:
    """The curvature is the mean along the link; a lighter arm of many coefficients bends nearly uniformly."""
    other = SoftArm(varying(arm.robot, 2))
    t = np.linspace(0, 0.5, 51)
    run = ForcedRun(t, np.column_stack([1e4 + 5e3 * t, 1e4 + 0 * t, 2e4 + 0 * t]), np.zeros((51, 2)))
    (_, one), (_, two) = (forced_curvature(which, run) for which in (arm, other))
    assert np.abs(one).max() > 1.0
    assert np.abs(one - two).max() < 0.05 * np.abs(one).max()
    _, bend = release_bend(other, 0.3, 2.0, dt=5e-4)
    assert bend[0] == pytest.approx(0.3)
    assert abs(bend[-1]) < 1e-3


def test_an_arm_that_cannot_do_the_run_is_refused(arm: SoftArm) -> None:
    link = {"length": 0.1, "radius": 0.01, "mass": 0.1, "strains": {"bending_x": {}, "elongation": {}}}
    link["material"] = {"youngs_modulus": 1e6, "shear_modulus": 4e5}
    planar = SoftArm(robot_from_dict({"links": [link]}))
    run = ForcedRun(np.array([0.0, 1.0]), np.zeros((2, 0)), np.zeros((2, 2)))
    with fails(ModelError, "link0/bending_x", "link0/elongation", key="link0/bending_y"):
        forced_curvature(planar, run)
    with fails(ModelError, "link0/bending_y", key="link0/bending_y"):
        release_bend(planar, 0.1, 0.1)
    with fails(ModelError, "2", key="links"):
        release_bend(SoftArm(arm.robot.refine(2)), 0.1, 0.1)
