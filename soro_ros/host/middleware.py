"""Settings with which soro's processes join ROS."""

from __future__ import annotations

import os
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import get_logger_level, set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import get_rmw_implementation_identifier

from soro_core.errors import ConfigError

_ENABLE = "ROS_SECURITY_ENABLE"


def check() -> None:
    """Refuse ROS_SECURITY_ENABLE=true (no other value enables it) with a middleware without security.

    Raises
    ------
    ConfigError
        One line with the error of the middleware.
    """
    if os.environ.get(_ENABLE) == "true" and (reason := _missing()):
        allowed = f"false, or none, with {get_rmw_implementation_identifier()} as it is here: {reason}"
        raise ConfigError("environment", _ENABLE, "true", allowed)


def _missing() -> str | None:
    """Return the error of the middleware for an empty keystore; None if it accepts it and has security."""
    context, level = Context(), get_logger_level("rcl")
    with tempfile.TemporaryDirectory() as keystore, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (Path(keystore) / "enclaves").mkdir()
        set_logger_level("rcl", LoggingSeverity.WARN)
        try:
            with _environment(ROS_SECURITY_KEYSTORE=keystore, ROS_SECURITY_STRATEGY="Permissive"):
                rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
                plain = Node("security", context=context, enable_rosout=False, start_parameter_services=False)
                plain.destroy_node()
        except rclpy_implementation.RCLError as error:
            return str(error).removeprefix("error creating node: ").splitlines()[0]
        finally:
            context.try_shutdown()
            set_logger_level("rcl", level)
    return None


@contextmanager
def _environment(**variables: str) -> Iterator[None]:
    before: Mapping[str, str | None] = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


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
    check()
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
