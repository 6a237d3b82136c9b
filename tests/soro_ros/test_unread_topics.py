"""In real time nothing is made for a topic that nobody reads; in lockstep a late reader has it all."""

from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState

from soro_ros.conversion import qos
from soro_ros.host import middleware
from soro_ros.ticks.control_report import ControlReport
from soro_ros.topics import ports
from tests.soro_ros.running import wait_until


@pytest.fixture
def node(domain):
    middleware.init([])
    node = Node("writer")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.parametrize("lockstep", [False, True])
def test_a_topic_counts_as_read_while_it_has_a_subscription_and_always_in_lockstep(node, lockstep):
    publishers = ports.Publishers(node, {"words": (JointState, qos.loop(lockstep))})
    assert publishers.is_read("words") == lockstep
    reader = node.create_subscription(JointState, "words", lambda message: None, 10)
    wait_until(lambda: publishers.is_read("words"), "a reader")
    node.destroy_subscription(reader)
    wait_until(lambda: publishers.is_read("words") == lockstep, "the end of the reader")


def test_a_report_makes_the_messages_of_read_topics_alone():
    # No estimates.
    command = SimpleNamespace(tip_reference=np.eye(4), configured_tip=None, terms={"model": np.ones(1)})
    found = {}
    report = ControlReport(["bend"], "world", found.__setitem__, lambda topic: topic == "controller/terms")
    report.publish(command, None, 5)
    assert list(found) == ["controller/terms"]
    assert found["controller/terms"].name == ["bend/model"]
