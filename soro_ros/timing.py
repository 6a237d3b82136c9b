"""How punctual a periodic loop is: lateness against its own schedule, and overruns."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import time
from collections.abc import Iterator

import numpy as np


class LoopTimer:
    """Lateness of each cycle against an ideal schedule that starts with the first one.

    Parameters
    ----------
    period_s : float
        Nominal period.
    keep : int
        Number of latest cycles that the percentiles look at.
    """

    def __init__(self, period_s: float, keep: int = 12000) -> None:
        self._period = period_s
        self._late = np.zeros(keep)
        self._start: float | None = None
        self._scheduled = 0
        self.cycles = 0
        self.overruns = 0

    def tick(self) -> None:
        """Note that a cycle starts now."""
        now = time.perf_counter()
        if self._start is None:
            self._start = now
        else:
            self._scheduled += 1
            late = now - self._start - self._scheduled * self._period
            if late > self._period:
                # The cycles that this one came too late for are lost; the schedule goes on.
                missed = int(late // self._period)
                self.overruns += missed
                self._scheduled += missed
            elif late < 0.0:
                # The first cycle was late itself: the earliest one seen defines the schedule.
                self._start += late
                late = 0.0
            self._late[self.cycles % self._late.size] = late
        self.cycles += 1

    def percentile_ms(self, percent: float) -> float:
        """Percentile of the lateness [ms]; 0 before the second cycle."""
        filled = self._late[: min(self.cycles, self._late.size)]
        return float(np.percentile(filled, percent)) * 1e3 if filled.size else 0.0


def prioritise(priority: int) -> str:
    """Ask for SCHED_FIFO; returns why not, or nothing.

    For every thread: messages come through those of the middleware, which were there before.
    """
    try:
        for thread in os.listdir("/proc/self/task"):
            with contextlib.suppress(ProcessLookupError):  # it ended meanwhile
                os.sched_setscheduler(int(thread), os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError) as error:
        return str(error)
    return ""


@contextlib.contextmanager
def punctual(priority: int = 30) -> Iterator[str]:
    """Let what happens inside be late as seldom as can be; gives why there is no real-time priority."""
    # Collector pauses and thread switches are the larger part of a Python loop's lateness.
    before = sys.getswitchinterval()
    sys.setswitchinterval(0.0002)
    gc.collect()
    gc.freeze()
    trouble = prioritise(priority) if priority > 0 else ""
    try:
        yield trouble
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)
        if priority > 0 and not trouble:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
