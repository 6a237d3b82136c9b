"""The controller node in the test's own process."""

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from soro_ros.nodes.controller import ControllerNode


def test_a_refused_reference_is_forgotten_when_a_good_one_follows(domain):
    rclpy.init()
    try:
        node = ControllerNode()
        node.trigger_configure()
        node.trigger_activate()
        status = node.diagnostics.status
        names = ["link0/elongation", "link0/bending_x", "link0/bending_y"]
        good = JointTrajectory(joint_names=names, points=[JointTrajectoryPoint(positions=[0.1, 0.0, 0.0])])
        bad = JointTrajectory(joint_names=["x"], points=good.points)
        node._on_trajectory(bad)
        assert status.level == DiagnosticStatus.WARN
        assert "reference refused: trajectory: joint_names" in status.message
        node._on_trajectory(good)
        assert (status.level, status.message) == (DiagnosticStatus.OK, "active")
        # What else is wrong is told as well, and does not hide it once it is over.
        node._on_trajectory(bad)
        node._note("arm/state is old")
        assert "arm/state is old" in status.message
        node._note("")
        assert "reference refused" in status.message
        node._note("arm/state is old")
        node._on_trajectory(bad)
        node._on_trajectory(good)
        assert (status.level, status.message) == (DiagnosticStatus.WARN, "arm/state is old")
        node.destroy_node()
    finally:
        rclpy.shutdown()
