"""Faults of the emulated devices from ROS: a topic that takes them as text, and a service that ends them."""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from soro_core.errors import SoroError
from soro_core.hardware.emulation.control import ControlClient
from soro_core.hardware.emulation.faults import CLEAR
from soro_ros import qos


class FaultInterface:
    """`~/fault` (a fault as YAML, like ``fault: stuck_open, chamber: link0/chamber1``) and `~/clear_faults`.

    Parameters
    ----------
    node : Node
        Owner of topic and service; what became of a fault goes to its log.
    path : str or Path
        Control socket of the emulator.
    """

    def __init__(self, node: Node, path: str | Path) -> None:
        self._node, self._client = node, ControlClient(path)
        node.create_subscription(String, "~/fault", self._on_fault, qos.RELIABLE)
        node.create_service(Trigger, "~/clear_faults", self._on_clear)

    def close(self) -> None:
        """Close the connection to the emulator."""
        self._client.close()

    def _on_fault(self, message: String) -> None:
        try:
            self._node.get_logger().warning(f"fault injected: {self._client.inject(message.data)}")
        except SoroError as error:
            self._node.get_logger().error(f"no fault injected: {error}")

    def _on_clear(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            self._client.inject(f"fault: {CLEAR}")
            response.success, response.message = True, "no faults"
        except SoroError as error:
            response.success, response.message = False, str(error)
        return response
