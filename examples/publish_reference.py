"""A node of your own: it leads the tip of a running arm (soro run track_circle) along a square.

python examples/publish_reference.py --ros-args -r __ns:=/track_circle
"""

import contextlib

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

CORNERS_M = ((0.008, 0.008), (-0.008, 0.008), (-0.008, -0.008), (0.008, -0.008))
HEIGHT_M, SIDE_S, RATE_HZ = 0.066, 3.0, 50.0


class Square(Node):
    """Publishes places on the square at an even speed."""

    def __init__(self):
        super().__init__("square")
        self.publisher, self.sides = self.create_publisher(PoseStamped, "arm/reference/tip", 10), 0.0
        self.create_timer(1.0 / RATE_HZ, self.publish)

    def publish(self):
        """Publish the next place; messages within a second of each other are a stream."""
        side, part = int(self.sides) % 4, self.sides % 1.0
        begin, end = CORNERS_M[side], CORNERS_M[(side + 1) % 4]
        pose = PoseStamped()
        pose.header.frame_id, pose.header.stamp = "world", self.get_clock().now().to_msg()
        x, y = (a + part * (b - a) for a, b in zip(begin, end, strict=True))
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = x, y, HEIGHT_M
        self.publisher.publish(pose)
        self.sides += 1.0 / (SIDE_S * RATE_HZ)


if __name__ == "__main__":
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Square())
