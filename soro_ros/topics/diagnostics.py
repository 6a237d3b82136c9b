"""/diagnostics: once a second, and at once when a level or a message changes."""

from __future__ import annotations

import os

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
# Message of a twin in lockstep whose time has ended.
OVER = "over"
# Where nothing is known of the hardware.
NONE = "unknown"


class Diagnostics:
    """Keeps the latest status of one node and publishes it.

    Parameters
    ----------
    node : Node
        Its fully qualified name becomes the name of the status.
    hardware_id : str
        What the status is about: devices, a robot, a bag.

    Attributes
    ----------
    level : bytes
        OK, WARN or ERROR, as the node has set it.
    message : str
        One line, as the node has set it.
    """

    def __init__(self, node: Node, hardware_id: str = "") -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.level, self.message, self._refused = OK, "starting", ""
        self._status = DiagnosticStatus(
            level=OK,
            name=node.get_fully_qualified_name(),
            message="starting",
            hardware_id=hardware_id or NONE,
        )
        self._values: dict[str, object] = {}
        self._lifecycle = "unconfigured"

    @property
    def status(self) -> DiagnosticStatus:
        """The latest status."""
        return self._status

    @property
    def hardware_id(self) -> str:
        """What the status is about."""
        return str(self._status.hardware_id)

    @hardware_id.setter
    def hardware_id(self, name: str) -> None:
        self._status.hardware_id = name or NONE

    def update(self, level: bytes, message: str, values: dict[str, object] | None = None) -> None:
        """Set the status; publish at once if its level or message is new.

        Parameters
        ----------
        level : bytes
            OK, WARN or ERROR.
        message : str
            One line.
        values : dict, optional
            Values of the status; the last ones by default.
        """
        self.level, self.message = level, message
        if values is not None:
            self._values = values
        self._renew()

    def refuse(self, text: str) -> None:
        """Warn, beside the status, of inputs that are refused now; an empty text ends the warning."""
        self._refused = text
        self._renew()

    def _renew(self) -> None:
        status, level, message = self._status, self.level, self.message
        if self._refused:
            level, message = (WARN if level == OK else level), f"{message}; {self._refused}"
        if (level, message) != (status.level, status.message):
            status.level, status.message = level, message
            self.publish()

    def lifecycle(self, state: str) -> None:
        """Note the node's lifecycle state, published as the value ``lifecycle``."""
        self._lifecycle = state
        self.publish()

    def publish(self) -> None:
        """Publish the latest status."""
        values = {"lifecycle": self._lifecycle, "pid": os.getpid(), **self._values}
        self._status.values = [KeyValue(key=key, value=_text(value)) for key, value in values.items()]
        array = DiagnosticArray(status=[self._status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
