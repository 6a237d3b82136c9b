"""What connects the work of a node, tick by tick, with its surroundings: a node in ROS, or a replay."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile


class Input(NamedTuple):
    """One topic that is taken.

    Attributes
    ----------
    kind : type
        Class of its messages.
    take : callable
        Takes one message.
    quality : callable
        Gives its quality of service, in lockstep or not.
    """

    kind: type[Any]
    take: Callable[[Any], None]
    quality: Callable[[bool], QoSProfile]


Inputs: TypeAlias = Mapping[str, Input]


def ignore(*_: object) -> None:
    """Take anything, and do nothing."""


def _always(topic: str) -> bool:
    return True


@dataclass(frozen=True)
class NodeOutputs:
    """Where messages and reports go, and the time.

    Attributes
    ----------
    publish : callable
        Takes the name of a topic and a message.
    is_read : callable
        Takes the name of a topic and says whether anybody would have its message now.
    estimated : callable
        Called after an estimate has gone out, with its time [ns].
    fail : callable
        Takes why control has ended.
    now_ns : callable
        Gives the time [ns] that ages of messages count from.
    warn : callable
        Takes a line for the log.
    report : callable
        Takes what is wrong now, "" for nothing.
    refuse : callable
        Takes the reason of a refused reference, and whether it is the one of before.
    """

    publish: Callable[[str, Any], None]
    now_ns: Callable[[], int] = time.time_ns
    warn: Callable[[str], None] = ignore
    report: Callable[[str], None] = ignore
    refuse: Callable[[str, bool], None] = ignore
    is_read: Callable[[str], bool] = _always
    estimated: Callable[[int], None] = ignore
    fail: Callable[[str], None] = ignore


def subscribe(node: Node, inputs: Inputs, lockstep: bool) -> None:
    """Subscribe a node to topics.

    Parameters
    ----------
    node : Node
    inputs : mapping of str to Input
    lockstep : bool
        Whether its time is in lockstep.
    """
    for topic, (kind, take, quality) in inputs.items():
        node.create_subscription(kind, topic, take, quality(lockstep))


class Publishers:
    """The publishers of a node, by topic.

    Parameters
    ----------
    node : Node
    outputs : mapping of str to tuple
        Class of the messages and quality of service of each topic.
    """

    def __init__(self, node: Node, outputs: Mapping[str, tuple[type[Any], QoSProfile]]) -> None:
        self._publishers = {
            topic: node.create_publisher(kind, topic, quality) for topic, (kind, quality) in outputs.items()
        }

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message on a topic."""
        self._publishers[topic].publish(message)

    def is_read(self, topic: str) -> bool:
        """Whether the message of a topic would reach anybody, now or later."""
        return is_read(self._publishers[topic])


def is_read(publisher: Publisher) -> bool:
    """Whether a message would reach anybody: a subscription of now, or one that comes later."""
    if publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        return True
    return bool(publisher.get_subscription_count())
