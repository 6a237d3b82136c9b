"""References of a controller from the messages of its topics: trajectory, tip and path."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nav_msgs.msg import Path
from rclpy.duration import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soro_core.control import Controller, ControllerState, Reference
from soro_core.errors import ConfigError
from soro_core.robot import Robot
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix
from soro_core.run_keys import Frames
from soro_ros.conversion import messages

_ROWS = ("positions", "velocities", "accelerations")


def trajectory(
    controller: Controller, state: ControllerState, message: JointTrajectory, t: float
) -> Reference:
    """Return the reference of a trajectory.

    Parameters
    ----------
    controller : Controller
    state : ControllerState
        After the last tick.
    message : JointTrajectory
    t : float
        Time of the controller at the arrival [s].

    Raises
    ------
    SoroError
        If the controller refuses it.
    """
    points = message.points
    for k, point in enumerate(points):
        for name in _ROWS:
            if not messages.is_possible(np.nan_to_num(getattr(point, name), posinf=0.0, neginf=0.0)):
                key = f"points[{k}].{name}"
                raise ConfigError("trajectory", key, "a number out of any range", "numbers of an arm")

    def table(name: str) -> list[list[float]] | None:
        rows = [list(getattr(point, name)) for point in points]
        return rows if any(rows) else None

    return controller.trajectory(
        t,
        list(message.joint_names),
        [Duration.from_msg(point.time_from_start).nanoseconds * 1e-9 for point in points],
        table("positions") or [],
        table("velocities"),
        table("accelerations"),
        messages.to_ns(message.header.stamp),
        state,
    )


def tip(controller: Controller, state: ControllerState, message: PoseStamped, world: str) -> Reference:
    """Return the reference that holds the tip at a pose.

    Parameters
    ----------
    controller : Controller
    state : ControllerState
        After the last tick.
    message : PoseStamped
    world : str
        Name of the frame that the pose must state, where it states one.

    Raises
    ------
    SoroError
        If the pose is in another frame, or out of reach.
    """
    if message.header.frame_id not in ("", world):
        allowed = f"{world} (frames.world), or none"
        raise ConfigError("arm/reference/tip", "header.frame_id", message.header.frame_id, allowed)
    position, quaternion = messages.pose_arrays(message.pose)
    for key, values in (("position", position), ("orientation", quaternion)):
        if not messages.is_possible(np.nan_to_num(values, posinf=0.0, neginf=0.0)):
            where = f"pose.{key}"
            raise ConfigError("arm/reference/tip", where, "a number out of any range", "a pose of an arm")
    return controller.tip(state, position, quaternion)


def press(
    controller: Controller, state: ControllerState, message: WrenchStamped, topic: str, frames: Frames
) -> Reference:
    """Return the reference that presses with a wrench, without torque, in the world or the frame of the base.

    Parameters
    ----------
    controller : Controller
    state : ControllerState
        After the last tick.
    message : WrenchStamped
    topic : str
        Where it came from.
    frames : Frames
        Names of the two frames; a wrench without one is in the world.

    Raises
    ------
    SoroError
        If the wrench is in another frame, has a torque, or the controller refuses it.
    """
    frame, wrench = message.header.frame_id, message.wrench
    if frame not in ("", frames.base, frames.world):
        allowed = f"{frames.world} (frames.world), or none, or {frames.base} (frames.base)"
        raise ConfigError(topic, "header.frame_id", frame, allowed)
    force = np.array([wrench.force.x, wrench.force.y, wrench.force.z])
    torque = np.array([wrench.torque.x, wrench.torque.y, wrench.torque.z])
    if np.any(torque != 0.0):
        raise ConfigError(topic, "wrench.torque", torque.tolist(), "0: the tip presses with a force alone")
    if frame == frames.base and frame != frames.world:
        force = matrix_from_quaternion(np.asarray(controller.robot.base_quaternion)) @ force
    return controller.press(state, force)


def trajectories_at_rest(coordinates: Sequence[str]) -> list[JointTrajectory]:
    """Return one trajectory of zeros for each way to interpolate, for a warm-up."""
    zero = [0.0] * len(coordinates)
    found = []
    for count in range(1, len(_ROWS) + 1):
        rows = dict.fromkeys(_ROWS[:count], zero)
        times = [Duration(seconds=k).to_msg() for k in range(3)]
        points = [JointTrajectoryPoint(time_from_start=time, **rows) for time in times]
        found.append(JointTrajectory(joint_names=list(coordinates), points=points))
    return found


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
