"""Frames on the arm: robot_description always, and /tf where the package tf2_msgs is installed."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import String

from soro_core.arrays import Array
from soro_core.model.soft_arm import SoftArm
from soro_lab.scene import EstimatorNodeConfig
from soro_ros.conversion import messages, qos
from soro_ros.conversion.arm_frames import ArmFrame, frames_of, urdf


class ArmTransforms:
    """Publishes which frames an arm has, where its base is in the world, and where they are at the base.

    Without tf2_msgs, which is no part of the wheels, the first alone.

    Parameters
    ----------
    node : Node
        Owner of the topics.
    arm : SoftArm
    config : EstimatorNodeConfig
        Names of the frames, places of the sensors, and whether /tf is wanted.
    """

    def __init__(self, node: Node, arm: SoftArm, config: EstimatorNodeConfig) -> None:
        self._arm, robot = arm, arm.robot
        names = config.frames.within(node.get_namespace())
        self._base_name = names.base
        self._frames = frames_of(robot, names, config.pose_locations, config.imu_locations)
        self._base = arm.pose(np.zeros(arm.n_q), 0.0)
        rest = np.zeros(arm.n_q)
        described = urdf(robot, names.base, self._frames, lambda frame: self._at_base(rest, frame))
        node.create_publisher(String, "robot_description", qos.LATCHED).publish(String(data=described))
        self._moving: Publisher | None = None
        if not config.publish_tf:
            return
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            node.get_logger().info("no /tf: the package tf2_msgs is not installed")
            return
        self._kind = TFMessage
        self._moving = node.create_publisher(TFMessage, "/tf", qos.RELIABLE)
        fixed = node.create_publisher(TFMessage, "/tf_static", qos.LATCHED)
        now_ns = node.get_clock().now().nanoseconds
        fixed.publish(TFMessage(transforms=[transform(self._base, now_ns, names.world, names.base)]))

    def publish(self, q: Array, stamp_ns: int) -> None:
        """Publish where the frames are at estimated coordinates (n_q,), and the time [ns] of these."""
        if self._moving is None:
            return
        moved = [
            transform(self._at_base(q, frame), stamp_ns, self._base_name, frame.name)
            for frame in self._frames
        ]
        self._moving.publish(self._kind(transforms=moved))

    def _at_base(self, q: Array, frame: ArmFrame) -> Array:
        return np.linalg.solve(self._base, self._arm.pose(q, frame.at_m)) @ frame.on_section


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
