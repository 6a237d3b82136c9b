"""The topics of the twin: samples of its sensors, the truth, and the clock in lockstep."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState

from soro_core.robot import Robot
from soro_core.twin import Observation, Twin, TwinState
from soro_ros.conversion import messages, qos
from soro_ros.topics.ports import is_read


class TwinTopics:
    """Publishers of samples and true state at one tick.

    Parameters
    ----------
    node : Node
        Owner of the topics.
    robot : Robot
        Robot with the names of the chambers.
    twin : Twin
        Twin with the names of the coordinates of its finer arm.
    profile : QoSProfile
        Quality of service of all topics but the clock.
    lockstep : bool
        Whether the twin sets the clock.
    """

    def __init__(self, node: Node, robot: Robot, twin: Twin, profile: QoSProfile, lockstep: bool) -> None:
        self._chamber_names = robot.chamber_names
        self._coordinate_names = twin.plant.arm.robot.coordinate_names
        self._frames = frames = twin.config.frames.within(node.get_namespace())
        self._imu_frames = {
            place * twin.length: frames.imu_name(k) for k, place in enumerate(twin.config.imu.locations)
        }
        self._poses, self._imus = (
            {
                place * twin.length: node.create_publisher(kind, f"sensors/{name}{k}", profile)
                for k, place in enumerate(config.locations)
            }
            for kind, name, config in (
                (PoseStamped, "pose", twin.config.pose),
                (Imu, "imu", twin.config.imu),
            )
        )
        self._true_tip = node.create_publisher(PoseStamped, "truth/tip", profile)
        self._true_state = node.create_publisher(JointState, "truth/state", profile)
        self._true_air = node.create_publisher(JointState, "truth/chambers", profile)
        self._clock = node.create_publisher(Clock, "/clock", qos.LOCKSTEP) if lockstep else None

    def publish_samples(self, seen: Observation, stamp_ns: int, sample_ns: Callable[[float], int]) -> None:
        """Publish the clock and the samples that arrive at this tick.

        Parameters
        ----------
        seen : Observation
            What the sensors gave.
        stamp_ns : int
            Time of the tick [ns].
        sample_ns : callable
            Gives the time [ns] of a sample from its `stamp_s` [s].
        """
        if self._clock is not None:
            self._clock.publish(Clock(clock=messages.to_time(stamp_ns)))
        for pose in seen.poses:
            message = messages.pose_sample(pose, sample_ns(pose.stamp_s), self._frames.of_poses)
            self._poses[pose.s].publish(message)
        for imu in seen.imus:
            frame = self._imu_frames[imu.s]
            self._imus[imu.s].publish(messages.imu_sample(imu, sample_ns(imu.stamp_s), frame))

    def publish_truth(self, state: TwinState, tip: np.ndarray, stamp_ns: int) -> None:
        """Publish the true state of arm and air.

        Parameters
        ----------
        state : TwinState
        tip : ndarray (4, 4)
            True pose of the tip.
        stamp_ns : int
            Time of the tick [ns].
        """
        arm, pressure = state.arm, state.air.pressure_pa
        force = np.zeros_like(arm.q)
        if is_read(self._true_tip):
            self._true_tip.publish(messages.pose_stamped(tip, stamp_ns, self._frames.world))
        if is_read(self._true_state):
            state_now = messages.arm_state(self._coordinate_names, arm.q, arm.qd, force, stamp_ns)
            self._true_state.publish(state_now)
        if is_read(self._true_air):
            self._true_air.publish(messages.chambers(self._chamber_names, pressure, stamp_ns))
