"""How soro's processes join ROS."""

from __future__ import annotations

import os
import time
from pathlib import Path

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

_PROFILES = Path(__file__).with_name("fastdds.xml")
# Longest wait [s] for readers that have not taken everything when a node ends.
DELIVERY_S = 3.0


def init(args: list[str] | None = None) -> None:
    """Initialise rclpy without its signal handlers (ADR 0004) and shared memory (ADR 0007), and with times of
    ours (ADR 0014).

    Who sets FASTDDS_BUILTIN_TRANSPORTS or FASTRTPS_DEFAULT_PROFILES_FILE has it their way.
    """
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(_PROFILES))
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)


def may_stall() -> str | None:
    """Why messages can be held up for a third of a second in this environment, or None (ADR 0007)."""
    if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper() != "LOCALHOST":
        return None
    return (
        "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST: a message can be held up for 0.3 s, at which valves vent: "
        "better unset in real time (docs/real_time.md)"
    )


def deliver(node: Node) -> None:
    """Wait until every reader has what the node published: what is on its way is lost with its writer."""
    deadline = time.monotonic() + DELIVERY_S
    for publisher in node.publishers:
        publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))
