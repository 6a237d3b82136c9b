"""Conversion between ROS messages and arrays."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseArray, PoseStamped, PoseWithCovarianceStamped
from numpy.typing import ArrayLike
from sensor_msgs.msg import Imu, JointState

from soro_core.arrays import Array
from soro_core.estimation.sensors.samples import ImuSample, PoseSample
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix

# Clocks of two computers differ by less.
_APART_NS = 1_000_000_000
# End of the times that a message can have: its seconds are of 32 bits [ns].
END_NS = 2**31 * 1_000_000_000
# No arm has larger numbers [m, rad, 1/s], and no chamber a larger pressure [Pa]: what is larger is damage,
# and its squares and products need not be finite.
_MOST, _MOST_PA = 1e6, 1e8
_LONGEST_SHOWN = 300


def to_time(stamp_ns: int) -> Time:
    """Return nanoseconds as a Time message."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds)


def to_ns(stamp: Time) -> int:
    """Return a Time message as nanoseconds, such that `to_time` gives one again."""
    return min(int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec), END_NS - 1)


def ahead(stamp_ns: int, now_ns: int) -> str:
    """Return how far a stamp is in the future, more than clocks of two computers differ; "" if it is not."""
    ahead_ns = stamp_ns - now_ns
    return f"{ahead_ns * 1e-9:.3f} s in the future" if ahead_ns > _APART_NS else ""


def doubles(values: ArrayLike) -> array[float]:
    """Return numbers for a field of a message, which checks each one of another sequence."""
    return array("d", np.asarray(values, dtype=np.float64).tobytes())


def is_possible(values: ArrayLike) -> bool:
    """Whether numbers of an arm [m, rad, 1/s, ...] are finite, and not larger than those of any arm."""
    return bool((np.abs(np.asarray(values, dtype=np.float64)) < _MOST).all())


def chambers(names: Sequence[str], pressure_pa: Array, stamp_ns: int) -> JointState:
    """Return set points or readings as the effort of a JointState.

    Parameters
    ----------
    names : sequence of str
    pressure_pa : ndarray (n_u,)
        Pressures [Pa gauge].
    stamp_ns : int
        Time of the message [ns].
    """
    message = JointState(name=list(names), effort=doubles(pressure_pa))
    message.header.stamp = to_time(stamp_ns)
    return message


def pressures(message: JointState, names: Sequence[str]) -> Array:
    """Efforts [Pa] in the order of `names`.

    Raises
    ------
    ValueError
        If the message names other chambers, or not one effort a name, or a pressure that no chamber has. NaN
        and infinity pass: they are those of a silent device.
    """
    if len(message.effort) != len(message.name):
        raise ValueError(f"{len(message.effort)} efforts for {len(message.name)} names")
    for name, value in zip(message.name, message.effort, strict=True):
        if _MOST_PA < abs(value) < math.inf:
            raise ValueError(f"{value:g} Pa in {name[:80]}; allowed: at most {_MOST_PA:g}")
    if list(message.name) == list(names):
        return np.array(message.effort, dtype=np.float64)
    given = dict(zip(message.name, message.effort, strict=True))
    if set(given) != set(names) or len(given) != len(message.name):
        raise ValueError(f"chambers {format_names(sorted(message.name))}; expected {sorted(names)}")
    return np.array([given[name] for name in names], dtype=np.float64)


def one_line(text: str) -> str:
    """Return a text, which may quote strings of a message, as one line of a log."""
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST_SHOWN else line[:_LONGEST_SHOWN] + " ..."


def format_names(names: Sequence[str]) -> str:
    """Return names for a line of a log, of which a message may have any number, of any length."""
    return one_line(str(list(names[:20])))


def without_reading(pressure_pa: Array, names: Sequence[str]) -> str:
    """Return the chambers whose reading [Pa gauge] is NaN, as of a silent device; empty if there is none."""
    if math.isfinite(float(pressure_pa.sum())):
        return ""
    return ", ".join(name for name, known in zip(names, np.isfinite(pressure_pa), strict=True) if not known)


def readings(message: JointState, names: Sequence[str]) -> Array:
    """Readings (n_u,) [Pa gauge] of a message on chambers/state, in the order of `names`.

    Raises
    ------
    ValueError
        As `pressures`, and if a chamber has no finite reading.
    """
    found = pressures(message, names)
    if silent := without_reading(found, names):
        raise ValueError(f"no reading of {silent}")
    return found


def arm_state(names: Sequence[str], q: Array, qd: Array, force: Array, stamp_ns: int) -> JointState:
    """Return coordinates, rates and generalised force as a JointState.

    Parameters
    ----------
    names : sequence of str
    q, qd, force : ndarray (n_q,)
        Coordinates, rates and generalised force.
    stamp_ns : int
        Time of the message [ns].
    """
    message = JointState(name=list(names), position=doubles(q), velocity=doubles(qd), effort=doubles(force))
    message.header.stamp = to_time(stamp_ns)
    return message


