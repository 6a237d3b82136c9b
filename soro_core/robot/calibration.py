"""How the sensors of a laboratory sit on its arm: the frame of its tracker, and the bodies that this sees."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from soro_core.config import Strict
from soro_core.robot.vectors import Quaternion, Vector2, Vector3

_NO_TURN = (0.0, 0.0, 0.0, 1.0)


class SensorBody(Strict):
    """A body, seen by the tracker, on a cross-section of the arm."""

    at: float = Field(ge=0, le=1, description="the cross-section, in parts of the length of the arm")
    offset_m: Vector3 = Field((0.0, 0.0, 0.0), description="its origin in the frame of the cross-section [m]")
    quaternion: Quaternion = Field(
        _NO_TURN, description="x, y, z, w of its axes in the frame of the cross-section"
    )


class Calibration(Strict):
    """Frames of the measurement: of curvatures for comparisons alone, of poses for the estimator too."""

    frame_rotation_rad: float = Field(
        0.0, description="turns the model's curvature vector into the measured frame"
    )
    curvature_offset: Vector2 = Field(
        (0.0, 0.0), description="measured curvature [1/m] of the straight robot"
    )
    tracker_position: Vector3 = Field(
        (0.0, 0.0, 0.0), description="origin of the robot's world in the frame of the tracker [m]"
    )
    tracker_quaternion: Quaternion = Field(
        _NO_TURN, description="x, y, z, w of the axes of the robot's world in the frame of the tracker"
    )
    bodies: Annotated[tuple[SensorBody, ...], Field(strict=False)] = ()
