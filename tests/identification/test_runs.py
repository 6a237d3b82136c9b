"""A robot model in place of the robot: rest, forced motion, release."""

import numpy as np
import pytest

from soro_core.errors import ModelError
from soro_core.identification import ForcedRun, forced_curvature, release_bend
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.statics import equilibrium
from soro_core.robot import load_robot


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
    with pytest.raises(ModelError, match="no equilibrium at pressures"):
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
