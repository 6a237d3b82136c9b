"""Simulated time that does not come, or cannot be one: the node says so."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.clock import ROSClock
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

# Time without simulated time until the first warning, and between two [s].
FIRST_S, AGAIN_S = 3.0, 60.0


class ClockWatch:
    """Warns while a node has `use_sim_time` and no time, by the steady clock.

    Parameters
    ----------
    node : Node
    now_s : callable
        Gives the steady time [s].
    """

    def __init__(self, node: Node, now_s: Callable[[], float] = time.monotonic) -> None:
        self._node, self._now_s = node, now_s
        self._due_s: float | None = None  # time of the next warning; None while there is time

    @property
    def has_time(self) -> bool:
        """Whether the node's clock runs; without `use_sim_time` it always does."""
        clock = self._node.get_clock()
        is_simulated = isinstance(clock, ROSClock) and clock.ros_time_is_active
        return not is_simulated or clock.now().nanoseconds > 0

    def check(self) -> None:
        """Warn, if it is time to; to be called about once a second."""
        now_s = self._now_s()
        if self.has_time:
            self._due_s = None
        elif self._due_s is None:
            self._due_s = now_s + FIRST_S
        elif now_s >= self._due_s:
            self._due_s = now_s + AGAIN_S
            topic = self._node.resolve_topic_name("/clock")
            publishers = self._node.count_publishers(topic)
            found = "which nobody publishes" if not publishers else "where the time stands at 0"
            self._node.get_logger().warning(f"use_sim_time is true: waiting for {topic}, {found}")


def with_possible_time(node: Node, take: Callable[[Clock], None]) -> Callable[[Clock], None]:
    """Return a function that takes what comes on /clock, without times that rclpy raises an error of.

    Parameters
    ----------
    node : Node
        Its log says what is refused.
    take : callable
        Takes the others.
    """

    def checked(message: Clock) -> None:
        time_ = message.clock
        if time_.sec >= 0 and time_.nanosec < 1_000_000_000:
            take(message)
            return
        found = f"/clock refused: {time_.sec} s and {time_.nanosec} ns"
        allowed = "allowed: 0 s or later, and fewer than 1000000000 ns"
        node.get_logger().warning(f"{found}; {allowed}", throttle_duration_sec=1.0)

    return checked
