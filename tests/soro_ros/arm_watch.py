"""A person beside a running arm: the pressures, the driver's latch, and what a person does after a trip."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from soro_core.errors import SoroError
from soro_ros.conversion import qos
from soro_ros.run.supervisor import RunMonitor
from soro_ros.status_words import VENTED
from soro_ros.topics.diagnostics import ERROR
from tests.patience import LIMIT_S
from tests.soro_ros.running import wait_until

PRESSED_PA, EMPTY_PA = 10e3, 2e3


class ArmWatch:
    """Hears the nodes of one namespace and calls their services.

    Parameters
    ----------
    namespace : str
    driver : str
        Name of the node that drives the valves.
    """

    def __init__(self, namespace: str, driver: str) -> None:
        self._driver, self.pressure_pa = driver, np.zeros(1)
        self.supervisor = RunMonitor(namespace)
        self._node = Node("watcher", namespace=namespace)
        self._node.create_subscription(JointState, "chambers/state", self._on_reading, qos.SENSOR)
        self.supervisor.add_node(self._node)

    def _on_reading(self, message: JointState) -> None:
        self.pressure_pa = np.array(message.effort)

    def until(self, condition: Callable[[], object], what: str, limit_s: float = LIMIT_S) -> None:
        """Receive messages until something is true."""
        wait_until(lambda: self.supervisor.spin(0.02) or condition(), what, limit_s, every_s=0.0)

    def under_control(self) -> bool:
        """Whether the arm is under pressure and nothing is latched."""
        return bool(self.pressure_pa.max() > PRESSED_PA) and not self.latched()

    def empty(self) -> bool:
        """Whether the last readings are those of a vented arm."""
        return bool(self.pressure_pa.max() < EMPTY_PA)

    def latched(self) -> str:
        """What the driver says of its latch; nothing while it is open."""
        status = self.supervisor.status.get(self._driver)
        closed = status is not None and status.level == ERROR and status.message.startswith(VENTED)
        return status.message if closed else ""

    def call(self, service: str) -> None:
        """Call a service until it is not refused; until a node is found again, that takes a moment."""

        def done() -> bool:
            with contextlib.suppress(SoroError):
                self.supervisor.call(service, LIMIT_S)
                return True
            return False

        self.until(done, service)

    def recover(self) -> None:
        """Call what `soro vent`, `soro reset` and `soro enable` call."""
        for service in ("controller/vent", f"{self._driver}/reset", "controller/enable"):
            self.call(service)

    def close(self) -> None:
        """Leave the domain."""
        self.supervisor.__exit__()
        self._node.destroy_node()
