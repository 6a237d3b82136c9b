"""What connects the work of a node, tick by tick, with its surroundings: a node in ROS, or a replay."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

from rclpy.node import Node
from rclpy.qos import QoSProfile


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


@dataclass(frozen=True)
class Ports:
    """Where messages and reports go, and the time.

    Attributes
    ----------
    publish : callable
        Takes the name of a topic and a message.
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


def publisher(node: Node, outputs: Mapping[str, tuple[type[Any], QoSProfile]]) -> Callable[[str, Any], None]:
    """Create the publishers of a node; return the function that publishes a message on one of them."""
    publishers = {
        topic: node.create_publisher(kind, topic, quality) for topic, (kind, quality) in outputs.items()
    }
    return lambda topic, message: publishers[topic].publish(message)
