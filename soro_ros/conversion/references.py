"""References of a controller from messages on arm/reference/trajectory and arm/reference/tip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.duration import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soro_core.control import Controller, ControllerState, Reference
from soro_core.errors import ConfigError
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
