"""`soro vent` where no readings come any more: the driver needs a command of zero before a reset."""

import rclpy

from soro_ros.nodes.controller import ControllerNode
from soro_ros.nodes.exciter import ExciterNode
from tests.soro_ros.direct import captured, request


def test_a_controller_that_hears_nothing_commands_zero_once_when_it_is_vented(domain):
    rclpy.init(args=["--ros-args", "-p", "enabled:=true"])
    node = ControllerNode()
    try:
        node.trigger_configure()
        node.trigger_activate()
        commands = captured(node, "chambers/command")
        assert request(node, "~/vent").success
        assert [list(one.effort) for one in commands] == [[0.0, 0.0, 0.0]]
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def test_an_exciter_that_hears_nothing_commands_zero_once_when_it_is_vented(domain):
    rclpy.init(args=["--ros-args", "-p", "pose_rate_hz:=100.0"])
    node = ExciterNode()
    try:
        node.trigger_configure()
        node.trigger_activate()
        commands = captured(node, "chambers/command")
        assert request(node, "~/vent").success
        assert [list(one.effort) for one in commands] == [[0.0, 0.0, 0.0]]
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
