"""Doubt about shapes that no position shows."""

import numpy as np
import pytest

from soro_core import SoftArm, load_robot
from soro_core.adaptation.scales import q_scale_of
from soro_core.config import find_config
from soro_core.estimation import Estimator, EstimatorConfig, PoseSample
from soro_core.estimation.filter import Filter
from soro_core.estimation.unmeasured_subspace import unmeasured_covariance
from soro_core.loop import certainty_of
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.rotation import quaternion_from_matrix

ROBOT = load_robot(find_config("asu_two_segment", "robots"))
ARM = SoftArm(ROBOT)
FILTER = Filter(ARM, EstimatorConfig())
Q = np.array([0.08, 1.0, 0.3, 0.03, -0.8, 0.2])


def test_a_pose_of_the_tip_leaves_three_directions_open_that_do_not_move_it():
    scale = q_scale_of(ARM)
    doubt = unmeasured_covariance(FILTER, Q, [ARM.length], np.diag(scale**2)) / np.outer(scale, scale)
    values, directions = np.linalg.eigh(doubt)
    assert values == pytest.approx([0, 0, 0, 1, 1, 1], abs=1e-2)
    moved = ARM.jacobian(Q, ARM.length)[3:] @ (directions[:, 3:] * scale[:, None])
    assert np.abs(moved).max() < 1e-3 * ARM.length  # a unit of q in a seen one moves it by a tenth


def test_poses_at_both_plates_leave_nothing_open():
    places = [ARM.length, ROBOT.links[0].length]
    assert not unmeasured_covariance(FILTER, Q, places, np.eye(6)).any()


def test_what_a_law_gets_has_the_doubt_of_the_places_of_late():
    estimator, rest = Estimator(ROBOT), equilibrium(ARM, np.zeros(6))
    middle, rng = ROBOT.links[0].length, np.random.default_rng(1)

    def poses(t, places):
        at = [(ARM.pose(rest, s), 1e-4 * rng.standard_normal(3), s) for s in places]
        return [
            PoseSample(t, pose[:3, 3] + noise, quaternion_from_matrix(pose[:3, :3]), s)
            for pose, noise, s in at
        ]

    state, extra = estimator.initial_state(q=rest), []
    for k in range(1, 81):
        places = (ARM.length, middle) if k < 20 else (ARM.length,)
        state, estimate = estimator.step(state, np.zeros(6), poses(0.005 * k, places), [], 0.005)
        extra.append(np.trace((certainty_of(estimate).covariance - estimate.covariance)[:6, :6]))
    assert extra[18] == 0.0  # both places
    assert extra[-1] > 1.0  # the middle one has been silent for 0.3 s
