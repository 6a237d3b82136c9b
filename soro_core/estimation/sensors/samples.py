"""Samples of the sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from soro_core.arrays import Array

# No sensor on an arm reads more [m, rad/s, m/s^2]; finite numbers near the largest overflow in the filter.
_MOST = 1e6


@dataclass(frozen=True)
class PoseSample:
    """Pose of the backbone at `s` in the world frame.

    Attributes
    ----------
    stamp_s : float
        Time of the measurement (not of its arrival) [s].
    position : ndarray (3,)
        Position [m].
    quaternion : ndarray (4,)
        Orientation (x, y, z, w).
    s : float
        Place along the whole arm [m].
    """

    stamp_s: float
    position: Array
    quaternion: Array
    s: float

    @property
    def sensor(self) -> str:
        """Name under which stamps and outliers are counted."""
        return pose_sensor(self.s)

    def finite(self) -> bool:
        """Whether all numbers can be measured and the quaternion is a rotation."""
        return (
            math.isfinite(self.stamp_s)
            and math.isfinite(self.s)
            and _length(self.position, 3) < _MOST
            and _is_rotation(self.quaternion)
        )


@dataclass(frozen=True)
class ImuSample:
    """Readings of an IMU on the backbone at `s`, its axes those of the local frame.

    Attributes
    ----------
    stamp_s : float
        Time of the measurement [s].
    angular_velocity : ndarray (3,)
        [rad/s].
    linear_acceleration : ndarray (3,)
        Specific force [m/s^2]; at rest it points up with the length of gravity.
    orientation : ndarray (4,) or None
        Orientation in the world frame (x, y, z, w), None where the IMU has none.
    s : float
        Place along the whole arm [m].
    """

    stamp_s: float
    angular_velocity: Array
    linear_acceleration: Array
    orientation: Array | None
    s: float

    @property
    def sensor(self) -> str:
        """Name under which stamps and outliers are counted."""
        return imu_sensor(self.s)

    def finite(self) -> bool:
        """Whether all numbers can be measured and the orientation, if any, is a rotation."""
        return (
            math.isfinite(self.stamp_s)
            and math.isfinite(self.s)
            and _length(self.angular_velocity, 3) < _MOST
            and _length(self.linear_acceleration, 3) < _MOST
            and (self.orientation is None or _is_rotation(self.orientation))
        )


Sample: TypeAlias = PoseSample | ImuSample


@lru_cache(maxsize=64)
def pose_sensor(s: float) -> str:
    """Return the name of the pose sensor at a place [m]."""
    return f"pose@{s:.9g}"


@lru_cache(maxsize=64)
def imu_sensor(s: float) -> str:
    """Return the name of the IMU at a place [m]."""
    return f"imu@{s:.9g}"


def _length(value: Array, n: int) -> float:
    """Return the length of a vector (n,), NaN of another shape; of so few numbers numpy's takes longer."""
    array = np.asarray(value)
    return math.hypot(*array.tolist()) if array.shape == (n,) else math.nan


def _is_rotation(quaternion: Array) -> bool:
    # The tolerance accepts quaternions of four decimals, and refuses the zeros of a driver without a fix.
    length = _length(quaternion, 4)
    return abs(length * length - 1.0) < 0.02  # a power of a large number would raise OverflowError
