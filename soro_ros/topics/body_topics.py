"""The topics of the bodies of a scene: where each is, what pushes on it, and who touches whom."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from soro_ros.conversion import messages
from soro_ros.conversion.force import wrench
from soro_ros.topics.ports import is_read

if TYPE_CHECKING:  # a scene without bodies has none of their code
    from soro_core.twin.bodies import BodyTick

CONTACTS = "bodies/contacts"


class BodyTopics:
    """Publishers of the truth of bodies.

    Each body has a topic of its own: a pose of a PoseArray has no name, and programs follow one body.

    Parameters
    ----------
    node : Node
        Owner of the topics.
    namespace : str
        Of the scene: ``/grasp_ball``.
    names : sequence of str
        Of the bodies.
    profile : QoSProfile
        Quality of service.
    world : str
        Frame of the world.
    """

    def __init__(
        self, node: Node, namespace: str, names: Sequence[str], profile: QoSProfile, world: str
    ) -> None:
        self._world, place = world, f"{namespace.rstrip('/')}/bodies"
        self._poses = [node.create_publisher(PoseStamped, f"{place}/{name}/pose", profile) for name in names]
        self._wrenches = [
            node.create_publisher(WrenchStamped, f"{place}/{name}/wrench", profile) for name in names
        ]
        self._contacts = node.create_publisher(JointState, f"{namespace.rstrip('/')}/{CONTACTS}", profile)

    def publish(self, now: BodyTick, stamp_ns: int) -> None:
        """Publish poses, sums of contact forces about the centres, and the normal force of each contact.

        Parameters
        ----------
        now : BodyTick
        stamp_ns : int
            Time of the tick [ns].
        """
        for b, name in enumerate(now.names):
            if is_read(self._poses[b]):
                pose = np.eye(4)
                pose[:3, :3], pose[:3, 3] = now.state.rotation[b], now.state.place[b]
                self._poses[b].publish(messages.pose_stamped(pose, stamp_ns, self._world))
            if is_read(self._wrenches[b]):
                force, torque = now.wrench(name, now.state.place[b])
                self._wrenches[b].publish(wrench(force, stamp_ns, self._world, torque))
        if is_read(self._contacts):
            pairs = ["/".join(pair) for pair in now.pushes]
            normal = np.array([normal for _, _, normal in now.pushes.values()])
            self._contacts.publish(messages.chambers(pairs, normal, stamp_ns))
