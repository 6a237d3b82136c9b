"""Poses that a sensor repeats under new stamps: refused once the arm has moved away from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from soro_core.estimation.config import PoseNoise
    from soro_core.estimation.samples import PoseSample

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class LastPose:
    """The last new pose of a sensor, and how far the prediction was from it then [m]."""

    position: Array
    quaternion: Array
    distance_m: float


def distance_m(sample: PoseSample, predicted: Array) -> float:
    """Return the distance [m] of a sample from the predicted pose (4, 4)."""
    return float(np.linalg.norm(sample.position - predicted[:3, 3]))


def is_frozen(last: LastPose | None, sample: PoseSample, predicted: Array, noise: PoseNoise) -> bool:
    """Whether a sample is equal to the bit to the last one although the prediction has moved away from it.

    A prediction that comes nearer has not moved: the filter converges to the sample. An arm at rest under a
    rounded or noise-free sensor does not move.

    Parameters
    ----------
    last : LastPose or None
        Last new pose of this sensor.
    sample : PoseSample
        The new one.
    predicted : ndarray (4, 4)
        Predicted pose at the place of the sensor.
    noise : PoseNoise
        Deviations of the sensor.
    """
    if last is None or not is_repeated(last, sample):
        return False
    return distance_m(sample, predicted) > last.distance_m + noise.position_std_m


def is_repeated(last: LastPose, sample: PoseSample) -> bool:
    """Whether a sample is equal to the bit to the last new one."""
    return bool(
        np.array_equal(last.position, sample.position) and np.array_equal(last.quaternion, sample.quaternion)
    )
