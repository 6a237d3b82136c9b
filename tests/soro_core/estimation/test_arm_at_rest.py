"""An arm at rest under a sensor that repeats itself: the estimate stays ok, and the arm can be enabled."""

from dataclasses import replace

import numpy as np
import pytest

from soro_core import load_robot
from soro_core.config import find_config
from soro_core.control import Controller
from soro_core.control.enable_checks import SensorSample, pressure_findings, resting_arm
from soro_core.control.motion_config import EnableBounds
from soro_core.estimation import Estimator
from soro_core.pneumatics import RegulatorModel
from soro_core.twin import SensorConfig, Twin, TwinConfig

DT = 0.005
NO_NOISE = {"position_noise_m": 0.0, "rotation_noise_rad": 0.0, "rate_noise_rad_s": 0.0}
IDEAL = RegulatorModel(
    hysteresis_pa=0.0, command_resolution_pa=0.0, reading_resolution_pa=0.0, reading_noise_pa=0.0
)


def rounded(sample, step_m):
    return replace(sample, position=step_m * np.round(sample.position / step_m)) if step_m else sample


@pytest.mark.parametrize(
    ("step_m", "imu"), [(0.0, False), (1e-3, False), (1e-3, True)], ids=["exact", "1 mm", "imu"]
)
def test_a_twin_at_rest_without_noise_stays_ok_and_fits_the_check_at_enable(step_m, imu):
    robot = load_robot(find_config("tue_three_bellow", "robots"))
    pose = SensorConfig(rate_hz=100.0, **NO_NOISE)
    imus = SensorConfig(enabled=imu, rate_hz=200.0, acceleration_noise_m_s2=0.0, **NO_NOISE)
    twin = Twin(robot, TwinConfig(payload_kg=0.02, pose=pose, imu=imus, regulator=IDEAL))
    world = twin.initial(np.zeros(robot.n_u))
    estimator, last, frozen = Estimator(robot, dt=DT), None, []
    state = estimator.initial_state()
    for k in range(300):
        world, seen = twin.observe(world)
        poses = [rounded(one, step_m) for one in seen.poses]
        last = poses[-1] if poses else last
        state, estimate = estimator.step(state, seen.reading_pa, poses, seen.imus, DT)
        assert estimate.status.ok or k * DT < 0.1
        frozen.append(state.counts.frozen)
        world = twin.step_pressures(world, np.zeros(robot.n_u))
    # Until the filter has found the load its prediction moves, and a rounded pose does not.
    assert frozen[-1] == frozen[100]
    assert state.counts.accepted > 100
    assert estimate.status.note == ""
    bounds, arm = EnableBounds(), resting_arm(Controller(robot))
    assert arm.findings([SensorSample("sensors/pose0", last.s, last.position, last.quaternion)], bounds) == []
    assert pressure_findings(robot.chamber_names, seen.reading_pa, bounds) == []
