"""The ROS side of a run: who is ready, what time it is, what went wrong, and the services that start it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from soro_core.errors import SoroError
from soro_ros import messages, middleware, qos, services
from soro_ros.diagnostics import ERROR
from soro_ros.processes import NodeError


class Supervisor:
    """Listens to /diagnostics, /clock and for the first tip that the controller wants; a context manager.

    Parameters
    ----------
    namespace : str
        Of the robot's nodes.
    """

    def __init__(self, namespace: str) -> None:
        middleware.init()
        self._node = Node("supervisor", namespace=namespace)
        self._prefix = f"/{namespace}/"
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self._node.create_subscription(Clock, "/clock", self._on_clock, qos.RELIABLE)
        self._first = self._node.create_subscription(
            PoseStamped, "arm/desired/tip", self._on_wanted, qos.NEWEST
        )
        self._control_began: float | None = None
        self._executor = EventsExecutor()
        self._executor.add_node(self._node)
        self.clock_s = 0.0
        self.status: dict[str, DiagnosticStatus] = {}
        self._heard: dict[str, set[str]] = {}  # processes that call themselves by a name

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(self, *error: object) -> None:
        self._node.destroy_node()
        rclpy.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Take in what comes for a while."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)
        if self._first is not None and self._control_began is not None:
            self._node.destroy_subscription(self._first)  # one was enough: they come at the rate of the loop
            self._first = None

    @property
    def controlled_s(self) -> float:
        """Wall time [s] since the controller's first set point; 0 before it."""
        return 0.0 if self._control_began is None else time.monotonic() - self._control_began

    def active(self, name: str) -> bool:
        """Whether a node says that it is active."""
        return self.values(name).get("lifecycle") == "active"

    def values(self, name: str) -> dict[str, str]:
        """Latest diagnostic values of a node."""
        return {pair.key: pair.value for pair in self.status[name].values} if name in self.status else {}

    def check(self) -> None:
        """Raise NodeError if a node reports an error."""
        for name, status in self.status.items():
            if status.level == ERROR:
                raise NodeError(name, f"{name}: {status.message}")

    def check_alone(self, own: Mapping[str, int]) -> None:
        """Raise SoroError if another process has the name of one's own, as where two runs meet.

        Parameters
        ----------
        own : mapping of str to int
            Process ids by name of node.
        """
        for name, pid in own.items():
            if others := self._heard.get(name, set()) - {str(pid)}:
                raise SoroError(
                    f"another {self._prefix}{name} (process {', '.join(others)}) is in "
                    f"{services.domain(self._node)}: end that run, or set a ROS_DOMAIN_ID of one's own"
                )

    def wait(self, what: str, ready: Callable[[], bool], check: Callable[[], None], limit_s: float) -> None:
        """Spin until `ready`; `check` may raise what went wrong meanwhile.

        Raises
        ------
        SoroError
            When a node reports an error, or the time is over.
        """
        deadline = time.monotonic() + limit_s
        while not ready():
            self.spin(0.05)
            check()
            self.check()
            if time.monotonic() > deadline:
                raise SoroError(f"no {what} within {limit_s:.0f} s")

    def call(self, service: str, limit_s: float = 10.0) -> str:
        """Call a Trigger service of the robot's namespace and return its message.

        Raises
        ------
        SoroError
            If it is not there, does not answer, or refuses.
        """
        response = services.call(self._node, self.spin, Trigger, service, Trigger.Request(), limit_s)
        if not response.success:
            raise SoroError(f"{service}: {response.message}")
        return str(response.message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.startswith(self._prefix):
                name = status.name.removeprefix(self._prefix)
                self.status[name] = status
                self._heard.setdefault(name, set()).add(self.values(name).get("pid", "unknown"))

    def _on_wanted(self, message: PoseStamped) -> None:
        if self._control_began is None:
            self._control_began = time.monotonic()

    def _on_clock(self, message: Clock) -> None:
        self.clock_s = messages.to_ns(message.clock) * 1e-9
