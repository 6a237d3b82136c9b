"""The least stiffness of an arm: of its own forces, of a heavy load, and with a feedback."""

import numpy as np
import pytest

from soro_core import SoftArm
from soro_core.adaptation.modes import least_stiffness
from soro_core.robot import load_robot


def test_what_a_load_and_a_feedback_leave_of_the_stiffness():
    arm = SoftArm(load_robot("tue_three_bellow"))  # it stands
    straight, none = np.zeros(3), np.zeros((3, 3))
    own = arm.stiffness_matrix(straight)

    def loaded(q, mass_kg=0.0):
        weight = arm.gravity_force(q) + mass_kg * arm.tip_mass_force(q, straight, straight)
        return np.asarray(arm.elastic_force(q) + weight)

    assert least_stiffness(arm, arm.elastic_force, straight, none) == pytest.approx(1.0, abs=1e-4)
    # At a small curvature q the tip is q^2 L^3 / 6 lower: the load at which the arm falls over.
    empty = least_stiffness(arm, loaded, straight, none)
    critical_kg = empty * own[1, 1] / (9.81 * arm.length**3 / 3.0)
    found = least_stiffness(arm, lambda q: loaded(q, critical_kg), straight, none)
    assert found == pytest.approx(0.0, abs=1e-4)
    assert least_stiffness(arm, lambda q: loaded(q, 2.0 * critical_kg), straight, none) < -0.5
    assert least_stiffness(arm, lambda q: loaded(q, critical_kg), straight, 0.2 * own) == pytest.approx(
        0.2, abs=1e-4
    )