def pose(position: Array, quaternion: Array) -> Pose:
    """Position [m] and quaternion (x, y, z, w) as a Pose."""
    message = Pose()
    message.position.x, message.position.y, message.position.z = (float(v) for v in position)
    o = message.orientation
    o.x, o.y, o.z, o.w = (float(v) for v in quaternion)
    return message


def pose_arrays(message: Pose) -> tuple[Array, Array]:
    """Position (3,) and quaternion (4,) x, y, z, w of a Pose."""
    p, o = message.position, message.orientation
    return np.array([p.x, p.y, p.z]), np.array([o.x, o.y, o.z, o.w])


def is_pose(message: Pose) -> bool:
    """Whether a Pose is one: finite, with a quaternion that can be a rotation."""
    position, quaternion = pose_arrays(message)
    return is_possible(position) and is_possible(quaternion) and bool(0.5 < quaternion @ quaternion < 2.0)


def efforts(message: JointState | None) -> dict[str, float]:
    """Return the efforts of a message by name; empty without a message, or with one that has not as many."""
    if message is None or len(message.name) != len(message.effort):
        return {}
    return dict(zip(message.name, message.effort, strict=True))


def transform(message: Pose) -> Array:
    """Homogeneous transform (4, 4) of a Pose; the inverse of `pose_of`."""
    position, quaternion = pose_arrays(message)
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = matrix_from_quaternion(quaternion), position
    return found


def transforms(message: PoseArray) -> Array:
    """Homogeneous transforms (n, 4, 4) of a PoseArray."""
    return np.array([transform(pose) for pose in message.poses]).reshape(-1, 4, 4)


def pose_of(transform: Array) -> Pose:
    """Homogeneous transform (4, 4) as a Pose."""
    return pose(transform[:3, 3], quaternion_from_matrix(transform[:3, :3]))


def pose_stamped(transform: Array, stamp_ns: int, frame: str) -> PoseStamped:
    """Return a homogeneous transform as a PoseStamped.

    Parameters
    ----------
    transform : ndarray (4, 4)
        Pose; positions [m].
    stamp_ns : int
        Time of the message [ns].
    frame : str
        Name of the frame.
    """
    message = PoseStamped(pose=pose_of(transform))
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), frame
    return message


def tip_estimate(transform: Array, covariance: Array, stamp_ns: int, frame: str) -> PoseWithCovarianceStamped:
    """Return the pose of the tip with its covariance.

    Parameters
    ----------
    transform : ndarray (4, 4)
        Pose; positions [m].
    covariance : ndarray (6, 6)
        Covariance of (position, rotation), the order of ROS [m^2, m rad, rad^2].
    stamp_ns : int
        Time of the message [ns].
    frame : str
        Name of the frame.
    """
    message = PoseWithCovarianceStamped()
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), frame
    message.pose.pose = pose_of(transform)
    message.pose.covariance = np.asarray(covariance, dtype=np.float64).reshape(36).tolist()
    return message


def pose_sample(sample: PoseSample, stamp_ns: int, frame: str) -> PoseStamped:
    """Return a pose sample as a PoseStamped.

    Parameters
    ----------
    sample : PoseSample
    stamp_ns : int
        Time of the message [ns].
    frame : str
        Name of the frame.
    """
    message = PoseStamped(pose=pose(sample.position, sample.quaternion))
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), frame
    return message


def imu_sample(sample: ImuSample, stamp_ns: int, frame: str) -> Imu:
    """Return an IMU sample as an Imu message; one without orientation marks it by its covariance (REP 145).

    Parameters
    ----------
    sample : ImuSample
    stamp_ns : int
        Time of the message [ns].
    frame : str
        Name of the frame.
    """
    message = Imu()
    message.header.stamp, message.header.frame_id = to_time(stamp_ns), frame
    g, a, o = message.angular_velocity, message.linear_acceleration, message.orientation
    g.x, g.y, g.z = (float(v) for v in sample.angular_velocity)
    a.x, a.y, a.z = (float(v) for v in sample.linear_acceleration)
    if sample.orientation is None:
        message.orientation_covariance[0] = -1.0
    else:
        o.x, o.y, o.z, o.w = (float(v) for v in sample.orientation)
    return message


def imu_arrays(message: Imu) -> tuple[Array, Array, Array | None]:
    """Angular velocity (3,), specific force (3,) and orientation (4,) or None of an Imu message."""
    g, a, o = message.angular_velocity, message.linear_acceleration, message.orientation
    known = message.orientation_covariance[0] >= 0.0
    return (
        np.array([g.x, g.y, g.z]),
        np.array([a.x, a.y, a.z]),
        np.array([o.x, o.y, o.z, o.w]) if known else None,
    )
