"""How punctual a periodic loop is: lateness against its own schedule, and overruns."""

from __future__ import annotations

import time

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
