"""Times of the middleware (ADR 0014), between two processes: within one, Fast DDS takes a shorter way."""

from __future__ import annotations

import subprocess
import sys

import pytest
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import String

from soro_ros import middleware
from tests.ros.running import wait_until

_READER = """
import rclpy
from rclpy.node import Node
from std_msgs.msg import String
from soro_ros import middleware
middleware.init()
node = Node("reader", start_parameter_services=False)
node.create_subscription(String, "words", lambda message: None, 10)
rclpy.spin(node)
"""


@pytest.fixture
def reader(domain):
    process = subprocess.Popen([sys.executable, "-c", _READER], stderr=subprocess.DEVNULL)
    yield process
    process.kill()
    process.wait()


def test_a_reader_acknowledges_at_once_and_not_after_three_seconds(reader):
    """By the default period each would take up to 3 s, and 1.5 s in the mean."""
    middleware.init([])
    try:
        node = Node("writer", start_parameter_services=False)
        publisher = node.create_publisher(String, "words", 10)
        wait_until(publisher.get_subscription_count, 20, "the reader")
        taken = []
        for _ in range(6):
            publisher.publish(String(data="word"))
            taken.append(publisher.wait_for_all_acked(Duration(seconds=1.0)))
        node.destroy_node()
    finally:
        rclpy.shutdown()
    assert taken == [True] * 6
