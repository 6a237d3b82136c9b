"""A motion of the arm, from the message that asks for it to its end, and what arm/motion says of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from soro_core.control import ControllerState
from soro_core.control.force.force_loop import ForceLoop
from soro_core.control.force.press import Press
from soro_core.control.motion_config import MotionConfig
from soro_ros.topics.diagnostics import ERROR, OK, WARN

STATUS, WRENCH, GRASP = "arm/motion", "arm/reference/wrench", "hand/grasp"
# States of a motion; the last ones are its end.
PLANNING, MOVING = "planning", "moving"
REACHED, REFUSED, LOST, REPLACED, VENTED = "reached", "refused", "lost", "replaced", "vented"
# Time between two reports of progress [s].
_REPORT_S = 0.1
# Error of a force that is reached: a part of it, at least so much [N]; of a lost one: so many times that.
_REACHED_PART, _REACHED_N, _LOST = 0.02, 0.0015, 5.0
# Time constant of the mean of a force, time for which it stays reached or lost until that is said, and time
# after the touch within which it must be reached [s].
_MEAN_S, _STAYS_S, _SETTLES_S = 0.2, 0.5, 5.0


@dataclass
class Job:
    """A motion from its message to its end.

    Attributes
    ----------
    topic : str
        Topic of the message.
    stamp_ns : int
        Stamp of the message, of a stream that of the newest one [ns].
    config : MotionConfig
        When it counts as reached.
    state : str
    goal : ndarray (3,) or None
        Position of the tip at the end of the reference [m]; None while that is not known.
    note : str
        What the reports say of it.
    given_s : float
        Time of the newest message [s].
    is_stream : bool
        Whether more than one message has come.
    rest_s : float or None
        Time since which the reference rests at its end [s]; None under way.
    reported_s : float
        Time of the last report [s].
    """

    topic: str
    stamp_ns: int
    config: MotionConfig
    state: str = PLANNING
    goal: np.ndarray | None = None
    note: str = ""
    given_s: float = 0.0
    is_stream: bool = False
    rest_s: float | None = None
    reported_s: float = -np.inf

    @property
    def is_under_way(self) -> bool:
        """Whether it has not ended."""
        return self.state in (PLANNING, MOVING)

    def times(self, t: float) -> dict[str, object]:
        """What a report at time `t` [s] says of the times of a planned motion."""
        return {}


@dataclass
class PressJob(Job):
    """A press.

    Attributes
    ----------
    press : Press or None
    pressed_n : float
        Mean of the estimated force along the direction [N].
    contact_s, within_s, beyond_s : float or None
        Times since which the tip touches something, and the force is within or beyond what is allowed [s].
    mean_s : float
        Time of the mean [s].
    """

    press: Press | None = None
    pressed_n: float = 0.0
    contact_s: float | None = None
    within_s: float | None = None
    beyond_s: float | None = None
    mean_s: float = 0.0

    def times(self, t: float) -> dict[str, object]:
        """Return the force of now, and the wanted one."""
        assert self.press is not None
        return {"force_n": f"{self.pressed_n:.5f}", "goal_n": f"{self.press.force_n:.5f}"}

    def judge(self, state: ControllerState, t: float) -> tuple[str, str]:
        """Return the state of the press after a tick at time `t` [s], and what is to be said of it."""
        press, loop = self.press, state.force
        assert press is not None
        if loop.felt is None:
            return LOST, "no estimate of the force: is the tip measured?"
        part = min(max(t - self.mean_s, 0.0) / _MEAN_S, 1.0)
        self.mean_s = t
        self.pressed_n += part * (loop.pressed_n - self.pressed_n)
        if loop.phase == "stopped":
            return LOST, ForceLoop.note(loop)
        allowed = max(_REACHED_PART * press.force_n, _REACHED_N)
        off = abs(self.pressed_n - press.force_n)
        touches = loop.phase == "contact"
        self.contact_s = _since(self.contact_s, touches, t)
        self.within_s = _since(self.within_s, touches and off <= allowed, t)
        self.beyond_s = _since(self.beyond_s, off > _LOST * allowed, t)
        if self.state == REACHED:
            if self.beyond_s is not None and t - self.beyond_s > _STAYS_S:
                return LOST, f"the force is {1e3 * self.pressed_n:.1f} mN, {_wanted(press)}"
        elif self.within_s is not None and t - self.within_s > _STAYS_S:
            return REACHED, f"presses with {1e3 * self.pressed_n:.1f} mN"
        elif self.contact_s is not None and t - self.contact_s > _SETTLES_S:
            saturated = f": {state.watch.saturated}" if state.watch.saturated else ""
            return LOST, f"the force is {1e3 * self.pressed_n:.1f} mN, {_wanted(press)}{saturated}"
        return self.state, "" if self.state == REACHED else "in contact" if touches else "approaches"


def _since(since_s: float | None, holds: bool, t: float) -> float | None:
    """Return since when something holds [s]; None if it does not."""
    return None if not holds else t if since_s is None else since_s


def _wanted(press: Press) -> str:
    return f"wanted: {1e3 * press.force_n:g} mN"


class MotionReports:
    """Publishes how motions go.

    Parameters
    ----------
    publish : callable
        Takes the name of a topic and a message.
    """

    outputs: ClassVar[dict[str, type[Any]]] = {STATUS: DiagnosticStatus}

    def __init__(self, publish: Callable[[str, Any], None]) -> None:
        self._send = publish

    def judge(self, job: Job, goal: np.ndarray, t: float, tip: np.ndarray, rests: bool) -> None:
        """Report progress of a motion, and its end once the reference rests.

        Parameters
        ----------
        job : Job
        goal, tip : ndarray (3,)
            Position of the tip at the end, and the estimated one [m].
        t : float
            Time [s].
        rests : bool
            Whether the reference has come to its end.
        """
        off_m = float(np.linalg.norm(tip - goal))
        if not rests:
            job.rest_s = None
        elif job.rest_s is None:
            job.rest_s = t
        if job.rest_s is not None and off_m <= job.config.reached_m:
            self.end(job, REACHED, job.note, t, off_m)
        elif job.rest_s is not None and t > job.rest_s + job.config.settle_s:
            text = f"the tip is {1e3 * off_m:.1f} mm from the end, allowed: "
            self.end(job, LOST, f"{text}{1e3 * job.config.reached_m:g} mm (motion.reached_m)", t, off_m)
        elif t >= job.reported_s + _REPORT_S:
            self.report(job, job.note, t, off_m)

    def judge_press(self, job: PressJob, state: ControllerState, t: float) -> None:
        """Report progress of a press, and once its force is there, or lost.

        Parameters
        ----------
        job : PressJob
        state : ControllerState
            After a tick.
        t : float
            Its time [s].
        """
        found, text = job.judge(state, t)
        if found != job.state:
            job.note = text
            self.end(job, found, text, t)
        elif job.is_under_way and t >= job.reported_s + _REPORT_S:
            self.report(job, text, t)

    def end(
        self, job: Job, state: str, text: str, t: float | None = None, off_m: float | None = None
    ) -> None:
        """Report the end of a motion.

        Parameters
        ----------
        job : Job
        state : str
            Its last state.
        text : str
        t : float, optional
            Time [s].
        off_m : float, optional
            Distance of the tip from the end [m].
        """
        job.state = state
        self.report(job, text, t, off_m)

    def refuse(self, topic: str, stamp_ns: int, text: str) -> None:
        """Report that a message is refused.

        Parameters
        ----------
        topic : str
        stamp_ns : int
        text : str
            Why.
        """
        self._publish(REFUSED, ERROR, text, {"topic": topic, "stamp_ns": stamp_ns})

    def report(self, job: Job, text: str, t: float | None = None, off_m: float | None = None) -> None:
        """Report the state of a motion; parameters as in `end`."""
        values: dict[str, object] = {"topic": job.topic, "stamp_ns": job.stamp_ns}
        if t is not None:
            job.reported_s = t
            values |= job.times(t)
        if off_m is not None:
            values["from_the_end_m"] = f"{off_m:.6f}"
        is_well = job.is_under_way or job.state == REACHED
        self._publish(job.state, OK if is_well else WARN, text, values)

    def _publish(self, state: str, level: bytes, text: str, values: dict[str, object]) -> None:
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        self._send(STATUS, DiagnosticStatus(level=level, name=state, message=text, values=pairs))
