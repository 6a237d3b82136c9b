"""Services of running nodes: offers, search, diagnostics, and calls with a time limit."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.utilities import try_shutdown
from std_srvs.srv import Trigger

from soro_core.errors import ConfigError, SoroError
from soro_ros.host import middleware

# Time of a search for nodes [s]; by default Fast DDS announces a node every 3 s.
FIND_S = 4.0
# Period of a wait [s], after which Ctrl-C takes effect.
_POLL_S = 0.05


def answer(calling: Call, spin: Callable[[float], None], limit_s: float) -> Any:
    """Wait for the answer to a call, close it, and return the response.

    Parameters
    ----------
    calling : Call
    spin : callable
        Function that lets the node receive for a number of seconds.
    limit_s : float
        Time limit [s].

    Returns
    -------
    object
        Response.

    Raises
    ------
    SoroError
        If the service does not exist, or does not answer in time.
    """
    deadline = time.monotonic() + limit_s
    try:
        while not calling.done():
            spin(_POLL_S)
            if time.monotonic() > deadline:
                raise SoroError(calling.failure(limit_s))
        return calling.response
    finally:
        calling.close()


def domain(node: Node) -> str:
    """Return the ROS domain of a node, and its origin."""
    origin = "ROS_DOMAIN_ID" if os.environ.get("ROS_DOMAIN_ID") else "ROS_DOMAIN_ID is not set"
    return f"ROS domain {node.context.get_domain_id()} ({origin})"


class Call:
    """A call that is sent as soon as its service exists.

    Parameters
    ----------
    node : Node
        Node of the client.
    kind : type
        Type of the service.
    service : str
        Full name of the service.
    request : object
        Request.
    repeat_s : float
        Period [s] after which an unanswered request is sent again, where that does no harm: Fast DDS drops
        the answer to a client that the server has not found within 0.1 s, as on a busy machine.
    """

    def __init__(self, node: Node, kind: Any, service: str, request: Any, repeat_s: float = math.inf) -> None:
        self._node, self._service, self._request = node, service, request
        self._client = node.create_client(kind, service)
        self._repeat_s, self._sent_s = repeat_s, -math.inf
        self._futures: list[Any] = []

    def done(self) -> bool:
        """Send the request if the service exists; return whether it is answered."""
        is_due = not self._futures or time.monotonic() - self._sent_s > self._repeat_s
        if is_due and self._client.service_is_ready():
            self._sent_s = time.monotonic()
            self._futures.append(self._client.call_async(self._request))
        return any(future.done() for future in self._futures)

    @property
    def response(self) -> Any:
        """The first answer."""
        return next(future for future in self._futures if future.done()).result()

    def failure(self, waited_s: float) -> str:
        """Return why there is no answer yet."""
        found = f"did not answer within {waited_s:g} s" if self._futures else "is not there"
        return f"service {self._service} {found}"

    def close(self) -> None:
        """Destroy the client."""
        self._node.destroy_client(self._client)


class ServiceCaller:
    """A short-lived node that finds other nodes and calls their services; a context manager.

    Parameters
    ----------
    cancelled : callable
        Function that returns how often to end was asked for; each time a wait raises KeyboardInterrupt, and
        what is asked for after that is waited for again.

    Raises
    ------
    ConfigError
        If ROS cannot be joined, for example because ROS_DOMAIN_ID is not a number.
    """

    def __init__(self, cancelled: Callable[[], int]) -> None:
        self._cancelled, self._raised = cancelled, 0
        try:
            middleware.init()
        except rclpy_implementation.RCLError as error:
            try_shutdown()
            reason = str(error).removeprefix("failed to initialize rcl: ").split(", at ")[0]
            raise ConfigError("environment", "", reason, "a ROS_DOMAIN_ID of 0 to 101, or none") from None
        self._node = Node(f"soro_{os.getpid()}", start_parameter_services=False, enable_rosout=False)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self._executor = EventsExecutor()
        self._executor.add_node(self._node)
        self.status: dict[str, DiagnosticStatus] = {}
        """Latest status by full name of node; each is published once a second."""

    def __enter__(self) -> ServiceCaller:
        return self

    def __exit__(self, *error: object) -> None:
        self._executor.shutdown()  # it holds the node
        self._node.destroy_node()
        try_shutdown()

    @property
    def domain(self) -> str:
        """ROS domain of the node, and its origin."""
        return domain(self._node)

    def spin(self, seconds: float) -> None:
        """Receive messages for a time [s]."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0.0:
            if (asked := self._cancelled()) > self._raised:
                self._raised = asked
                raise KeyboardInterrupt
            self._executor.spin_once(timeout_sec=min(left, _POLL_S))

    def offering(self, service: str, publishing: str = "") -> list[str]:
        """Return the full names of known nodes with this service that publish a topic with this ending."""
        return sorted(
            {
                full
                for name, namespace in self._node.get_node_names_and_namespaces()
                if self._offers(name, namespace, full := f"{namespace.rstrip('/')}/{name}", service)
                and self._publishes(name, namespace, publishing)
            }
        )

    def search(self, service: str, wanted: str, limit_s: float, publishing: str = "") -> Iterator[list[str]]:
        """Yield the new nodes of `offering`, again and again, for at most `FIND_S`.

        Parameters
        ----------
        service : str
            Name of the service in the node.
        wanted : str
            Full name, or its last parts; "" for any. The search ends when a node with this full name is
            found.
        limit_s : float
            Time limit of the search [s].
        publishing : str
            Ending of a topic that the nodes publish; "" for any.

        Yields
        ------
        list of str
            Full names of nodes.
        """
        seen: set[str] = set()
        deadline = time.monotonic() + min(limit_s, FIND_S)
        while True:  # at least once, also after the deadline
            known = self.offering(service, publishing)
            called = (name for name in known if wanted in ("", name) or name.endswith(f"/{wanted}"))
            new = [name for name in called if name not in seen]
            seen.update(new)
            yield new
            if time.monotonic() >= deadline or wanted in seen:
                return
            self.spin(_POLL_S)

    @property
    def node(self) -> Node:
        """The caller's own node, for topics."""
        return self._node

    def begin(self, node: str, service: str, kind: Any, request: Any) -> Call:
        """Start to call ``NODE/service``; other parameters as in `Call`."""
        return Call(self._node, kind, f"{node}/{service}", request)

    def call(self, node: str, service: str, kind: Any, request: Any, limit_s: float) -> Any:
        """Call ``NODE/service`` and return its response; parameters as in `Call` and `answer`."""
        return answer(self.begin(node, service, kind, request), self.spin, limit_s)

    def message_of(self, node: str, limit_s: float) -> str:
        """Return the message of a node on /diagnostics; "" if there is none within `limit_s` [s]."""
        deadline = time.monotonic() + limit_s
        while node not in self.status and time.monotonic() < deadline:
            self.spin(_POLL_S)
        return str(self.status[node].message) if node in self.status else ""

    def _offers(self, name: str, namespace: str, full: str, service: str) -> bool:
        return f"{full}/{service}" in self._names(
            self._node.get_service_names_and_types_by_node, name, namespace
        )

    def _publishes(self, name: str, namespace: str, end: str) -> bool:
        topics = self._names(self._node.get_publisher_names_and_types_by_node, name, namespace)
        return not end or any(topic.endswith(f"/{end}") for topic in topics)

    def _names(self, question: Callable[..., list[tuple[str, list[str]]]], *node: str) -> Collection[str]:
        try:
            return [name for name, _ in question(*node)]
        except rclpy_implementation.NodeNameNonExistentError:  # the node has ended meanwhile
            return []

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.status[status.name] = status


def create_triggers(node: Node, actions: Mapping[str, Callable[[], str]]) -> None:
    """Offer services ~/NAME of a node, by name; a SoroError of their function is the reason of a refusal."""
    for name, action in actions.items():
        node.create_service(Trigger, f"~/{name}", _answering(action))


def _answering(action: Callable[[], str]) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.success, response.message = True, action()
        except SoroError as error:
            response.success, response.message = False, str(error)
        return response

    return answer
