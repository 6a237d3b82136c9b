"""A motion of the arm, from the message that asks for it to its end, and what arm/motion says of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from soro_core.control.motion_config import MotionConfig
from soro_ros.topics.diagnostics import ERROR, OK, WARN

STATUS = "arm/motion"
# States of a motion; the last ones are its end.
PLANNING, MOVING = "planning", "moving"
REACHED, REFUSED, LOST, REPLACED, VENTED = "reached", "refused", "lost", "replaced", "vented"
# Time between two reports of progress [s].
_REPORT_S = 0.1


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
            Of the message.
        text : str
            Why.
        """
        self._publish(REFUSED, ERROR, text, {"topic": topic, "stamp_ns": stamp_ns})

    def report(self, job: Job, text: str, t: float | None = None, off_m: float | None = None) -> None:
        """Report the state of a motion.

        Parameters
        ----------
        job : Job
        text : str
        t : float, optional
            Time [s].
        off_m : float, optional
            Distance of the tip from the end [m].
        """
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
