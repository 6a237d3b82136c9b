"""Poses that a sensor repeats under new stamps: refused once the prediction has moved."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from soro_core.estimation.samples import PoseSample

Array: TypeAlias = NDArray[np.float64]

# Motions are forgotten with this time constant [s]: round-off of an arm at rest must not add up.
FORGET_S = 0.2


class LastPose(NamedTuple):
    """The last pose of a sensor.

    Attributes
    ----------
    sample : PoseSample
        As it came.
    after : ndarray (3,)
        Estimated position at its place, the sample fused [m].
    moved : ndarray (3,)
        Motion of the prediction while the sensor has repeated this pose, without the jumps of updates: a
        filter that follows a frozen sensor does not hide its own motion, and one that converges does not
        move [m].
    """

    sample: PoseSample
    after: Array
    moved: Array

    def is_frozen(self, deviation_m: float) -> bool:
        """Whether the prediction has moved by more than the sensor's own deviation [m]."""
        return math.hypot(*self.moved.tolist()) > deviation_m


def next_pose(last: LastPose | None, sample: PoseSample, predicted: Array) -> LastPose:
    """Return the record of a sample before it is fused.

    Parameters
    ----------
    last : LastPose or None
        That of the last sample of this sensor.
    sample : PoseSample
        The new one.
    predicted : ndarray (3,)
        Predicted position at its place [m].
    """
    if last is None or not _is_repeated(last.sample, sample):
        return LastPose(sample, predicted, np.zeros(3))
    kept = math.exp(-(sample.stamp_s - last.sample.stamp_s) / FORGET_S)
    return LastPose(sample, predicted, kept * last.moved + predicted - last.after)


def _is_repeated(one: PoseSample, other: PoseSample) -> bool:
    """Whether two poses are equal to the bit."""
    # As lists: of a few numbers this is far faster than numpy.
    if np.asarray(one.position).tolist() != np.asarray(other.position).tolist():
        return False
    return bool(np.asarray(one.quaternion).tolist() == np.asarray(other.quaternion).tolist())
