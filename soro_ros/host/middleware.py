"""Settings with which soro's processes join ROS."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from soro_ros.host import security

_THIS_HOST = Path(__file__).with_name("fastdds.xml")
_NETWORK = Path(__file__).with_name("fastdds_network.xml")
_PROFILES, _NEWER_PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"
_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
# A user who sets one of these has chosen how far messages go.
_REACH = (
    _TRANSPORTS,
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_DISCOVERY_SERVER",
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
)
CHOICES = (_PROFILES, _NEWER_PROFILES, *_REACH)
"""Variables of the middleware that a user may set."""
_arguments: list[str] = []
# Longest wait [s] for readers that have not taken everything when a node ends.
DELIVERY_S = 3.0


def init(args: list[str] | None = None) -> None:
    """Initialise rclpy without its signal handlers (ADR 0004), with soro's settings for the middleware.

    Raises
    ------
    ConfigError
        If the environment asks for security and the middleware has none.
    """
    os.environ.update(settings(os.environ))
    security.check()
    _arguments[:] = sys.argv if args is None else args
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)


def arguments() -> list[str]:
    """Return the command line of the last `init`; rclpy does not keep it."""
    return list(_arguments)


def settings(environment: Mapping[str, str]) -> dict[str, str]:
    """Variables to set for Fast DDS: no shared memory (ADR 0007), its times (ADR 0014), this host (ADR 0015).

    Only those that the user has not set; other middlewares do not read them.
    """
    chosen = any(environment.get(name) for name in _REACH)
    # The newer name is that of Fast DDS 3; the one of ROS 2 Jazzy does not read it.
    file = environment.get(_NEWER_PROFILES) or str(_NETWORK if chosen else _THIS_HOST)
    ours = {_PROFILES: file, _TRANSPORTS: "UDPv4"}
    return {name: value for name, value in ours.items() if not environment.get(name)}


def stall_warning() -> list[str]:
    """Return a line if this environment can delay a message by a third of a second (ADR 0007)."""
    if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper() != "LOCALHOST":
        return []
    return [
        "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST can delay a message by 0.3 s, and the valves then vent: "
        "unset it for runs in real time (docs/real_time.md)"
    ]


def deliver(node: Node) -> None:
    """Wait until every reader has received all messages; the end of a writer loses those under way."""
    deadline = time.monotonic() + DELIVERY_S
    for publisher in node.publishers:
        publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline - time.monotonic())))
