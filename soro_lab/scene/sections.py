"""Small sections of a scene: its recorder and its verdict; keys of nodes that follow from others."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from soro_core.config import Strict, with_changes
from soro_core.estimation.config import EstimatorConfig
from soro_core.robot import Robot
from soro_core.robot.vectors import Quaternion, Vector3
from soro_core.rotation import matrix_from_quaternion
from soro_core.twin.config import TwinSection

# Keys of the whole run, which no arm has of its own.
OF_RUN = (
    "name",
    "arms",
    "bodies",
    "hand",
    "mode",
    "rate_hz",
    "duration_s",
    "recorder",
    "valves",
    "arm",
    "markers",
    "measured",
)


class BaseKeys(Strict):
    """Keys of where an arm stands, in place of those of its robot file."""

    mounted_on: str = Field(
        "",
        description="arm of the scene that carries this one at its tip: places, poses and forces "
        "of this arm, also base_position, are then seen from that tip (docs/bodies.md); empty: none",
    )
    base_position: Vector3 | None = Field(
        None, description="of the base in the world [m]; default: that of the robot file"
    )
    base_quaternion: Quaternion | None = Field(
        None, description="of the base in the world, x, y, z, w; default: that of the robot file"
    )

    @property
    def place(self) -> dict[str, tuple[float, ...]]:
        """Keys of the robot that the scene states: its base, and gravity at the tip of a straight carrier."""
        stated = {"base_position": self.base_position, "base_quaternion": self.base_quaternion}
        place = {key: value for key, value in stated.items() if value is not None}
        # `load_scene` has put it there, which knows all arms.
        carrier: Robot | None = vars(self).get("loaded_carrier")
        if carrier is None:
            return place
        turn = matrix_from_quaternion(np.array(carrier.base_quaternion))
        return place | {"gravity": tuple((turn.T @ carrier.gravity).tolist())}


class RecorderSection(Strict):
    """Keys of the recorder."""

    enabled: bool = Field(True, description="record a bag")
    exclude: tuple[str, ...] = Field((), strict=False, description="topics that are not recorded")


class VerdictSection(Strict):
    """Limits of a good and of a lost run without injected faults; under 5 s, of a lost one alone."""

    tip_error_part: float = Field(
        0.1,
        gt=0,
        le=1,
        description="largest tip error, RMS over the last 5 s, part of the arm's length; a reference that "
        "the best pressures leave further away is refused",
    )
    good_part: float = Field(
        0.02,
        gt=0,
        le=1,
        description="largest tip error of a good run, RMS over the last 5 s, part of the arm's length; a run "
        "between this and tip_error_part is poor",
    )
    at_bound_part: float = Field(0.5, gt=0, le=1, description="largest part of all set points at a bound")
    expected: Literal["good", "poor", "vented"] = Field(
        "good", description="how the run is meant to end (soro scenes); it does not change the verdict"
    )


# Noise of the filter by that of the twin. For accelerations the filter has an allowance for motions instead.
_NOISES = (
    ("pose", "position_std_m", "position_noise_m"),
    ("pose", "orientation_std_rad", "rotation_noise_rad"),
    ("imu", "rate_std_rad_s", "rate_noise_rad_s"),
    ("imu", "orientation_std_rad", "rotation_noise_rad"),
)
# Least noise: a filter has no use for a sensor without any.
_LEAST_NOISE = 1e-5


def with_sensor_noise(filter_: EstimatorConfig, twin: TwinSection) -> EstimatorConfig:
    """Return the filter's keys with the noise that `twin` states of its sensors where they state none."""
    found: dict[str, dict[str, float]] = {"pose": {}, "imu": {}}
    for kind, own, of_twin in _NOISES:
        sensor = getattr(twin, kind)
        if of_twin in sensor.model_fields_set and own not in getattr(filter_, kind).model_fields_set:
            found[kind][own] = max(getattr(sensor, of_twin), _LEAST_NOISE)
    sections = {kind: with_changes(getattr(filter_, kind), **keys) for kind, keys in found.items() if keys}
    return with_changes(filter_, **sections) if sections else filter_


def sample_keys(twin: TwinSection) -> dict[str, Any]:
    """Return the keys of the samples that a node waits for."""
    pose, imu = twin.pose, twin.imu
    return {
        "pose_locations": pose.locations,
        "imu_locations": imu.locations,
        "pose_rate_hz": pose.rate_hz if pose.enabled else 0.0,
        "pose_delay_s": pose.delay_s,
        "imu_rate_hz": imu.rate_hz if imu.enabled else 0.0,
        "imu_delay_s": imu.delay_s,
    }
