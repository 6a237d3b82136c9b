"""The topics of the twin: samples of its sensors, truth of arm and bodies, what pushes on it, the clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.robot import Robot
from soro_core.twin import Observation, Twin, TwinState
from soro_core.twin.push import LARGEST_N, LARGEST_NM
from soro_ros.conversion import messages, qos
from soro_ros.conversion.force import force_of, torque_of, wrench
from soro_ros.topics.frame_check import FrameCheck
from soro_ros.topics.ports import is_read

if TYPE_CHECKING:  # a scene without bodies has none of their code
    from soro_core.bodies import RigidBody
    from soro_core.twin.bodies import BodyTick


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
        self._true_force = node.create_publisher(WrenchStamped, "truth/wrench", profile)
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

    def publish_truth(self, state: TwinState, seen: Observation, stamp_ns: int) -> None:
        """Publish the true state of arm and air, and what pushes on the arm.

        Parameters
        ----------
        state : TwinState
        seen : Observation
            True pose of the tip, and true forces.
        stamp_ns : int
            Time of the tick [ns].
        """
        arm, pressure = state.arm, state.air.pressure_pa
        force = np.zeros_like(arm.q)
        if is_read(self._true_tip):
            self._true_tip.publish(messages.pose_stamped(seen.tip, stamp_ns, self._frames.world))
        if is_read(self._true_state):
            state_now = messages.arm_state(self._coordinate_names, arm.q, arm.qd, force, stamp_ns)
            self._true_state.publish(state_now)
        if is_read(self._true_air):
            self._true_air.publish(messages.chambers(self._chamber_names, pressure, stamp_ns))
        if is_read(self._true_force):
            self._true_force.publish(wrench(seen.force_n, stamp_ns, self._frames.world))


PUSHED = "external/wrench"
_NOTHING = np.zeros(3), np.zeros(3)
# Age above which a wrench no longer acts [ns]: who holds the arm says so again and again.
PUSH_NS = 500_000_000


BASE = "base/pose"


class BaseTopic:
    """The pose of the base on base/pose, to which the base of the simulated arm goes.

    Parameters
    ----------
    node : Node
        Owner of the subscription.
    frames : FrameCheck
        Refuses poses in another frame than the world.
    now_ns : callable
        Gives the time [ns] of stamps now; one of 0 counts as that of its arrival.
    move : callable
        Takes a pose (4, 4) in the world; raises ModelError on one that is too far.
    """

    def __init__(
        self, node: Node, frames: FrameCheck, now_ns: Callable[[], int], move: Callable[[Array], None]
    ) -> None:
        self._node, self._frames, self._now_ns, self._move = node, frames, now_ns, move
        self._newest_ns = 0
        node.create_subscription(PoseStamped, BASE, self._on_pose, qos.SENSOR)

    def _on_pose(self, message: PoseStamped) -> None:
        if not self._frames.takes_in_world(BASE, message.header.frame_id):
            return
        now_ns = self._now_ns()
        stamp_ns = messages.to_ns(message.header.stamp) or now_ns
        refused = messages.ahead(stamp_ns, now_ns)
        if stamp_ns < self._newest_ns:
            refused = (
                f"{1e-9 * (self._newest_ns - stamp_ns):.3f} s older than the last; allowed: in their order"
            )
        if not messages.is_pose(message.pose):
            refused = "allowed: finite numbers, and a quaternion of length 1"
        if not refused:
            try:
                self._move(messages.transform(message.pose))
                self._newest_ns = stamp_ns
            except ModelError as error:
                refused = str(error)
        if refused:
            self._node.get_logger().warning(f"{BASE} refused: {refused}", throttle_duration_sec=1.0)


class PushTopic:
    """The wrench on external/wrench, which acts at the tip of the simulated arm.

    Parameters
    ----------
    node : Node
        Owner of the subscription.
    frames : FrameCheck
        Refuses wrenches in another frame than the world.
    now_ns : callable
        Gives the time [ns] of stamps now; one of 0 counts as that of its arrival.
    takes : bool
        Whether the arm can be pushed; one beside bodies is pushed by these alone.
    """

    def __init__(self, node: Node, frames: FrameCheck, now_ns: Callable[[], int], takes: bool = True) -> None:
        self._node, self.frames, self._now_ns, self._takes = node, frames, now_ns, takes
        self._newest = 0, *_NOTHING
        node.create_subscription(WrenchStamped, PUSHED, self._on_wrench, qos.SENSOR)

    def now(self) -> tuple[Array, Array]:
        """Force [N] and torque [N m] (3,) that act now, in the world."""
        stamp_ns, force, torque = self._newest
        return (force, torque) if self._now_ns() - stamp_ns <= PUSH_NS else _NOTHING

    def _on_wrench(self, message: WrenchStamped) -> None:
        if not self.frames.takes_in_world(PUSHED, message.header.frame_id):
            return
        force, torque, now_ns = force_of(message), torque_of(message), self._now_ns()
        stamp_ns = messages.to_ns(message.header.stamp) or now_ns
        refused = messages.ahead(stamp_ns, now_ns)
        if now_ns - stamp_ns > PUSH_NS:
            refused = f"{1e-9 * (now_ns - stamp_ns):.3f} s old; allowed: at most {1e-9 * PUSH_NS:g} s"
        # What is not finite is not less.
        if not ((np.abs(force) <= LARGEST_N).all() and (np.abs(torque) <= LARGEST_NM).all()):
            refused = f"allowed: at most {LARGEST_N:g} N and {LARGEST_NM:g} N m along each axis, finite"
        if not self._takes:
            refused = "allowed: in a scene without bodies"
        if refused:
            self._node.get_logger().warning(f"{PUSHED} refused: {refused}", throttle_duration_sec=1.0)
            return
        self._newest = stamp_ns, force, torque


CONTACTS = "bodies/contacts"


class BodyTopics:
    """Publishers of the truth of bodies.

    Each body has a topic of its own: a pose of a PoseArray has no name, and programs follow one body.

    Parameters
    ----------
    node : Node
        Owner of the topics.
    namespace : str
        Of the scene: ``/grasp_ball``.
    bodies : mapping of str to RigidBody
    profile : QoSProfile
        Quality of service.
    world : str
        Frame of the world.
    """

    def __init__(
        self, node: Node, namespace: str, bodies: Mapping[str, RigidBody], profile: QoSProfile, world: str
    ) -> None:
        self._world, place, names = world, f"{namespace.rstrip('/')}/bodies", list(bodies)
        self._joints = {
            name: (number, body.hinge, node.create_publisher(JointState, f"{place}/{name}/joint", profile))
            for number, (name, body) in enumerate(bodies.items())
            if body.hinge is not None
        }
        self._poses = [node.create_publisher(PoseStamped, f"{place}/{name}/pose", profile) for name in names]
        self._wrenches = [
            node.create_publisher(WrenchStamped, f"{place}/{name}/wrench", profile) for name in names
        ]
        self._contacts = node.create_publisher(JointState, f"{namespace.rstrip('/')}/{CONTACTS}", profile)

    def publish(self, now: BodyTick, stamp_ns: int) -> None:
        """Publish poses, joints, sums of contact forces about the centres, normal force of each contact.

        A joint has the angle that its encoder tells, the true rate, and the torque of its drive.
        """
        for name, (number, hinge, publisher) in self._joints.items():
            if not is_read(publisher):
                continue
            angle, rate = now.state.angle[number].tolist()
            if hinge.encoder_rad:
                angle = hinge.encoder_rad * round(angle / hinge.encoder_rad)
            message = JointState(name=[name], position=[angle], velocity=[rate])
            message.effort = [now.efforts.get(name, 0.0)]
            message.header.stamp = messages.to_time(stamp_ns)
            publisher.publish(message)
        for b, name in enumerate(now.names):
            if is_read(self._poses[b]):
                pose = np.eye(4)
                pose[:3, :3], pose[:3, 3] = now.state.rotation[b], now.state.place[b]
                self._poses[b].publish(messages.pose_stamped(pose, stamp_ns, self._world))
            if is_read(self._wrenches[b]):
                force, torque = now.wrench(name, now.state.place[b])
                self._wrenches[b].publish(wrench(force, stamp_ns, self._world, torque))
        if is_read(self._contacts):
            pairs = ["/".join(pair) for pair in now.pushes]
            normal = np.array([normal for _, _, normal in now.pushes.values()])
            self._contacts.publish(messages.chambers(pairs, normal, stamp_ns))
