"""What a controller node reports of each tick: where the tip ought to be, and what the law has learned."""

from __future__ import annotations

from collections.abc import Sequence

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from soro_core.control.command import Command
from soro_ros import messages

# Frame of all poses.
FRAME = "world"


class ControlReport:
    """Publishes arm/desired/tip and the law's estimates, deviations and terms.

    Parameters
    ----------
    node : Node
        The controller node.
    coordinates : sequence of str
        Names of the coordinates.
    quality : QoSProfile
        Quality of service of the loop.
    """

    def __init__(self, node: Node, coordinates: Sequence[str], quality: QoSProfile) -> None:
        self._coordinates = coordinates
        self._tip = node.create_publisher(PoseStamped, "arm/desired/tip", quality)
        self._estimates = node.create_publisher(JointState, "controller/estimates", quality)
        self._deviations = node.create_publisher(JointState, "controller/deviations", quality)
        self._terms = node.create_publisher(JointState, "controller/terms", quality)

    def publish(self, command: Command, stamp_ns: int) -> None:
        """Publish what belongs to a command of this time [ns]."""
        self._tip.publish(messages.pose_stamped(command.tip_reference, stamp_ns, FRAME))
        terms = {
            f"{name}/{term}": float(value)
            for term, values in (command.terms or {}).items()
            for name, value in zip(self._coordinates, values, strict=True)
        }
        for publisher, values_by_name in (
            (self._estimates, command.estimates),
            (self._deviations, command.deviations),
            (self._terms, terms),
        ):
            message = JointState(name=list(values_by_name), position=list(values_by_name.values()))
            message.header.stamp = messages.to_time(stamp_ns)
            publisher.publish(message)
