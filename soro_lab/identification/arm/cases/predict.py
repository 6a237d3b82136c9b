"""What a sensor should show, for an arm in given coordinates and the frames of the measurement.

The frame of the tracker has the world of the robot at (R_t, p_t); the body that a tracker sees sits at
(R_b, o_b) on its cross-section (R, p):

    position = p_t + R_t (p + R o_b),   rotation = R_t R R_b.

An IMU states rotations in a world of its own, R_w R R_b. A camera that sees curvatures turns them and adds
those of the arm when straight (`MeasurementFrame`).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from soro_core.arrays import Array
from soro_core.model import SoftArm
from soro_core.robot import Robot
from soro_core.robot.coordinates import strain_fields
from soro_core.rotation import rotation_exp
from soro_lab.identification.frame import MeasurementFrame
from soro_lab.identification.recording.streams import Attitude, Bend, Curvature, Marker, Plate, Shape

Frames: TypeAlias = Mapping[str, float]


@singledispatch
def predict_measurement(shape: Shape, robot: Robot, arm: SoftArm, q: Array) -> Array:
    """Return what the arm does where a stream looks, whatever the frames of the measurement are.

    Parameters
    ----------
    shape : Plate, Marker, Curvature, Bend or Attitude
    robot : Robot
        Whose links the stream counts: those of the arm may be pieces of them.
    arm : SoftArm
    q : (n, n_q)
        Coordinates at its samples.

    Returns
    -------
    Array
        (n, 4, 4) poses of the cross-section of a plate, marker or attitude, (n, 2) mean curvatures [1/m],
        (n,) bending angles [rad].
    """
    raise TypeError(f"{type(shape).__name__}: allowed are the streams of `Shape`")


@predict_measurement.register(Plate)
@predict_measurement.register(Marker)
@predict_measurement.register(Attitude)
def _(shape: Plate | Marker | Attitude, robot: Robot, arm: SoftArm, q: Array) -> Array:
    return arm.poses(q, shape.place.along(robot))


@predict_measurement.register
def _(shape: Curvature, robot: Robot, arm: SoftArm, q: Array) -> Array:
    return np.column_stack([_mean(robot, arm, q, shape.link, s) for s in ("bending_x", "bending_y")])


@predict_measurement.register
def _(shape: Bend, robot: Robot, arm: SoftArm, q: Array) -> Array:
    length = robot.links[shape.link].length * (1.0 + _mean(robot, arm, q, shape.link, "elongation"))
    x, y = (_mean(robot, arm, q, shape.link, strain) for strain in ("bending_x", "bending_y"))
    return np.asarray((x * np.cos(shape.towards) + y * np.sin(shape.towards)) * length)


@singledispatch
def difference(shape: Shape, does: Array, frames: Frames) -> Array:
    """Return measured minus predicted, one row a sample.

    Parameters
    ----------
    shape : Plate, Marker, Curvature, Bend or Attitude
    does : Array
        Of `predict_measurement`.
    frames : mapping of str to float
        Numbers of `frame_numbers` by name; what is absent is 0.

    Returns
    -------
    Array
        (n, 6) position [m] and rotation vector [rad] of a plate, (n, 3) [m] of a marker, (n, 2) [1/m] of a
        curvature, (n, 1) [rad] of a bending angle, (n, 3) rotation vector [rad] of an attitude.
    """
    raise TypeError(f"{type(shape).__name__}: allowed are the streams of `Shape`")


@difference.register
def _(shape: Plate, does: Array, frames: Frames) -> Array:
    turn, _ = tracker(frames, shape.frame)
    predicted = turn @ does[:, :3, :3] @ rotation_exp(_vector(frames, f"{shape.name}/turn"))
    apart = Rotation.from_matrix(predicted).inv() * Rotation.from_quat(shape.quaternion)
    return np.column_stack([_position(shape, does, frames, np.zeros(3)), apart.as_rotvec()])


@difference.register
def _(shape: Marker, does: Array, frames: Frames) -> Array:
    known = np.zeros(3) if shape.offset is None else np.array(shape.offset)
    return _position(shape, does, frames, known)


@difference.register
def _(shape: Curvature, does: Array, frames: Frames) -> Array:
    at = f"frame/{shape.name}"
    offset = frames.get(f"{at}/offset_x", 0.0), frames.get(f"{at}/offset_y", 0.0)
    frame = MeasurementFrame(frames.get(f"{at}/turn", 0.0), offset)
    return np.asarray(shape.curvature - frame.apply(does))


@difference.register
def _(shape: Bend, does: Array, frames: Frames) -> Array:
    return np.asarray(shape.angle - does)[:, None]


@difference.register
def _(shape: Attitude, does: Array, frames: Frames) -> Array:
    world, mount = (rotation_exp(_vector(frames, f"{shape.name}/{key}")) for key in ("world", "turn"))
    apart = Rotation.from_matrix(world @ does[:, :3, :3] @ mount).inv() * Rotation.from_quat(shape.quaternion)
    return np.asarray(apart.as_rotvec())


def tracker(frames: Frames, name: str = "tracker") -> tuple[Array, Array]:
    """Rotation (3, 3) and position (3,) [m] of the world of the robot in the frame of a tracker."""
    return rotation_exp(_vector(frames, f"{name}/turn")), _vector(frames, f"{name}/offset")


def _position(shape: Plate | Marker, poses: Array, frames: Frames, known: Array) -> Array:
    turn, offset = tracker(frames, shape.frame)
    body = known + _vector(frames, f"{shape.name}/offset")
    return np.asarray(shape.position - (poses[:, :3, 3] + poses[:, :3, :3] @ body) @ turn.T - offset)


def _vector(frames: Frames, name: str) -> Array:
    return np.array([frames.get(f"frame/{name}_{axis}", 0.0) for axis in "xyz"])


def _mean(robot: Robot, arm: SoftArm, q: Array, link: int, strain: str) -> Array:
    """Mean strain (n,) over a link of the robot, of which the arm may have pieces of equal length."""
    fields, pieces = strain_fields(arm.robot), len(arm.robot.links) // len(robot.links)
    own = sum(fields.of(strain, link * pieces + k) for k in range(pieces))
    return np.asarray(q @ (own * fields.mean) / pieces)
