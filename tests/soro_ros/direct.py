"""Messages, requests and time given to the callbacks of a node directly, without discovery and executor."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import rclpy.node


@contextlib.contextmanager
def active(node_class: type[Any], *settings: str) -> Iterator[Any]:
    """Give an active node of a class, with parameters as ``name:=value``, in this process."""
    rclpy.init(args=["--ros-args", *(part for one in settings for part in ("-p", one))])
    try:
        node = node_class()
        assert node.trigger_configure().name == "SUCCESS", node.failure
        node.trigger_activate()
        yield node
        node.destroy_node()
    finally:
        rclpy.shutdown()


def receive(node: rclpy.node.Node, topic: str, message: Any, *information: Any) -> None:
    """Give a message to the node's subscription to a topic."""
    name = node.resolve_topic_name(topic)
    (subscription,) = [one for one in node.subscriptions if one.topic_name == name]
    subscription.callback(message, *information)


def request(node: rclpy.node.Node, service: str) -> Any:
    """Call a Trigger service of the node and return its response."""
    name = node.resolve_service_name(service)
    (found,) = [one for one in node.services if one.service_name == name]
    return found.callback(found.srv_type.Request(), found.srv_type.Response())


def captured(node: rclpy.node.Node, topic: str) -> list[Any]:
    """Return the list to which the messages of a topic go from now on; the node sends none of them."""
    found: list[Any] = []
    publisher = _publisher(node, topic)
    publisher.publish, publisher.get_subscription_count = found.append, lambda: 1
    return found


def after_publish(node: rclpy.node.Node, topic: str, call: Callable[[], object]) -> None:
    """Call a function after each message that the node publishes on a topic."""
    publisher = _publisher(node, topic)
    publish = publisher.publish
    publisher.publish = lambda message: (publish(message), call())


def _publisher(node: rclpy.node.Node, topic: str) -> Any:
    name = node.resolve_topic_name(topic)
    (found,) = [one for one in node.publishers if one.topic_name == name]
    return found


def fire(node: rclpy.node.Node, period_s: float) -> None:
    """Call the callback of the node's timer with this period."""
    (timer,) = [one for one in node.timers if one.timer_period_ns == round(period_s * 1e9)]
    timer.callback()


def values(node: Any) -> dict[str, str]:
    """Values that the node publishes on /diagnostics."""
    return {pair.key: pair.value for pair in node.diagnostics.status.values}
