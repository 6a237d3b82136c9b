"""Faults of the emulated devices from ROS: as text by a topic or by the parameter service, which answers."""

from __future__ import annotations

from pathlib import Path

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String

from soro_core.errors import SoroError
from soro_hardware.emulation.faults.fault_types import CLEAR
from soro_hardware.emulation.sockets.control import ControlClient
from soro_ros.conversion import qos
from soro_ros.host.services import create_triggers

PARAMETER = "fault"


class FaultInterface:
    """A fault is YAML, like ``fault: stuck_open, chamber: link0/chamber1``.

    The topic `~/fault` takes one, and so does setting the parameter `fault`: a service that refuses one with
    the reason. The service `~/clear_faults` ends them all.

    Parameters
    ----------
    node : Node
        Owner of topic and service; its log records each fault.
    path : str or Path
        Control socket of the emulator.
    """

    def __init__(self, node: Node, path: str | Path) -> None:
        self._node, self._client = node, ControlClient(path)
        node.create_subscription(String, "~/fault", self._on_fault, qos.RELIABLE)
        create_triggers(node, {"clear_faults": self._on_clear})
        if not node.has_parameter(PARAMETER):
            node.declare_parameter(PARAMETER, "", ParameterDescriptor(description="fault to inject now"))
        node.add_on_set_parameters_callback(self._on_parameters)

    def close(self) -> None:
        """Close the connection to the emulator."""
        self._node.remove_on_set_parameters_callback(self._on_parameters)
        self._client.close()

    def _on_fault(self, message: String) -> None:
        self._inject(message.data)

    def _on_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        for change in changes:
            is_fault = change.name == PARAMETER and change.value
            if is_fault and (refusal := self._inject(str(change.value))):
                return SetParametersResult(successful=False, reason=refusal)
        return SetParametersResult(successful=True)

    def _inject(self, text: str) -> str:
        """Inject a fault; why it is refused, empty where it is not."""
        try:
            self._node.get_logger().warning(f"fault injected: {self._client.inject(text)}")
        except SoroError as error:
            self._node.get_logger().error(f"no fault injected: {error}")
            return str(error)
        return ""

    def _on_clear(self) -> str:
        self._client.inject(f"fault: {CLEAR}")
        return "no faults"
