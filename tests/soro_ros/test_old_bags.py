"""Bags of version 0.2 and before: arm/covariance and arm/learned began with their stamp, as two numbers.

Nothing in them had the force on the arm.
"""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from soro_lab.bag import BagReader, BagWriter
from soro_lab.scene import load_scene
from soro_ros.conversion import learning, messages, qos
from soro_ros.conversion.interfaces import definition
from soro_ros.host import middleware
from soro_ros.recordings.replay import replay
from tests.patience import LIMIT_S
from tests.soro_ros.running import wait_until
from tests.warm import Popen

FOLDER = Path(__file__).parents[2] / "bags" / "two_links"
OLD = "std_msgs/msg/Float64MultiArray"
FORCE = (
    "*arm/wrench*",
    "*arm/covariance.effort*",
    "*arm/covariance.velocity*",
    "*arm/learned.velocity*",
    "*arm/learned.effort*",
)


def old(message):
    stamp_ns = messages.to_ns(message.header.stamp)
    return Float64MultiArray(data=[*divmod(stamp_ns, 10**9), *message.position])


@pytest.fixture
def before(tmp_path):
    """The kept bag with both topics as they were, whatever they are in it, and what they are today."""
    today = {f"/two_links/{name}": [] for name in learning.TOPICS}
    text = definition(OLD)
    with BagReader(FOLDER) as reader, BagWriter(tmp_path / "bag") as writer:
        kinds = {topic.name: topic.type for topic in reader.topics}
        for topic in reader.topics:
            then = replace(topic, type=OLD, definition=text.text, type_hash=text.type_hash)
            writer.add_topic(then if topic.name in today else topic)
        for item in reader.messages():
            data = item.data
            if item.topic in today:
                if kinds[item.topic] == OLD:
                    message = learning.from_array(deserialize_message(data, Float64MultiArray))
                else:
                    message = deserialize_message(data, JointState)
                    message.velocity, message.effort = [], []
                today[item.topic].append(message)
                data = bytes(serialize_message(old(message)))
            writer.write(item.topic, data, item.log_time_ns)
    assert all(len(found) > 100 for found in today.values())
    return tmp_path / "bag", today


@pytest.mark.slow
def test_it_is_replayed_as_one_of_today(before):
    bag, _ = before
    found = replay(bag, load_scene(FOLDER / "scene.yaml"), ignore=FORCE)
    assert found.same, [str(topic.first) for topic in found.topics]
    compared = {topic.topic: topic.compared for topic in found.topics}
    assert all(compared[f"/two_links/{name}"] >= 200 for name in learning.TOPICS)


@pytest.mark.process
def test_it_is_played_to_nodes_of_today(before, domain):
    bag, today = before
    heard = {name: [] for name in today}
    middleware.init()
    try:
        node = Node("reader")
        for name, found in heard.items():
            node.create_subscription(JointState, name, found.append, qos.REPLAY)
        settings = (f"bag:={bag}", "rate:=0.0", "wait_for_subscribers:=true", f"topics:={list(today)}")
        options = [part for one in settings for part in ("-p", one)]
        command = [sys.executable, "-m", "soro_ros.nodes.player", "--ros-args", *options]
        player = Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

        def complete():
            rclpy.spin_once(node, timeout_sec=0.1)
            return all(len(heard[name]) == len(today[name]) for name in today)

        try:
            wait_until(complete, "every message", every_s=0.0)
            said, _ = player.communicate(timeout=LIMIT_S)
            assert player.returncode == 0, said
        finally:
            player.kill()
            player.stdout.close()
        node.destroy_node()
    finally:
        rclpy.shutdown()
    assert heard == today
