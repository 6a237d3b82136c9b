"""Motions along paths: arm/reference/path is planned between ticks, and arm/motion reports how it goes.

A plan takes some tenths of a second. It is made in slices after each command, while the node would wait for
the next state; in lockstep, which has no deadlines, it is made at once.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from nav_msgs.msg import Path

from soro_core.config import changed
from soro_core.control import Controller, ControllerState, Reference
from soro_core.control.following import Following, reference_ahead
from soro_core.control.motion import finished
from soro_core.control.motion_config import MotionConfig
from soro_core.control.motion_parts import Motion
from soro_core.control.path_coordinates import Planning
from soro_core.control.trajectory import Point
from soro_core.errors import ConfigError, SoroError
from soro_core.frames import Frames
from soro_core.rotation import matrix_from_quaternion, quaternion_from_matrix
from soro_ros import messages, qos
from soro_ros.diagnostics import ERROR, OK, WARN
from soro_ros.ports import Input, Inputs

TOPIC, STATUS = "arm/reference/path", "arm/motion"
# States of a motion; the last ones are its end.
PLANNING, MOVING = "planning", "moving"
REACHED, REFUSED, LOST, REPLACED, VENTED = "reached", "refused", "lost", "replaced", "vented"
# Part of a period, after a tick has begun, until which a plan is continued.
_SHARE = 0.5
# A motion that begins under way does so that long after its message [s]; twice as long each time that the
# plan was not ready.
_AHEAD_S, _LONGEST_S = 0.5, 8.0
# Time between two reports of progress [s].
_REPORT_S = 0.1


@dataclass
class _Job:
    """A motion from its message to its end."""

    stamp_ns: int
    positions: np.ndarray
    orientations: np.ndarray | None
    config: MotionConfig
    state: str = PLANNING
    steps: Planning[Motion] | None = None
    motion: Motion | None = None
    reported_s: float = -np.inf


class MotionTopic:
    """The topics of motions of a controller node.

    Parameters
    ----------
    controller : Controller
    lockstep : bool
        Plan at once.
    period_s : float
        Period of the loop [s].
    frames : Frames
        Names of the frames that a path may state.
    follow : callable
        Called with the motion at its begin.
    refuse : callable
        Called with the reason of a refusal, or an empty string after a path that is not refused.
    settings : callable
        Gives the section `motion` that counts from the next path on.
    publish : callable
        Takes the name of a topic and a message.

    Attributes
    ----------
    inputs : mapping of str to Input
    """

    outputs: ClassVar[dict[str, type[Any]]] = {STATUS: DiagnosticStatus}

    def __init__(
        self,
        controller: Controller,
        lockstep: bool,
        period_s: float,
        frames: Frames,
        follow: Callable[[Reference], None],
        refuse: Callable[[str], None],
        settings: Callable[[], MotionConfig],
        publish: Callable[[str, Any], None],
    ) -> None:
        self._controller, self._lockstep, self._settings, self._send = controller, lockstep, settings, publish
        self._period_s, self._frames, self._follow, self._refuse = period_s, frames, follow, refuse
        self._job: _Job | None = None
        self._replaced: _Job | None = None  # the one under way, while the next is planned
        self._message: Path | None = None
        self._now: tuple[ControllerState, float] | None = None  # state and time of the last tick
        self.inputs: Inputs = {TOPIC: Input(Path, self._on_path, qos.reference)}

    def use(self, controller: Controller) -> None:
        """Plan the next paths with another controller of the same arm."""
        self._controller = controller

    def warm_up(self, state: ControllerState, q: np.ndarray) -> None:
        """Plan a motion to `q` (n_q,) once without effect: imports and compilation outlast a tick."""
        arm, begin = self._controller.arm, Point(*np.zeros((3, len(q))))
        tips = np.array([arm.pose(x, arm.length)[:3, 3] for x in (begin.q, q)])
        with contextlib.suppress(SoroError):  # an arm that cannot move like this has done the same work
            finished(self._controller.planner(state, self._period_s).plan(begin, tips, None, 0.0))

    def cancel(self, state: str, text: str) -> None:
        """End the motion, if there is one, because of something else."""
        for job in (self._replaced, self._job):
            if job is not None and job.state in (PLANNING, MOVING):
                self._end(job, state, text)
        self._replaced = None

    def forget(self, state: str, text: str) -> None:
        """End the motion, if there is one, and wait for the next tick."""
        self.cancel(state, text)
        self._now = None

    def tick(self, state: ControllerState, t: float, tip: np.ndarray, begun_s: float) -> None:
        """Continue after a tick.

        Parameters
        ----------
        state : ControllerState
            After the tick.
        t : float
            Its time [s].
        tip : ndarray (3,)
            Estimated position of the tip [m].
        begun_s : float
            Monotonic time at which the tick began [s].
        """
        self._now = state, t
        job = self._job
        if job is None:
            return
        if job.state == PLANNING:
            self._plan(job, begun_s + _SHARE * self._period_s)
            self._begin(job, t)
        elif job.state == MOVING and job.motion is not None:
            self._judge(job, job.motion, t, tip)

    def _on_path(self, message: Path) -> None:
        active = self._job is not None and self._job.state in (PLANNING, MOVING, REACHED)
        if active and message == self._message:
            return  # a repeated message changes nothing
        stamp_ns = messages.to_ns(message.header.stamp)
        try:
            positions, orientations = self._poses(message)
            self._reached()
            job = _Job(stamp_ns, positions, orientations, self._settings())
            job.steps = self._steps(job)
        except SoroError as error:
            self._report_refusal(stamp_ns, error)
            return
        self._message = message
        if (
            self._job is not None and self._job.state == PLANNING
        ):  # one under way goes on until this one begins
            self._end(self._job, REPLACED, "by another path")
        if self._job is not None and self._job.state == MOVING:
            self._replaced = self._job
        self._job = job
        self._report(job, OK, "")
        if self._lockstep:
            self._plan(job, np.inf)

    def _poses(self, message: Path) -> tuple[np.ndarray, np.ndarray | None]:
        """Positions and orientations in the world."""
        frame, names = message.header.frame_id, self._frames
        for k, pose in enumerate(message.poses):
            if pose.header.frame_id not in ("", frame):
                allowed = f"{frame or 'none'}, as the path, or none"
                raise ConfigError(TOPIC, f"poses[{k}].header.frame_id", pose.header.frame_id, allowed)
        if frame not in ("", names.base, names.world):
            allowed = f"{names.base} (frames.base), or none, or {names.world} (frames.world)"
            raise ConfigError(TOPIC, "header.frame_id", frame, allowed)
        arrays = [messages.pose_arrays(pose.pose) for pose in message.poses]
        positions = np.array([position for position, _ in arrays]).reshape(-1, 3)
        orientations = np.array([orientation for _, orientation in arrays]).reshape(-1, 4)
        if frame != names.world and len(positions):
            robot = self._controller.robot
            base = matrix_from_quaternion(np.asarray(robot.base_quaternion, dtype=np.float64))
            positions = positions @ base.T + np.asarray(robot.base_position)
            orientations = _turned(base, orientations)
        # An orientation of zeros is one that was not stated.
        return positions, orientations if np.any(orientations) else None

    def _steps(self, job: _Job) -> Planning[Motion]:
        """Plan the path, then the way to it from the reference at the time of the motion's begin."""
        controller, (state, _, following) = self._controller, self._reached()
        planner = controller.planner(state, self._period_s)
        planner = replace(planner, config=changed(planner.config, motion=job.config))
        near = reference_ahead(controller.bounds, following, 0.0).q
        route = yield from planner.route(near, job.positions, job.orientations)
        ahead_s = _AHEAD_S
        while True:
            _, t, following = self._reached()
            now, later = (reference_ahead(controller.bounds, following, x) for x in (0.0, ahead_s))
            rests = _rests(now) and _rests(later)
            start_s = t if rests else t + ahead_s
            motion = yield from planner.motion(route, now if rests else later, start_s)
            _, t, _ = self._reached()
            if rests:
                return replace(motion, start_s=t)
            if t <= start_s or ahead_s >= _LONGEST_S:
                return motion
            ahead_s *= 2.0  # the way was planned too late: the arm is elsewhere

    def _reached(self) -> tuple[ControllerState, float, Following]:
        """State, time and reference of the last tick."""
        if self._now is None or self._now[0].following is None:
            raise ConfigError("path", "controller", "not in control", "a controller in control: soro enable")
        return *self._now, self._now[0].following

    def _plan(self, job: _Job, until_s: float) -> None:
        """Continue the plan until a monotonic time [s]."""
        try:
            while job.steps is not None:
                try:
                    next(job.steps)  # one at least, however late the tick is
                except StopIteration as end:
                    job.steps, job.motion = None, end.value
                if time.monotonic() >= until_s:
                    break
        except SoroError as error:
            job.steps = None
            self._job, self._replaced = self._replaced, None
            self._report_refusal(job.stamp_ns, error)

    def _begin(self, job: _Job, t: float) -> None:
        """Begin the planned motion when it is due."""
        if job.motion is None or t < job.motion.start_s:
            return
        if self._replaced is not None:
            self._end(self._replaced, REPLACED, "by another path")
            self._replaced = None
        job.state = MOVING
        self._follow(job.motion)
        self._refuse("")
        self._report(job, OK, job.motion.note, t)

    def _judge(self, job: _Job, motion: Motion, t: float, tip: np.ndarray) -> None:
        """Report progress, and whether the tip has come to the end."""
        goal = self._controller.arm.pose(motion.sample(motion.end_s).q, self._controller.robot.length)[:3, 3]
        off_m = float(np.linalg.norm(tip - goal))
        if t >= motion.end_s and off_m <= job.config.reached_m:
            self._end(job, REACHED, motion.note, t, off_m)
        elif t > motion.end_s + job.config.settle_s:
            text = f"the tip is {1e3 * off_m:.1f} mm from the end of the path, allowed: "
            self._end(job, LOST, f"{text}{1e3 * job.config.reached_m:g} mm (motion.reached_m)", t, off_m)
        elif t >= job.reported_s + _REPORT_S:
            self._report(job, OK, motion.note, t, off_m)

    def _end(
        self, job: _Job, state: str, text: str, t: float | None = None, off_m: float | None = None
    ) -> None:
        job.state, job.steps = state, None
        self._report(job, OK if state == REACHED else WARN, text, t, off_m)

    def _report_refusal(self, stamp_ns: int, error: SoroError) -> None:
        self._refuse(str(error))
        self._publish(REFUSED, ERROR, str(error), {"stamp_ns": stamp_ns})

    def _report(
        self, job: _Job, level: bytes, text: str, t: float | None = None, off_m: float | None = None
    ) -> None:
        values: dict[str, object] = {"stamp_ns": job.stamp_ns}
        if job.motion is not None:
            values |= {"factor": f"{job.motion.factor:.3f}"}
            if t is not None:
                job.reported_s = t
                values["passed_s"] = f"{t - job.motion.start_s:.2f}"
                values["duration_s"] = f"{job.motion.end_s - job.motion.start_s:.2f}"
        if off_m is not None:
            values["from_the_end_m"] = f"{off_m:.6f}"
        self._publish(job.state, level, text, values)

    def _publish(self, state: str, level: bytes, text: str, values: dict[str, object]) -> None:
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        self._send(STATUS, DiagnosticStatus(level=level, name=state, message=text, values=pairs))


def _rests(point: Point) -> bool:
    return not (np.any(point.qd) or np.any(point.qdd))


def _turned(base: np.ndarray, orientations: Sequence[np.ndarray]) -> np.ndarray:
    """Orientations in the base as those in the world; zeros stay."""
    return np.array(
        [
            quaternion_from_matrix(base @ matrix_from_quaternion(one)) if np.any(one) else one
            for one in orientations
        ]
    )
