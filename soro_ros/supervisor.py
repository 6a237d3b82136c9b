"""The ROS side of a run: state of the nodes, time, errors, and the services that start control."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from soro_core.errors import SoroError
from soro_ros import messages, middleware, qos, services
from soro_ros.diagnostics import ERROR
from soro_ros.processes import NodeError

# Nodes publish /diagnostics once a second; a machine that delays them for so long cannot control an arm.
SILENT_S = 8.0
_COMMAND, _DESIRED = "chambers/command", "arm/desired/tip"


class Supervisor:
    """Receives /diagnostics, /clock and the first messages of the controller; a context manager.

    Parameters
    ----------
    namespace : str
        Namespace of the robot's nodes.

    Attributes
    ----------
    node : Node
        The supervisor's own node.
    clock_s : float
        Latest time on /clock [s].
    status : dict of str to DiagnosticStatus
        Latest status by name of node.
    """

    def __init__(self, namespace: str) -> None:
        middleware.init()
        self.node = Node("supervisor", namespace=namespace)
        self._prefix = f"/{namespace}/"
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self.node.create_subscription(Clock, "/clock", self._on_clock, qos.RELIABLE)
        self._first_subscriptions = {
            topic: self.node.create_subscription(kind, topic, partial(self._on_first, topic), qos.NEWEST)
            for topic, kind in ((_COMMAND, JointState), (_DESIRED, PoseStamped))
        }
        self._first_s: dict[str, float] = {}  # wall time of the first message
        self._executor = EventsExecutor()
        self._executor.add_node(self.node)
        self.clock_s = 0.0
        self.status: dict[str, DiagnosticStatus] = {}
        self._pids: dict[str, set[str]] = {}  # processes that publish under the name of a node
        self._status_s: dict[str, float] = {}  # wall time of the latest status

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.shutdown()  # it keeps publishers of its nodes alive
        self.node.destroy_node()
        rclpy.try_shutdown()

    def add_node(self, node: Node) -> None:
        """Also receive the messages of another node."""
        self._executor.add_node(node)

    def spin_once(self, limit_s: float) -> None:
        """Receive the next message, within `limit_s` [s]."""
        self._executor.spin_once(timeout_sec=limit_s)

    def spin(self, seconds: float) -> None:
        """Receive messages for a time [s]."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)
        # The first message is enough; more come at the loop's rate.
        for topic in self._first_s.keys() & self._first_subscriptions.keys():
            self.node.destroy_subscription(self._first_subscriptions.pop(topic))

    @property
    def commanded(self) -> bool:
        """Whether the controller has sent a command, zero or not: readings and estimates then reach it."""
        return _COMMAND in self._first_s

    @property
    def controlled_s(self) -> float:
        """Wall time [s] since the controller's first set point; 0 before it."""
        return time.monotonic() - self._first_s[_DESIRED] if _DESIRED in self._first_s else 0.0

    def active(self, name: str) -> bool:
        """Whether a node reports that it is active."""
        return self.values(name).get("lifecycle") == "active"

    def values(self, name: str) -> dict[str, str]:
        """Latest diagnostic values of a node."""
        return {pair.key: pair.value for pair in self.status[name].values} if name in self.status else {}

    def check(self) -> None:
        """Raise NodeError if a node reports an error."""
        for name, status in self.status.items():
            if status.level == ERROR:
                raise NodeError(name, f"{name}: {status.message.removeprefix(f'{name}: ')}")

    def check_silence(self, names: Iterable[str]) -> None:
        """Raise NodeError if a node has stopped publishing /diagnostics though its process lives."""
        for name in names:
            silent_s = time.monotonic() - self._status_s.get(name, math.inf)
            if silent_s > SILENT_S:
                raise NodeError(
                    name, f"{name}: no message on /diagnostics for {silent_s:.0f} s: it hangs or was stopped"
                )

    def check_alone(self, own: Mapping[str, int]) -> None:
        """Raise SoroError if another process publishes under the name of one of the run's nodes.

        Parameters
        ----------
        own : mapping of str to int
            Process ids of the run's nodes, by name.
        """
        for name, pid in own.items():
            if others := self._pids.get(name, set()) - {str(pid)}:
                raise SoroError(
                    f"another {self._prefix}{name} (process {', '.join(others)}) is in "
                    f"{services.domain(self.node)}: end that run, or set a ROS_DOMAIN_ID of one's own"
                )

    def check_clock(self) -> None:
        """Raise SoroError if another node publishes /clock too: nodes in lockstep would follow both."""
        endpoints = self.node.get_publishers_info_by_topic("/clock")
        names = {f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in endpoints}
        if others := sorted(names - {f"{self._prefix}twin"}):
            raise SoroError(
                f"{', '.join(others)} publishes /clock too in {services.domain(self.node)}: end it, or set a "
                "ROS_DOMAIN_ID of one's own"
            )

    def wait(self, what: str, ready: Callable[[], bool], check: Callable[[], None], limit_s: float) -> None:
        """Spin until a condition holds.

        Parameters
        ----------
        what : str
            Description of the condition, for the error.
        ready : callable
            Function that returns whether the condition holds.
        check : callable
            Called while waiting; may raise an error.
        limit_s : float
            Time limit [s].

        Raises
        ------
        SoroError
            If a node reports an error, or the time is over.
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
        response = services.call(self.node, self.spin, Trigger, service, Trigger.Request(), limit_s)
        if not response.success:
            raise SoroError(f"{service}: {response.message}")
        return str(response.message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.startswith(self._prefix):
                name = status.name.removeprefix(self._prefix)
                self.status[name], self._status_s[name] = status, time.monotonic()
                self._pids.setdefault(name, set()).add(self.values(name).get("pid", "unknown"))

    def _on_first(self, topic: str, message: object) -> None:
        self._first_s.setdefault(topic, time.monotonic())

    def _on_clock(self, message: Clock) -> None:
        self.clock_s = messages.to_ns(message.clock) * 1e-9
