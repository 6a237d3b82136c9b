"""Lateness and overruns of a periodic loop."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import time
from collections.abc import Iterator

import numpy as np

# Cycles before a schedule is found: the first ones come in a bunch, when the executor begins.
UNSETTLED = 20
_KEPT = 12_000  # latest cycles, for the percentiles


class LoopTimer:
    """Lateness of each cycle against an ideal schedule, which begins after `UNSETTLED` cycles.

    Parameters
    ----------
    period_s : float
        Nominal period.

    Attributes
    ----------
    cycles : int
    overruns : int
        Periods without a cycle, since there is a schedule.
    """

    def __init__(self, period_s: float) -> None:
        self._period = period_s
        self._late = np.zeros(_KEPT)
        self._start: float | None = None
        self._scheduled = 0
        self.cycles = 0
        self.overruns = 0

    def tick(self) -> None:
        """Record that a cycle starts now."""
        now = time.perf_counter()
        self.cycles += 1
        if self.cycles <= UNSETTLED:
            return
        if self._start is None:
            self._start = now
        else:
            self._scheduled += 1
            late = now - self._start - self._scheduled * self._period
            if late > self._period:
                # Skip the cycles that are over; the schedule stays.
                missed = int(late // self._period)
                self.overruns += missed
                self._scheduled += missed
            elif late < 0.0:
                # The first cycle was late: the earliest one defines the schedule.
                self._start += late
                late = 0.0
            self._late[(self.cycles - UNSETTLED - 1) % self._late.size] = late

    def percentile_ms(self, percent: float) -> float:
        """Return a percentile of the lateness [ms]; 0 before there is a schedule."""
        filled = self._late[: min(max(self.cycles - UNSETTLED, 0), self._late.size)]
        return float(np.percentile(filled, percent)) * 1e3 if filled.size else 0.0


def prioritise(priority: int) -> str:
    """Request SCHED_FIFO, or with 0 the ordinary scheduler; return the reason of a refusal, or an empty text.

    The request is for every thread, because those of the middleware, which exist already, carry the messages.
    """
    try:
        policy = os.SCHED_FIFO if priority > 0 else os.SCHED_OTHER
        for thread in os.listdir("/proc/self/task"):
            with contextlib.suppress(ProcessLookupError):  # it ended meanwhile
                os.sched_setscheduler(int(thread), policy, os.sched_param(priority))
    except (AttributeError, OSError) as error:
        return str(error)
    return ""


# Objects that come to exist before the collector looks for dead ones again. A look takes a millisecond, and a
# loop leaves no dead ones: with the 700 of Python it would stop 40 times a second for nothing.
_OBJECTS = 100_000


@contextlib.contextmanager
def rare_collections() -> Iterator[None]:
    """Let the collector look for dead objects rarely in the block; a loop leaves none that it has to find."""
    objects = gc.get_threshold()
    gc.set_threshold(_OBJECTS)
    try:
        yield
    finally:
        gc.set_threshold(*objects)


def shorten_pauses() -> None:
    """Shorten the interpreter's pauses, the larger part of a loop's lateness: collector, thread switches."""
    sys.setswitchinterval(0.0002)
    gc.collect()
    gc.freeze()
    gc.set_threshold(_OBJECTS)


@contextlib.contextmanager
def punctual(priority: int = 30) -> Iterator[str]:
    """Run the block with little lateness; gives the reason if there is no real-time priority."""
    before, objects = sys.getswitchinterval(), gc.get_threshold()
    shorten_pauses()
    failure = prioritise(priority) if priority > 0 else ""
    try:
        yield failure
    finally:
        gc.unfreeze()
        gc.set_threshold(*objects)
        sys.setswitchinterval(before)
        if priority > 0 and not failure:
            prioritise(0)
