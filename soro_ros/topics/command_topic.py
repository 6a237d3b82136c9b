"""A topic of commands: its messages, its publishers, and whether their messages can be distinguished."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile

from soro_core import safety
from soro_ros.topics.intra_process import HANDED_OVER

# Time between two queries of the graph [s]; a query takes some 50 us.
QUERY_S = 0.2
# Name in the graph of a node that is not yet known, or of a program without ROS.
_UNKNOWN = "_NODE_NAME_UNKNOWN_"


class CommandTopic:
    """A subscription that monitors its publishers.

    rclpy does not give the publisher of a message, only the number of the message among those of its
    publisher; the graph gives the publishers. Two publishers use the same name if its message numbers
    decrease while the topic has several publishers. The graph is queried every `QUERY_S`, and at the first
    message after a change of the number of publishers.

    Parameters
    ----------
    node : Node
        Node of the subscription.
    kind : type
        Type of the messages.
    topic : str
        Name of the topic.
    qos : QoSProfile
        Quality of service.
    name_of : callable
        Function that returns the publisher's name in a message.
    take : callable
        Called with each message and, if two publishers use its name, the reason to ignore it, else None.
    on_change : callable
        Called when `conflict` has changed.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        topic: str,
        qos: QoSProfile,
        name_of: Callable[[Any], str],
        take: Callable[[Any, str | None], None],
        on_change: Callable[[], None],
    ) -> None:
        self._node, self._topic = node, topic
        self._name_of, self._take, self._on_change = name_of, take, on_change
        self._matched = 0
        self._nodes: dict[bytes, str] = {}
        self._names = safety.Names()
        self.conflict: str | None = None
        """Names of the publishers, if there are several, in the order of their arrival; else None."""
        self._subscription = node.create_subscription(kind, topic, self._on_message, qos)
        node.create_timer(QUERY_S, self._query_graph, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_message(self, *received: Any) -> None:
        """Process a message with its publication number (None if unknown).

        The events executor of rclpy passes message and information as a pair, others as two arguments.
        """
        message, information = received[0] if len(received) == 1 else received
        number = information["publication_sequence_number"]
        matched = self._count()
        if matched is None:
            return
        if matched != self._matched:
            self._query_graph()
        name, before = self._name_of(message), self._names
        if information is HANDED_OVER:
            # The graph may know others, whose messages do not come here: of another quality of service.
            self._names = safety.note_message(before, name, None, 1)
        else:
            self._note(name, number)
        if name in self._names.shared - before.shared:
            # A publisher that has ended meanwhile does not count.
            self._query_graph()
            if not self._names.shared:
                self._note(name, number)
        self._take(message, self._doubt(name))

    # rclpy passes the information if the signature has this parameter.
    _on_message.__signature__ = inspect.signature(  # type: ignore[attr-defined]  # mypy knows no such attribute
        lambda self, message, information: None
    )

    def _count(self) -> int | None:
        """Return the number of publishers; None if the node was cleaned up meanwhile."""
        try:
            return self._subscription.get_publisher_count()
        except InvalidHandle:
            return None

    def _note(self, name: str, number: int | None) -> None:
        publishers = max(len(self._nodes), self._matched)
        self._names = safety.note_message(self._names, name, number, publishers)

    def _doubt(self, name: str) -> str | None:
        if name not in self._names.shared:
            return None
        given = f"the name {name!r} in header.frame_id" if name else "no name"
        return f"same name: {self.conflict or 'several publishers'}; two of them give {given}"

    def _query_graph(self) -> None:
        matched = self._count()
        if matched is None:
            return
        self._matched = matched
        found = {
            bytes(one.endpoint_gid): _full_name(one.node_namespace, one.node_name)
            for one in self._node.get_publishers_info_by_topic(self._subscription.topic_name)
        }
        if self._nodes.keys() - found.keys():
            self._names = safety.Names()
        self._nodes = {gid: found[gid] for gid in self._nodes if gid in found} | found
        count = len(self._nodes)
        several = f"{count} publishers of {self._topic}: {', '.join(self._nodes.values())}"
        before, self.conflict = self.conflict, several if count > 1 else None
        if self.conflict != before:
            self._node.get_logger().warning(self.conflict or f"{self._topic}: no second publisher any more")
            self._on_change()


def _full_name(namespace: str, name: str) -> str:
    return "a node without a known name" if name == _UNKNOWN else f"{namespace.rstrip('/')}/{name}"
