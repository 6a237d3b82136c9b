"""The domain of a test is empty after it, and the test leaves no real-time priority."""

import os
import threading

import pytest
import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

from soro_hardware import timing
from soro_ros.host import middleware
from tests.soro_ros.conftest import own_domain


def test_a_node_that_a_test_leaves_is_destroyed(tmp_path):
    with own_domain(tmp_path):
        middleware.init()
        left = Node("left")
        rclpy.shutdown()
        assert left.get_name() == "left", "it is there without its context"
    with pytest.raises(InvalidHandle):
        left.get_name()


def schedulers():
    """Of all threads of this process."""
    return {os.sched_getscheduler(int(thread)) for thread in os.listdir("/proc/self/task")}


@pytest.mark.parametrize("leave", ["the domain", "punctual"])
def test_a_real_time_priority_ends_in_every_thread(tmp_path, leave):
    if failure := timing.prioritise(1):
        pytest.skip(f"no right to a real-time priority: {failure}")
    timing.prioritise(0)
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    try:
        with own_domain(tmp_path) if leave == "the domain" else timing.punctual(1):
            timing.prioritise(1)
            assert schedulers() == {os.SCHED_FIFO}
        assert schedulers() == {os.SCHED_OTHER}
    finally:
        timing.prioritise(0)
        ended.set()
        thread.join()
