"""The controller node in the test's own process."""

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soro_ros.conversion import messages
from soro_ros.nodes.controller import ControllerNode
from tests.soro_ros.direct import receive

CHAMBERS = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]
TRAJECTORY = "arm/reference/trajectory"


def arm_state(node, names, age_s):
    """A message on arm/state: the straight arm at rest, some time ago."""
    zero = np.zeros(3)
    return messages.arm_state(
        names, zero, zero, zero, node.get_clock().now().nanoseconds - round(age_s * 1e9)
    )


def test_a_refused_reference_is_forgotten_when_a_good_one_follows(domain):
    rclpy.init(args=["--ros-args", "-p", "enabled:=true", "-p", "control.probe_at_enable:='off'"])
    try:
        node = ControllerNode()
        node.trigger_configure()
        node.trigger_activate()
        status = node.diagnostics.status
        names = ["link0/elongation", "link0/bending_x", "link0/bending_y"]
        good = JointTrajectory(joint_names=names, points=[JointTrajectoryPoint(positions=[0.1, 0.0, 0.0])])
        bad = JointTrajectory(joint_names=["x"], points=good.points)
        receive(node, TRAJECTORY, bad)
        assert status.level == DiagnosticStatus.WARN
        assert "reference refused: trajectory: joint_names" in status.message
        receive(node, TRAJECTORY, good)
        assert (status.level, status.message) == (DiagnosticStatus.OK, "active")
        # Another problem is reported beside it, and its end does not hide the refusal.
        receive(node, "chambers/state", messages.chambers(CHAMBERS, np.zeros(3), 0))
        receive(node, "arm/state", arm_state(node, names, age_s=0.0))
        receive(node, TRAJECTORY, bad)
        receive(node, "arm/state", arm_state(node, names, age_s=0.0))
        assert status.message.startswith("reference refused")
        receive(node, "arm/state", arm_state(node, names, age_s=5.0))
        assert status.message.startswith("no command: arm/state is")
        assert "reference refused" in status.message
        receive(node, "arm/state", arm_state(node, names, age_s=0.0))
        assert status.message.startswith("reference refused")
        receive(node, "arm/state", arm_state(node, names, age_s=5.0))
        receive(node, TRAJECTORY, good)
        assert status.level == DiagnosticStatus.WARN
        assert status.message.startswith("no command: arm/state is")
        assert "reference" not in status.message
        node.destroy_node()
    finally:
        rclpy.shutdown()
