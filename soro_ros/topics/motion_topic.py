"""Motions to references that came by topic: arm/motion reports how they go. Paths are planned between ticks.

A plan takes some tenths of a second. It is made in slices after each command, while the node would wait for
the next state; in lockstep, which has no deadlines, it is made at once.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from nav_msgs.msg import Path

from soro_core.config import with_changes
from soro_core.control import Controller, ControllerState, Reference
from soro_core.control.force.press import Press
from soro_core.control.motion_config import MotionConfig
from soro_core.control.motions.motion_parts import PiecewiseMotion
from soro_core.control.motions.way_around import route_around
from soro_core.control.reference.active_reference import STREAM_S, ActiveReference, at_rest, reference_ahead
from soro_core.control.reference.trajectory import Point
from soro_core.errors import ConfigError, SoroError
from soro_core.planning.steps import Planning, finished
from soro_core.run_keys import Frames
from soro_ros.conversion import messages, qos
from soro_ros.conversion.references import poses_in_world
from soro_ros.topics.motion_job import (
    LOST,
    MOVING,
    PLANNING,
    REACHED,
    REPLACED,
    Job,
    MotionReports,
    PressJob,
)
from soro_ros.topics.ports import Input, Inputs

TOPIC = "arm/reference/path"
# Part of a period, after a tick has started, until which a plan is continued.
_SHARE = 0.5
# A motion that begins under way does so that long after its message [s]; twice as long each time that the
# plan was not ready.
_AHEAD_S, _LONGEST_S = 0.5, 8.0


@dataclass
class _Path(Job):
    """A motion along a path."""

    steps: Planning[PiecewiseMotion] | None = None
    motion: PiecewiseMotion | None = None

    def times(self, t: float) -> dict[str, object]:
        if self.motion is None:
            return {}
        return {
            "factor": f"{self.motion.factor:.3f}",
            "passed_s": f"{t - self.motion.start_s:.2f}",
            "duration_s": f"{self.motion.end_s - self.motion.start_s:.2f}",
        }


class MotionTopic:
    """The motions of a controller node, and the topic of paths.

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

    outputs = MotionReports.outputs

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
        self._controller, self._lockstep, self._settings = controller, lockstep, settings
        self._reports = MotionReports(publish)
        self._period_s, self._frames, self._follow, self._refuse = period_s, frames, follow, refuse
        self._job: Job | None = None
        self._replaced: Job | None = None  # the one under way, while the next is planned
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
            planner = self._controller.planner(state, self._period_s)
            finished(planner.plan(begin, tips, None, 0.0))
            if self._controller.obstacles is not None:
                finished(route_around(planner, begin.q, tips[1]))

    def cancel(self, state: str, text: str) -> None:
        """End the motion, if there is one, because of something else."""
        for job in (self._replaced, self._job):
            if job is not None and job.is_under_way:
                self._reports.end(job, state, text)
        self._replaced = None

    def forget(self, state: str, text: str) -> None:
        """End the motion, if there is one, and wait for the next tick."""
        self.cancel(state, text)
        self._now = None

    def given(self, topic: str, stamp_ns: int, reference: Reference) -> None:
        """Report the motion to a reference that came by another topic and is followed from now on.

        A repeated one changes nothing, and in a stream the newest message counts for all.

        Parameters
        ----------
        topic : str
        stamp_ns : int
        reference : Reference
        """
        state, t = (None, 0.0) if self._now is None else self._now
        following = None if state is None else state.following
        goal, job = self._tip(reference, reference.end_s), self._job
        if job is not None and job.topic == topic:
            # A press that is lost begins anew by a request of its own, and not by the next of one stream.
            is_told = isinstance(job, PressJob) and job.state == LOST and t - job.given_s <= STREAM_S
            is_repeated = following is not None and following.wanted.is_repeated_by(reference, t)
            if is_repeated and (is_told or job.state in (MOVING, REACHED)):
                job.stamp_ns, job.given_s = stamp_ns, t
                self._reports.report(job, job.note)
                return
            if job.state == MOVING and t - job.given_s <= STREAM_S and not isinstance(job, PressJob):
                job.stamp_ns, job.goal, job.given_s, job.is_stream = stamp_ns, goal, t, True
                return
        self.cancel(REPLACED, "by another reference")
        if isinstance(reference, Press):
            job = PressJob(topic, stamp_ns, self._settings(), MOVING, goal, "", t, press=reference)
        else:
            job = Job(topic, stamp_ns, self._settings(), MOVING, goal, given_s=t)
        self._job = job
        self._reports.report(job, "")

    def refuse(self, topic: str, stamp_ns: int, reason: str) -> None:
        """Report that a message is refused.

        Parameters
        ----------
        topic : str
        stamp_ns : int
        reason : str
        """
        self._refuse(reason)
        self._reports.refuse(topic, stamp_ns, reason)

    def tick(self, state: ControllerState, t: float, tip: np.ndarray, start_s: float) -> None:
        """Continue after a tick.

        Parameters
        ----------
        state : ControllerState
            After the tick.
        t : float
            Its time [s].
        tip : ndarray (3,)
            Estimated position of the tip [m].
        start_s : float
            Monotonic time at which the tick began [s].
        """
        self._now = state, t
        job = self._job
        if job is None:
            return
        if isinstance(job, _Path) and job.state == PLANNING:
            self._plan(job, start_s + _SHARE * self._period_s)
            self._begin(job, t)
        elif isinstance(job, PressJob):
            if job.state in (MOVING, REACHED):
                self._reports.judge_press(job, state, t)
        elif job.state == MOVING and job.goal is not None and state.following is not None:
            ended = not job.is_stream or t - job.given_s > STREAM_S
            rests = ended and at_rest(self._controller.bounds, state.following)
            self._reports.judge(job, job.goal, t, tip, rests)

    def _on_path(self, message: Path) -> None:
        job = self._job
        if isinstance(job, _Path) and job.state in (PLANNING, MOVING, REACHED) and message == self._message:
            return  # a repeated message changes nothing
        stamp_ns = messages.to_ns(message.header.stamp)
        try:
            positions, orientations = poses_in_world(message, TOPIC, self._frames, self._controller.robot)
            self._reached()
            path = _Path(TOPIC, stamp_ns, self._settings())
            path.steps = self._steps(path.config, positions, orientations)
        except SoroError as error:
            self.refuse(TOPIC, stamp_ns, str(error))
            return
        self._message = message
        if job is not None and job.state == PLANNING:  # one under way goes on until this one begins
            self._reports.end(job, REPLACED, "by another path")
        if job is not None and job.state == MOVING:
            self._replaced = job
        self._job = path
        self._reports.report(path, "")
        if self._lockstep:
            self._plan(path, np.inf)

    def _steps(
        self, config: MotionConfig, positions: np.ndarray, orientations: np.ndarray | None
    ) -> Planning[PiecewiseMotion]:
        """Plan the path, then the way to it from the reference at the time of the motion's begin."""
        controller, (state, _, following) = self._controller, self._reached()
        planner = controller.planner(state, self._period_s)
        planner = replace(planner, config=with_changes(planner.config, motion=config))
        near = reference_ahead(controller.bounds, following, 0.0).q
        if config.around and len(positions) == 1:
            route = yield from route_around(planner, near, positions[0])
        else:
            route = yield from planner.route(near, positions, orientations)
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

    def _reached(self) -> tuple[ControllerState, float, ActiveReference]:
        """State, time and reference of the last tick."""
        if self._now is None or self._now[0].following is None:
            raise ConfigError("path", "controller", "not in control", "a controller in control: soro enable")
        return *self._now, self._now[0].following

    def _plan(self, job: _Path, until_s: float) -> None:
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
            self.refuse(TOPIC, job.stamp_ns, str(error))

    def _begin(self, job: _Path, t: float) -> None:
        """Begin the planned motion when it is due."""
        if job.motion is None or t < job.motion.start_s:
            return
        if self._replaced is not None:
            self._reports.end(self._replaced, REPLACED, "by another path")
            self._replaced = None
        job.state, job.note, job.goal = MOVING, job.motion.note, self._tip(job.motion, job.motion.end_s)
        self._follow(job.motion)
        self._refuse("")
        self._reports.report(job, job.note, t)

    def _tip(self, reference: Reference, t: float) -> np.ndarray:
        """Position of the tip (3,) where a reference is at a time [s]."""
        q = reference.sample(t).q
        return np.asarray(self._controller.arm.pose(q, self._controller.robot.length)[:3, 3])


def _rests(point: Point) -> bool:
    return not (np.any(point.qd) or np.any(point.qdd))
