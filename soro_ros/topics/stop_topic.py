"""The emergency stop as a topic: std_msgs/msg/Bool, true while it is pressed."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.utilities import ok, try_shutdown
from std_msgs.msg import Bool

from soro_core.safety import StopState, hear, why_stopped
from soro_hardware.platform import PlatformBase
from soro_ros.conversion import qos
from soro_ros.host import middleware

# Longest wait [s] for a message at the start: it takes some time until a publisher is found.
FIRST_S = 5.0


class StopTopic:
    """Subscription to the stop of a platform.

    Parameters
    ----------
    node : Node
        Node of the subscription.
    platform : PlatformBase
        Platform with a `stop_topic`.
    """

    def __init__(self, node: Node, platform: PlatformBase) -> None:
        self._name, self._timeout_s = platform.stop_topic, platform.stop_timeout_s
        self._state = StopState()
        # Volatile: what was true before this reader was there does not count.
        self._subscription = node.create_subscription(Bool, self._name, self._on_message, qos.SENSOR)

    def why_stopped(self) -> str | None:
        """Return why the arm must be vented, or None."""
        return why_stopped(self._state, self._name, self._timeout_s, time.monotonic_ns())

    def wait(self) -> None:
        """Wait until the stop is heard, at most `FIRST_S`, also where no executor runs the node yet."""
        deadline, handle = time.monotonic() + FIRST_S, self._subscription.handle
        while True:
            with handle:
                taken = handle.take_message(Bool, False)
            if taken is not None:
                self._on_message(taken[0])
                return
            if time.monotonic() > deadline:
                return
            time.sleep(0.01)

    def _on_message(self, message: Bool) -> None:
        self._state = hear(self._state, bool(message.data), time.monotonic_ns())


@contextlib.contextmanager
def reading_stop(platform: PlatformBase) -> Iterator[Callable[[], str | None]]:
    """Give a function that tells why `stop_topic` has the arm vented, for commands without a node."""
    if not (was_running := ok()):
        middleware.init()
    node = Node("stop_reader")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    stop = StopTopic(node, platform)

    def why() -> str | None:
        executor.spin_once(timeout_sec=0.0)
        return stop.why_stopped()

    try:
        stop.wait()
        yield why
    finally:
        executor.shutdown()
        node.destroy_node()
        if not was_running:
            try_shutdown()
