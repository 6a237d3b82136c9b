"""Messages with huge finite numbers from another program, to the nodes of an arm in their own process."""

import signal
import subprocess
import sys

import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from soro_ros.conversion import messages, qos
from soro_ros.host import middleware
from tests.patience import COMPILED_S, LIMIT_S
from tests.soro_ros.running import end, wait_until
from tests.warm import Popen

pytestmark = pytest.mark.process

# What was refused, and how a line of the log says so.
SAID = ("samples of sensors refused", "arm/covariance refused")


@pytest.fixture
def stranger(domain):
    middleware.init()
    node = Node("stranger", namespace="one")
    yield node
    node.destroy_node()
    rclpy.shutdown()


def test_the_nodes_of_an_arm_live_say_so_and_go_on(stranger):
    settings = (
        "mode:=lockstep",
        "twin:pose.enabled:=true",
        "controller:platform:=''",
        "controller:enabled:=true",
    )
    options = [part for one in settings for part in ("-p", one)]
    command = [sys.executable, "-m", "soro_ros.nodes.arm", "--ros-args", "-r", "__ns:=/one", *options]
    pose, covariance = (
        stranger.create_publisher(kind, topic, qos.LOCKSTEP)
        for kind, topic in ((PoseStamped, "sensors/pose0"), (JointState, "arm/covariance"))
    )
    now_ns, commanded_ns = -1, -1

    def hear_clock(message):
        nonlocal now_ns
        now_ns = messages.to_ns(message.clock)

    def hear_command(message):
        nonlocal commanded_ns
        commanded_ns = messages.to_ns(message.header.stamp)

    stranger.create_subscription(Clock, "/clock", hear_clock, qos.LOCKSTEP)
    stranger.create_subscription(JointState, "chambers/command", hear_command, qos.LOCKSTEP)
    process = Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def heard(time_ns):
        rclpy.spin_once(stranger, timeout_sec=0.1)
        assert process.poll() is None, process.communicate()[1]
        return min(now_ns, commanded_ns) >= time_ns

    try:
        wait_until(lambda: heard(300_000_000), "a running loop", COMPILED_S, every_s=0.0)
        wait_until(lambda: pose.get_subscription_count() and covariance.get_subscription_count(), "readers")
        huge = PoseStamped()
        huge.header.stamp, huge.pose.orientation.w = messages.to_time(now_ns), 1e200
        pose.publish(huge)
        covariance.publish(JointState(position=[1e308, 0.0]))
        assert all(one.wait_for_all_acked(Duration(seconds=LIMIT_S)) for one in (pose, covariance))
        later_ns = now_ns + 1_000_000_000
        wait_until(lambda: heard(later_ns), "the loop later", every_s=0.0)
    finally:
        status, out, err = end(process, signal.SIGINT)
    assert status == 0, err
    assert "Traceback" not in err
    for words in SAID:
        assert sum(words in line for line in (out + err).splitlines()) == 1, err
