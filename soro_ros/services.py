"""Services of nodes that run already: who offers one, what its /diagnostics say, and a call that ends."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection, Iterator
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from soro_core.errors import ConfigError, SoroError
from soro_ros import middleware

# Nodes are searched for this long [s]: with the times of Fast DDS itself one makes itself known every 3 s.
FIND_S = 4.0
# A wait is looked at this often, so that a Ctrl-C is heard.
_LOOK_S = 0.05


def call(
    node: Node, spin: Callable[[float], None], kind: Any, service: str, request: Any, limit_s: float
) -> Any:
    """Call a service and return its response.

    Parameters
    ----------
    node : Node
        Whose client it is.
    spin : callable
        Takes in what comes for the node during so many seconds.
    kind : type
        Of the service.

    Raises
    ------
    SoroError
        If it is not there, or does not answer in time.
    """
    calling = Call(node, kind, service, request)
    deadline = time.monotonic() + limit_s
    try:
        while not calling.done():
            spin(_LOOK_S)
            if time.monotonic() > deadline:
                raise SoroError(calling.trouble(limit_s))
        return calling.response
    finally:
        calling.close()


def domain(node: Node) -> str:
    """The ROS domain of a node, and where it comes from."""
    origin = "ROS_DOMAIN_ID" if os.environ.get("ROS_DOMAIN_ID") else "ROS_DOMAIN_ID is not set"
    return f"ROS domain {node.context.get_domain_id()} ({origin})"


class Call:
    """A call that goes out as soon as its service is there."""

    def __init__(self, node: Node, kind: Any, service: str, request: Any) -> None:
        self._node, self._service, self._request = node, service, request
        self._client = node.create_client(kind, service)
        self._future: Any = None

    def done(self) -> bool:
        """Send it if it can be sent; whether it is answered."""
        if self._future is None and self._client.service_is_ready():
            self._future = self._client.call_async(self._request)
        return self._future is not None and self._future.done()

    @property
    def response(self) -> Any:
        """The answer."""
        return self._future.result()

    def trouble(self, waited_s: float) -> str:
        """Why there is no answer yet."""
        found = "is not there" if self._future is None else f"did not answer within {waited_s:g} s"
        return f"service {self._service} {found}"

    def close(self) -> None:
        """Forget it."""
        self._node.destroy_client(self._client)


class Visitor:
    """A short-lived node that finds others and calls them; a context manager.

    Parameters
    ----------
    cancelled : callable
        Whether to end: every wait then raises KeyboardInterrupt.

    Raises
    ------
    ConfigError
        If ROS cannot be joined, for example by a ROS_DOMAIN_ID that is none.
    """

    def __init__(self, cancelled: Callable[[], bool]) -> None:
        self._cancelled = cancelled
        try:
            middleware.init()
        except rclpy_implementation.RCLError as error:
            rclpy.try_shutdown()
            said = str(error).removeprefix("failed to initialize rcl: ").split(", at ")[0]
            raise ConfigError("environment", "", said, "a ROS_DOMAIN_ID of 0 to 101, or none") from None
        self._node = Node(f"soro_{os.getpid()}", start_parameter_services=False, enable_rosout=False)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self._executor = EventsExecutor()
        self._executor.add_node(self._node)
        self.status: dict[str, DiagnosticStatus] = {}
        """Latest status by full name of node; each is published once a second."""

    def __enter__(self) -> Visitor:
        return self

    def __exit__(self, *error: object) -> None:
        self._node.destroy_node()
        rclpy.try_shutdown()

    @property
    def domain(self) -> str:
        """The ROS domain, and where it comes from."""
        return domain(self._node)

    def spin(self, seconds: float) -> None:
        """Take in what comes for a while."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            if self._cancelled():
                raise KeyboardInterrupt
            self._executor.spin_once(timeout_sec=min(left, _LOOK_S))

    def offering(self, service: str, publishing: str = "") -> list[str]:
        """Full names of the nodes known by now that offer ``~/service`` and publish a topic of that end."""
        return sorted(
            {
                full
                for name, namespace in self._node.get_node_names_and_namespaces()
                if self._offers(name, namespace, full := f"{namespace.rstrip('/')}/{name}", service)
                and self._publishes(name, namespace, publishing)
            }
        )

    def search(self, service: str, wanted: str, limit_s: float, publishing: str = "") -> Iterator[list[str]]:
        """Yield again and again which nodes are new that `offering` knows, for `FIND_S`.

        Parameters
        ----------
        wanted : str
            Full name, or its last parts; empty for any. A full name ends it.
        limit_s : float
            Of the search, if it is shorter.
        """
        seen: set[str] = set()
        deadline = time.monotonic() + min(limit_s, FIND_S)
        while time.monotonic() < deadline and wanted not in seen:
            known = self.offering(service, publishing)
            new = [name for name in known if name not in seen and _is_called(name, wanted)]
            seen.update(new)
            yield new
            self.spin(_LOOK_S)

    def begin(self, node: str, service: str, kind: Any, request: Any) -> Call:
        """Begin to call ``NODE/service``."""
        return Call(self._node, kind, f"{node}/{service}", request)

    def call(self, node: str, service: str, kind: Any, request: Any, limit_s: float) -> Any:
        """Call ``NODE/service``; raises SoroError where `call` does."""
        return call(self._node, self.spin, kind, f"{node}/{service}", request, limit_s)

    def says(self, node: str, limit_s: float) -> str:
        """What a node says of itself on /diagnostics; empty where it says nothing."""
        deadline = time.monotonic() + limit_s
        while node not in self.status and time.monotonic() < deadline:
            self.spin(_LOOK_S)
        return str(self.status[node].message) if node in self.status else ""

    def _offers(self, name: str, namespace: str, full: str, service: str) -> bool:
        return f"{full}/{service}" in self._asked(
            self._node.get_service_names_and_types_by_node, name, namespace
        )

    def _publishes(self, name: str, namespace: str, end: str) -> bool:
        topics = self._asked(self._node.get_publisher_names_and_types_by_node, name, namespace)
        return not end or any(topic.endswith(f"/{end}") for topic in topics)

    def _asked(self, question: Callable[..., list[tuple[str, list[str]]]], *node: str) -> Collection[str]:
        try:
            return [name for name, _ in question(*node)]
        except rclpy_implementation.NodeNameNonExistentError:  # it has gone meanwhile
            return []

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.status[status.name] = status


def _is_called(name: str, wanted: str) -> bool:
    return not wanted or name == wanted or name.endswith(f"/{wanted}")
