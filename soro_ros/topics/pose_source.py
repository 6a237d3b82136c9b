"""A measured pose from a topic, for commands without a node."""

from __future__ import annotations

import time

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.utilities import try_shutdown
from rclpy.validate_topic_name import validate_topic_name

from soro_core.errors import ConfigError, SoroError
from soro_ros.conversion import messages, qos
from soro_ros.host import middleware

FIRST_S = 10.0


class PoseSource:
    """Subscription to one PoseStamped topic; a context manager.

    Raises
    ------
    ConfigError
        If that cannot be a topic.
    SoroError
        If no pose arrives in the first seconds.
    """

    def __init__(self, topic: str) -> None:
        try:
            validate_topic_name(topic)
        except InvalidTopicNameException:
            allowed = "the name of a topic, /arm/sensors/pose0 or so"
            raise ConfigError("soro hil", "--pose", topic, allowed) from None
        middleware.init()
        self._node = Node("hil")
        self._node.create_subscription(PoseStamped, topic, self._on_pose, qos.SENSOR)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._position: np.ndarray | None = None
        deadline = time.monotonic() + FIRST_S
        while self.newest() is None:
            if time.monotonic() > deadline:
                self.__exit__()
                raise SoroError(f"no pose on {topic} for {FIRST_S:g} s: is its sensor's driver running?")
            time.sleep(0.01)

    def __enter__(self) -> PoseSource:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        try_shutdown()

    def newest(self) -> np.ndarray | None:
        """Newest position (3,) [m], without waiting."""
        self._executor.spin_once(timeout_sec=0.0)
        return self._position

    def _on_pose(self, message: PoseStamped) -> None:
        position, _ = messages.pose_arrays(message.pose)
        if messages.is_possible(position):
            self._position = position
