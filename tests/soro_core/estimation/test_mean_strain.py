"""The uneven bend of a loaded link, against the rest of a plant of eight pieces."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from soro_core import SoftArm, load_robot
from soro_core.config import find_config
from soro_core.estimation.mean_strain import MeanStrain
from soro_core.model.equilibrium.statics import equilibrium

REFERENCE = np.array([0.08, 8.0, 6.0])


@pytest.fixture(scope="module")
def robot():
    return load_robot(find_config("tue_three_bellow", "robots"))


@pytest.mark.parametrize("s", [1.0, 0.5])
@pytest.mark.parametrize("load_kg", [0.0, 0.02])
def test_an_imu_on_a_loaded_link_sees_the_mean_strain(robot, load_kg, s):
    arm, fine = SoftArm(robot), SoftArm(robot.replace(tip_mass=load_kg).refine(8))
    held = arm.gravity_force(REFERENCE) + arm.elastic_force(REFERENCE)
    held += 1.3 * load_kg * arm.tip_mass_force(REFERENCE, np.zeros(3), np.zeros(3))
    pressure = np.linalg.solve(arm.actuation_matrix(REFERENCE), held)
    rest = equilibrium(fine, pressure, start=np.tile(REFERENCE, 8))
    q = REFERENCE.copy()
    for _ in range(10):  # the q whose tip is where that of the plant is
        pose, jacobian = arm.pose_and_jacobian(q, arm.length)
        missing = fine.pose(rest, arm.length)[:3, 3] - pose[:3, 3]
        q += np.linalg.solve(pose[:3, :3] @ jacobian[3:], missing)
    shape = MeanStrain(arm).at(q, pressure, np.zeros(arm.n_internal), s * arm.length)
    seen = fine.pose(rest, s * arm.length)[:3, :3]

    def off(coordinates):
        modelled = arm.pose(coordinates, s * arm.length)[:3, :3]
        return Rotation.from_matrix(modelled.T @ seen).magnitude()

    assert off(shape.mean) < 0.2 * off(q)
    assert off(shape.mean) < 5.5e-3
