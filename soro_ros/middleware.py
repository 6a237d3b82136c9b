"""How soro's processes join ROS."""

from __future__ import annotations

import os

import rclpy
from rclpy.signals import SignalHandlerOptions


def init(args: list[str] | None = None) -> None:
    """Initialise rclpy without its signal handlers (ADR 0004) and without shared memory (ADR 0007).

    Who sets FASTDDS_BUILTIN_TRANSPORTS has it their way.
    """
    os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
