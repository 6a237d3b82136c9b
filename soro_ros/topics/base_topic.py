"""The pose of a base that moves, on base/pose: for the simulated arm, and for the models of an arm on it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from geometry_msgs.msg import PoseStamped

from soro_core.arrays import Array
from soro_core.errors import ConfigError, ModelError
from soro_core.estimation import PoseSample
from soro_core.model import SoftArm
from soro_core.robot import Robot
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix
from soro_core.twin.followed_base import AT_REST, carried, place_base
from soro_ros.conversion import messages, qos
from soro_ros.topics.frame_check import FrameCheck
from soro_ros.topics.ports import Input, Inputs

BASE = "base/pose"
# Longest time without a pose, once one has come [ns]: a base that is not told any more is not known.
SILENT_NS = 500_000_000
# Ways that are kept for samples that come late.
_WAYS = 200


def base_input(
    frames: FrameCheck,
    now_ns: Callable[[], int],
    move: Callable[[Array], None],
    warn: Callable[[str], None],
) -> Inputs:
    """Return the input on base/pose.

    Parameters
    ----------
    frames : FrameCheck
        Refuses poses in another frame than the world.
    now_ns : callable
        Gives the time [ns] of stamps now; one of 0 counts as that of its arrival.
    move : callable
        Takes a pose (4, 4) in the world; raises ModelError on one that is too far.
    warn : callable
        Takes a line for each pose that is refused.
    """
    newest_ns = 0

    def take(message: PoseStamped) -> None:
        nonlocal newest_ns
        if not frames.takes_in_world(BASE, message.header.frame_id):
            return
        now = now_ns()
        stamp_ns = messages.to_ns(message.header.stamp) or now
        refused = messages.ahead(stamp_ns, now)
        if stamp_ns < newest_ns:
            refused = f"{1e-9 * (newest_ns - stamp_ns):.3f} s older than the last; allowed: in their order"
        if not messages.is_pose(message.pose):
            refused = "allowed: finite numbers, and a quaternion of length 1"
        if not refused:
            try:
                move(messages.transform(message.pose))
                newest_ns = stamp_ns
            except ModelError as error:
                refused = str(error)
        if refused:
            warn(f"{BASE} refused: {refused}")

    return {BASE: Input(PoseStamped, take, lambda _: qos.SENSOR)}


class ToldBase:
    """The base under the models of a node, which goes the way of the simulated one.

    Parameters
    ----------
    robot : Robot
        The robot of the models.
    arms : callable
        Gives the models of now.
    frames, now_ns, warn : FrameCheck, callable, callable
        As of `base_input`.

    Attributes
    ----------
    inputs : mapping of str to Input
        The topic.

    Raises
    ------
    ConfigError
        If the robot touches what is fixed in the world: what a law plans around it expects a base at rest.
    """

    def __init__(
        self,
        robot: Robot,
        arms: Callable[[], Sequence[SoftArm]],
        frames: FrameCheck,
        now_ns: Callable[[], int],
        warn: Callable[[str], None],
    ) -> None:
        self._arms, self._robot, self._now_ns = arms, robot, now_ns
        if self._robot.contacts is not None:
            allowed = "a robot without contacts, whose planes stand in the world"
            raise ConfigError(self._robot.name, "base_by_topic", "true", allowed)
        # Ways with the time of their begin: that of the last holds from then on.
        self._ways = deque([AT_REST], maxlen=_WAYS)
        self._first_ns = self._last_ns = 0
        self.inputs = base_input(frames, now_ns, self._move, warn)

    def _move(self, pose: Array) -> None:
        now_ns = self._now_ns()
        self._first_ns = self._first_ns or now_ns
        way = self._ways[-1].to_pose(self._seconds(now_ns), pose, self._robot)
        self._ways.append(way)
        self._last_ns = now_ns

    def _seconds(self, stamp_ns: int) -> float:
        return 1e-9 * (stamp_ns - self._first_ns)

    def place(self, stamp_ns: int) -> str:
        """Put the base of the models where it is at a time [ns]; return why that is not known, or ""."""
        if not self._last_ns:
            return ""  # as in the robot file until it is told
        silent_ns = stamp_ns - self._last_ns
        if silent_ns > SILENT_NS:
            return f"{BASE} silent for {1e-9 * silent_ns:.2f} s; allowed: at most {1e-9 * SILENT_NS:g} s"
        state = self._ways[-1](self._seconds(stamp_ns))
        for arm in self._arms():
            place_base(arm, state)
        return ""

    def carry(self, sample: PoseSample, sample_ns: int, stamp_ns: int) -> PoseSample:
        """Return a sample as it would be had the base been then where it is at `stamp_ns` [ns].

        The filter goes back to the time of a sample with the base of now.
        """
        if not self._last_ns:
            return sample
        then_s = self._seconds(sample_ns)
        way = next((way for way in reversed(self._ways) if way.since_s <= then_s), self._ways[0])
        now = carried(self._ways[-1](self._seconds(stamp_ns)), self._robot)
        by = now @ np.linalg.inv(carried(way(then_s), self._robot))
        turned = by[:3, :3] @ matrix_from_quaternion(np.asarray(sample.quaternion))
        place = by[:3, :3] @ sample.position + by[:3, 3]
        return replace(sample, position=place, quaternion=quaternion_from_matrix(turned))
