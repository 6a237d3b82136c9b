"""The filter on a slow arm whose poses come seldom and late."""

import numpy as np
import pytest
import yaml

from soro_core.config import with_changes
from soro_core.twin import Twin
from soro_lab.scene import load_scene
from soro_lab.scene.loop import loop_of

NOISE_M = 3e-4
LINK = {
    "length": 0.133,
    "radius": 0.02,
    "mass": 0.15,
    "k_e": [800.0, 0.0, 0.0],
    "k_b": [0.15, 0.0, 0.0],
    "damping": [0.1464, 3.541e-4, 3.541e-4],
    "chambers": [{"angle_rad": at, "area_m2": 1.73e-4, "offset_m": 0.0107} for at in (0.0, 2.0944, 4.1888)],
}
# 0.4 m, nine chambers, a first mode of 0.5 Hz.
ARM = {
    "name": "soft_arm",
    "base_quaternion": [1.0, 0.0, 0.0, 0.0],
    "pressure_range_pa": [0.0, 60e3],
    "links": [LINK] * 3,
}


@pytest.mark.parametrize(("rate_hz", "delay_s"), [(25.0, 0.06), (100.0, 0.005)])
def test_a_soft_arm_of_three_links_is_found_within_three_deviations_of_its_sensor(tmp_path, rate_hz, delay_s):
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(ARM, sort_keys=False))
    keys = {
        "mode": "lockstep",
        "platform": "",
        "robot": str(tmp_path / "arm.yaml"),
        "controller.gains": "auto",
        "controller.reference.curvature_per_m": 0.6,
        "controller.reference.mean_pressure_pa": 30e3,
        "twin.payload_kg": 0.01,
        "twin.pose.rate_hz": rate_hz,
        "twin.pose.delay_s": delay_s,
    }
    scene = load_scene("track_circle", keys)
    twin = Twin(scene.loaded_robot, with_changes(scene.twin_node(), pressures="regulators"))
    missed = [
        tick.seen.tip[:3, 3] - tick.estimate.tip_pose[:3, 3]
        for tick in loop_of(scene).run(twin, 1200, twin.dt, before_s=-twin.dt)
        if tick.t_s > 2.0
    ]
    assert np.sqrt(np.mean(np.sum(np.square(missed), axis=1))) < 3.0 * NOISE_M
