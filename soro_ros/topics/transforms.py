"""Base and tip of the arm on /tf_static and /tf, where the package tf2_msgs is installed."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher

from soro_core.robot import Robot
from soro_core.rotation import matrix_from_quaternion
from soro_core.run_keys import Frames
from soro_ros.conversion import messages, qos


class ArmTransforms:
    """Publishes where the base is in the world, once, and where the tip is at the base.

    Without tf2_msgs, which is no part of the wheels, nothing is published.

    Parameters
    ----------
    node : Node
        Owner of the topics.
    robot : Robot
        Robot whose base stands in the world.
    frames : Frames
        Names of the frames.
    wanted : bool
        Whether anything is published.
    """

    def __init__(self, node: Node, robot: Robot, frames: Frames, wanted: bool) -> None:
        self._frames = frames
        self._tip: Publisher | None = None
        self._base = np.eye(4)
        self._base[:3, :3] = matrix_from_quaternion(np.array(robot.base_quaternion, dtype=np.float64))
        self._base[:3, 3] = robot.base_position
        if not wanted:
            return
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            node.get_logger().info("no /tf: the package tf2_msgs is not installed")
            return
        self._kind = TFMessage
        self._tip = node.create_publisher(self._kind, "/tf", qos.RELIABLE)
        fixed = node.create_publisher(self._kind, "/tf_static", qos.LATCHED)
        now_ns = node.get_clock().now().nanoseconds
        base = transform(self._base, now_ns, frames.world, frames.base)
        fixed.publish(self._kind(transforms=[base]))

    def publish(self, tip: np.ndarray, stamp_ns: int) -> None:
        """Publish the tip.

        Parameters
        ----------
        tip : ndarray (4, 4)
            Its pose in the world [m].
        stamp_ns : int
            Time of the estimate [ns].
        """
        if self._tip is None:
            return
        at_base = np.linalg.solve(self._base, tip)
        moved = transform(at_base, stamp_ns, self._frames.base, self._frames.tip)
        self._tip.publish(self._kind(transforms=[moved]))


def transform(pose: np.ndarray, stamp_ns: int, parent: str, child: str) -> TransformStamped:
    """Return a pose as a TransformStamped.

    Parameters
    ----------
    pose : ndarray (4, 4)
        Pose of the frame `child` in the frame `parent` [m].
    stamp_ns : int
        Time of the message [ns].
    parent, child : str
        Names of the frames.
    """
    stated, message = messages.pose_of(pose), TransformStamped(child_frame_id=child)
    message.header.stamp, message.header.frame_id = messages.to_time(stamp_ns), parent
    t, position = message.transform.translation, stated.position
    t.x, t.y, t.z = position.x, position.y, position.z
    message.transform.rotation = stated.orientation
    return message
