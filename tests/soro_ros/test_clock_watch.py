"""Nodes with simulated time while /clock is silent."""

from types import SimpleNamespace

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from soro_ros.host import middleware
from soro_ros.nodes.shadow import ShadowNode
from soro_ros.process import clock_watch
from tests.soro_ros.direct import fire
from tests.soro_ros.running import wait_until


@pytest.fixture
def node(domain):
    middleware.init()
    node = Node("waiting")
    yield node
    node.destroy_node()
    rclpy.shutdown()


def test_a_clock_that_does_not_come_is_named_soon_and_then_rarely(node, capfd):
    now = SimpleNamespace(s=100.0)
    watch = clock_watch.ClockWatch(node, lambda: now.s)

    def said(seconds: int) -> list[str]:
        capfd.readouterr()
        for _ in range(seconds):
            watch.check()
            now.s += 1.0
        return [line for line in capfd.readouterr().err.splitlines() if "/clock" in line]

    assert said(200) == []  # without use_sim_time
    assert watch.has_time
    node.set_parameters([Parameter("use_sim_time", value=True)])
    assert not watch.has_time
    assert said(3) == []
    (line,) = said(50)
    assert "nobody publishes" in line
    assert len(said(120)) == 2

    clock = node.create_publisher(Clock, "/clock", 10)

    def ticks(seconds: int) -> None:
        clock.publish(Clock(clock=Time(seconds=seconds).to_msg()))
        rclpy.spin_once(node, timeout_sec=0.02)

    wait_until(lambda: node.count_publishers("/clock") == 1, "the publisher")
    assert "stands at 0" in said(60)[0]
    wait_until(lambda: ticks(7) or watch.has_time, "a time", every_s=0.0)
    assert said(200) == []


def test_every_node_warns(domain, capfd, monkeypatch):
    monkeypatch.setattr(clock_watch, "FIRST_S", 0.0)
    middleware.init(["--ros-args", "-p", "use_sim_time:=true"])
    try:
        node = ShadowNode()
        fire(node, 1.0)
        fire(node, 1.0)
        assert capfd.readouterr().err.count("waiting for /clock") == 1
    finally:
        rclpy.shutdown()
