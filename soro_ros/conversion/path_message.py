"""The poses of a message with a path, in the world."""

from __future__ import annotations

import numpy as np
from nav_msgs.msg import Path

from soro_core.errors import ConfigError
from soro_core.frames import Frames
from soro_core.robot import Robot
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix
from soro_ros.conversion import messages

# Square of the length below which a quaternion has no direction.
_SHORTEST = 1e-6


def poses_in_world(
    message: Path, topic: str, frames: Frames, robot: Robot
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return positions (n, 3) [m] and orientations (n, 4) in the world; None where none is stated.

    Parameters
    ----------
    message : Path
        In the world, or in the frame of the base, as is one that states none.
    topic : str
        Where it came from.
    frames : Frames
        Names of the two frames.
    robot : Robot
        Its base.

    Raises
    ------
    ConfigError
        If the path or one of its poses states another frame.
    """
    frame = message.header.frame_id
    for k, pose in enumerate(message.poses):
        if pose.header.frame_id not in ("", frame):
            allowed = f"{frame or 'none'}, as the path, or none"
            raise ConfigError(topic, f"poses[{k}].header.frame_id", pose.header.frame_id, allowed)
    if frame not in ("", frames.base, frames.world):
        allowed = f"{frames.base} (frames.base), or none, or {frames.world} (frames.world)"
        raise ConfigError(topic, "header.frame_id", frame, allowed)
    arrays = [messages.pose_arrays(pose.pose) for pose in message.poses]
    for k, (position, orientation) in enumerate(arrays):
        possible = messages.is_possible(position) and messages.is_possible(orientation)
        if not possible or (np.any(orientation) and orientation @ orientation < _SHORTEST):
            key = f"poses[{k}].pose"
            raise ConfigError(topic, key, "not finite, or out of any range", "a pose of an arm")
    positions = np.array([position for position, _ in arrays]).reshape(-1, 3)
    orientations = np.array([orientation for _, orientation in arrays]).reshape(-1, 4)
    if frame != frames.world and len(positions):
        base = matrix_from_quaternion(np.asarray(robot.base_quaternion, dtype=np.float64))
        positions = positions @ base.T + np.asarray(robot.base_position)
        orientations = _turned(base, orientations)
    # An orientation of zeros is one that was not stated.
    return positions, orientations if np.any(orientations) else None


def _turned(base: np.ndarray, orientations: np.ndarray) -> np.ndarray:
    """Orientations in the base as those in the world; zeros stay."""
    return np.array(
        [
            quaternion_from_matrix(base @ matrix_from_quaternion(one)) if np.any(one) else one
            for one in orientations
        ]
    )
