"""The motion of the arm as its sensors show it: at rest, beyond its limits, or still."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from soro_core.arrays import Array
from soro_core.estimation.sensors.samples import ImuSample, PoseSample
from soro_core.rotation import matrix_from_quaternion, rotation_log
from soro_lab.excitation.config import MotionLimits

Sample: TypeAlias = PoseSample | ImuSample

# Half the default box, part of the arm's length.
BOX_PART = 1.0
# Samples in a row beyond a limit: a single one may be a swapped marker.
IN_A_ROW = 3
# Spread of the samples of an arm that is still, over that at rest, and the spread that counts as none: of
# positions [part of the length], of angular velocities [rad/s].
SPREAD, STILL_PART, STILL_RAD_S = 1.5, 5e-4, 5e-3


@dataclass(frozen=True)
class MotionCriteria:
    """What a motion is judged by.

    Attributes
    ----------
    config : MotionLimits
        Limits.
    length : float
        Length of the arm [m].
    has_pose : bool
        Whether there are pose sensors; without one the IMUs show rotations and whether the arm is still.
    """

    config: MotionLimits
    length: float
    has_pose: bool


@dataclass(frozen=True)
class AtRest:
    """What one sensor shows of the arm without pressure.

    Attributes
    ----------
    position : ndarray (3,) or None
        Mean position [m]; None of an IMU.
    rotation : ndarray (3, 3) or None
        Orientation; None of an IMU that gives none.
    up : ndarray (3,) or None
        Mean specific force of an IMU [m/s^2].
    spread : float
        Standard deviation of a component of `signal`.
    """

    position: Array | None
    rotation: Array | None
    up: Array | None
    spread: float


def at_rest(samples: Sequence[Sample]) -> AtRest:
    """Return what the samples of one sensor show of an arm that is at rest."""
    last, spread = samples[-1], _spread(samples)
    if isinstance(last, PoseSample):
        position = np.mean([one.position for one in samples if isinstance(one, PoseSample)], axis=0)
        return AtRest(position, matrix_from_quaternion(last.quaternion), None, spread)
    up = np.mean([one.linear_acceleration for one in samples if isinstance(one, ImuSample)], axis=0)
    turn = None if last.orientation is None else matrix_from_quaternion(last.orientation)
    return AtRest(None, turn, up, spread)


def beyond(motion: MotionCriteria, rest: AtRest, sample: Sample, outermost: bool) -> str:
    """Return which limit a sample is beyond, as one line; empty within all of them.

    Parameters
    ----------
    motion : MotionCriteria
    rest : AtRest
        The sensor at rest.
    sample : PoseSample or ImuSample
        Its sample.
    outermost : bool
        Whether the box is that of this sensor.
    """
    if isinstance(sample, PoseSample) and outermost and rest.position is not None:
        low, high = box_of(motion, rest.position)
        for axis, at, least, most in zip("xyz", sample.position, low, high, strict=True):
            if not least <= at <= most:
                return (
                    f"the tip left its box: {axis} {1e3 * at:.1f} mm, allowed {1e3 * least:.1f} to "
                    f"{1e3 * most:.1f} mm (box_m)"
                )
    angle, most_rad = turned(rest, sample), motion.config.bend_rad
    if angle > most_rad:
        allowed = f"allowed {math.degrees(most_rad):.0f} degrees (bend_rad)"
        return f"{_place(motion, sample)} turned by {math.degrees(angle):.0f} degrees, {allowed}"
    return ""


def box_of(motion: MotionCriteria, rest_m: Array) -> tuple[Array, Array]:
    """Return the lowest and the highest corner (3,) [m] of the box of a sensor that rests at `rest_m`."""
    box = motion.config.box_m
    if len(box) == 6:
        return np.array(box[:3]), np.array(box[3:])
    half = box[0] if box else BOX_PART * motion.length
    return rest_m - half, rest_m + half


def turned(rest: AtRest, sample: Sample) -> float:
    """Return the rotation of a sensor since the rest [rad]; without an orientation that of its vertical."""
    quaternion = sample.quaternion if isinstance(sample, PoseSample) else sample.orientation
    if quaternion is not None and rest.rotation is not None:
        turn = rest.rotation.T @ matrix_from_quaternion(quaternion)
        return float(np.linalg.norm(rotation_log(turn)))
    if isinstance(sample, ImuSample) and rest.up is not None:
        up = sample.linear_acceleration
        size = float(np.linalg.norm(up) * np.linalg.norm(rest.up))
        return math.acos(min(max(float(up @ rest.up) / size, -1.0), 1.0)) if size > 0.0 else 0.0
    return 0.0


def is_still(
    motion: MotionCriteria,
    rest: Mapping[str, AtRest],
    samples: Mapping[str, Sequence[Sample]],
    window_s: float,
) -> bool:
    """Return whether no sensor has moved over the last `window_s`, more than it does at rest.

    Parameters
    ----------
    motion : MotionCriteria
        Length, and which sensors count: poses where there are some.
    rest : mapping of str to AtRest
        The sensors at rest, by name.
    samples : mapping of str to sequence of samples
    window_s : float
        Time that they must cover [s].
    """
    judged = 0
    for name, last in samples.items():
        if name not in rest or isinstance(last[-1], PoseSample) != motion.has_pose:
            continue
        if last[-1].stamp_s - last[0].stamp_s < window_s:
            return False
        least = STILL_PART * motion.length if motion.has_pose else STILL_RAD_S
        if _spread(last) > max(SPREAD * rest[name].spread, least):
            return False
        judged += 1
    return judged > 0


def _spread(samples: Sequence[Sample]) -> float:
    """Return the standard deviation of a component of positions [m], of an IMU of its rates [rad/s]."""
    values = np.array([s.position if isinstance(s, PoseSample) else s.angular_velocity for s in samples])
    return float(values.std(axis=0).max())


def _place(motion: MotionCriteria, sample: Sample) -> str:
    kind = "pose" if isinstance(sample, PoseSample) else "IMU"
    return f"the {kind} at {sample.s / motion.length:.0%} of the length"
