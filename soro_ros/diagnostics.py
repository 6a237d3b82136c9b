"""/diagnostics: once a second, and at once when a level or a message changes."""

from __future__ import annotations

import os

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
# Begin of the message of a node that drives valves, while its latch is closed.
VENTED = "vented"


class Diagnostics:
    """Keeps the latest status of one node and publishes it.

    Parameters
    ----------
    node : Node
        Its fully qualified name becomes the name of the status.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._status = DiagnosticStatus(level=OK, name=node.get_fully_qualified_name(), message="starting")
        self._values: dict[str, object] = {}
        self._lifecycle = "unconfigured"

    @property
    def status(self) -> DiagnosticStatus:
        """The latest status."""
        return self._status

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
        changed = (level, message) != (self._status.level, self._status.message)
        self._status.level, self._status.message = level, message
        if values is not None:
            self._values = values
        if changed:
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
