"""The ROS side of a run: who is ready, what time it is, what went wrong, and the services that start it."""

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

# /diagnostics come once a second; a machine that is busy for so long cannot control anything either.
SILENT_S = 8.0
_COMMAND, _WANTED = "chambers/command", "arm/desired/tip"


class Supervisor:
    """Listens to /diagnostics, /clock and for what the controller first says; a context manager.

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
        self._firsts = {
            topic: self._node.create_subscription(kind, topic, partial(self._on_first, topic), qos.NEWEST)
            for topic, kind in ((_COMMAND, JointState), (_WANTED, PoseStamped))
        }
        self._heard_s: dict[str, float] = {}
        self._executor = EventsExecutor()
        self._executor.add_node(self._node)
        self.clock_s = 0.0
        self.status: dict[str, DiagnosticStatus] = {}
        self._heard: dict[str, set[str]] = {}  # processes that call themselves by a name
        self._said_s: dict[str, float] = {}

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
        for topic in (
            self._heard_s.keys() & self._firsts.keys()
        ):  # one was enough: they come at the loop's rate
            self._node.destroy_subscription(self._firsts.pop(topic))

    @property
    def commanded(self) -> bool:
        """Whether the controller has commanded anything, be it zero: then readings and estimates reach it."""
        return _COMMAND in self._heard_s

    @property
    def controlled_s(self) -> float:
        """Wall time [s] since the controller's first set point; 0 before it."""
        return time.monotonic() - self._heard_s[_WANTED] if _WANTED in self._heard_s else 0.0

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

    def check_heard(self, names: Iterable[str]) -> None:
        """Raise NodeError if a node says nothing any more though its process lives."""
        for name in names:
            silent_s = time.monotonic() - self._said_s.get(name, math.inf)
            if silent_s > SILENT_S:
                raise NodeError(
                    name, f"{name}: has said nothing for {silent_s:.0f} s: it hangs or was stopped"
                )

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

    def check_clock(self) -> None:
        """Raise SoroError if a node of others sets /clock too: nodes in lockstep would follow both."""
        endpoints = self._node.get_publishers_info_by_topic("/clock")
        names = {f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in endpoints}
        if others := sorted(names - {f"{self._prefix}twin"}):
            raise SoroError(
                f"{', '.join(others)} sets /clock too in {services.domain(self._node)}: end it, or set a "
                "ROS_DOMAIN_ID of one's own"
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
                self.status[name], self._said_s[name] = status, time.monotonic()
                self._heard.setdefault(name, set()).add(self.values(name).get("pid", "unknown"))

    def _on_first(self, topic: str, message: object) -> None:
        self._heard_s.setdefault(topic, time.monotonic())

    def _on_clock(self, message: Clock) -> None:
        self.clock_s = messages.to_ns(message.clock) * 1e-9
