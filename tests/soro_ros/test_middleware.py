"""Times of the middleware (ADR 0014), in processes of their own: Fast DDS reads its profiles once in each."""

from __future__ import annotations

import subprocess
import sys
from statistics import median

import pytest

pytestmark = pytest.mark.process

_NODE = """
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import String
from soro_ros.host import middleware
import rclpy, time
middleware.init()
node = Node("node", start_parameter_services=False)
"""
_READER = """
node.create_subscription(String, "words", lambda message: None, 10)
rclpy.spin(node)
"""
_WRITER = """
publisher = node.create_publisher(String, "words", 10)
while not publisher.get_subscription_count():
    time.sleep(0.02)
for _ in range(6):
    started = time.monotonic()
    publisher.publish(String(data="word"))
    assert publisher.wait_for_all_acked(Duration(seconds=60.0))
    print(time.monotonic() - started, flush=True)
"""


@pytest.fixture
def reader(domain):
    process = subprocess.Popen([sys.executable, "-c", _NODE + _READER])
    yield process
    process.kill()
    process.wait()


def test_a_reader_acknowledges_at_once_and_not_after_three_seconds(reader):
    """By the period that Fast DDS has by default, each would take up to 3 s."""
    writer = subprocess.run([sys.executable, "-c", _NODE + _WRITER], capture_output=True, text=True)
    took_s = [float(line) for line in writer.stdout.split()]
    assert len(took_s) == 6, writer.stderr
    assert median(took_s) < 1.0  # a machine that stands still once holds up one of them
