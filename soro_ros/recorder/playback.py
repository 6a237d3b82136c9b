"""A recording in its time, which other threads pause, seek and change."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from soro_lab.bag.timeline import Timeline

Event = TypeVar("Event")
_NEVER_NS = 2**63 - 1
# A lock does not take any time; what is due later is waited for again [s].
_LONGEST_WAIT_S = 3600.0


class Playback(Generic[Event]):
    """Hands out recorded events when they are due.

    Parameters
    ----------
    events : callable
        Gives the events from a recorded time [ns] on, each with its time [ns], in their order.
    begin_ns, end_ns : int
        Recorded times [ns] of the first and the last event.
    rate : float
        Recorded time per time; 0: as fast as they are taken.
    loop : bool
        Begin again at the end.
    """

    def __init__(
        self,
        events: Callable[[int], Iterator[tuple[int, Event]]],
        begin_ns: int,
        end_ns: int,
        rate: float,
        loop: bool,
    ) -> None:
        self._events, self._begin_ns, self._end_ns, self.loop = events, begin_ns, end_ns, loop
        self._changed = threading.Condition()
        self._timeline = Timeline(begin_ns, _NEVER_NS, rate)  # until `run`
        self._moves = 0
        self._stopped = threading.Event()

    @property
    def stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stopped.is_set()

    @property
    def paused(self) -> bool:
        """Whether it stands still."""
        return self._timeline.paused

    @property
    def rate(self) -> float:
        """Recorded time per time."""
        return self._timeline.rate

    @property
    def position_s(self) -> float:
        """Recorded time since the begin [s]."""
        return (min(self._timeline.at(time.monotonic_ns()), self._end_ns) - self._begin_ns) * 1e-9

    @property
    def length_s(self) -> float:
        """Recorded time from the begin to the end [s]."""
        return (self._end_ns - self._begin_ns) * 1e-9

    def run(self, emit: Callable[[int, Event], None]) -> None:
        """Hand out every event with its time, until the end or `stop`."""
        self._change(lambda line, now: line.seek(line.position_ns, now))
        while not self.stopped:
            if self._play(emit):
                if not self.loop:
                    return
                self.seek(0.0)

    def pause(self) -> None:
        """Stand still."""
        self._change(Timeline.pause)

    def resume(self) -> None:
        """Go on."""
        self._change(Timeline.resume)

    def set_rate(self, rate: float) -> None:
        """Go on at another rate; 0: as fast as events are taken."""
        self._change(lambda line, now: line.at_rate(rate, now))

    def seek(self, position_s: float) -> None:
        """Go on from a recorded time since the begin [s], within the recording."""
        wanted = self._begin_ns + round(position_s * 1e9)
        with self._changed:
            self._moves += 1
        self._change(lambda line, now: line.seek(min(max(wanted, self._begin_ns), self._end_ns), now))

    def stop(self) -> None:
        """End `run`."""
        self._stopped.set()
        with self._changed:
            self._changed.notify_all()

    def wait(self, seconds: float) -> None:
        """Wait, or until `stop`."""
        self._stopped.wait(seconds)

    def _change(self, change: Callable[[Timeline, int], Timeline]) -> None:
        with self._changed:
            self._timeline = change(self._timeline, time.monotonic_ns())
            self._changed.notify_all()

    def _play(self, emit: Callable[[int, Event], None]) -> bool:
        """Hand out the events from the position on; return whether the end is reached."""
        with self._changed:
            moves, begin_ns = self._moves, self._timeline.position_ns
        for stamp_ns, event in self._events(begin_ns):
            if not self._await(stamp_ns, moves):
                return False
            emit(stamp_ns, event)
        return True

    def _await(self, stamp_ns: int, moves: int) -> bool:
        """Wait until a recorded time is due; return False if it is not any more."""
        with self._changed:
            while not self.stopped and self._moves == moves:
                left_s = self._timeline.wait_s(stamp_ns, time.monotonic_ns())
                if left_s == 0.0:
                    self._timeline = self._timeline.reached(stamp_ns)
                    return True
                self._changed.wait(None if left_s is None else min(left_s, _LONGEST_WAIT_S))
        return False
