"""Two streams of messages of one topic, compared field by field."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from soro_ros.conversion import messages
from soro_ros.conversion.fields import Value, flat


class FieldDifference(NamedTuple):
    """One field that is not what was recorded; None where there is no such message or field."""

    stamp_ns: int
    topic: str
    field: str
    recorded: Value | None
    now: Value | None
    part: float
    """Difference as a part of the largest recorded value of the field; inf where there is no such number."""

    def __str__(self) -> str:
        at = f"{self.stamp_ns * 1e-9:.3f} s {self.topic}"
        if not self.field:
            return f"{at}: {'no such message now' if self.now is None else 'a message that was not recorded'}"
        recorded, now = ("nothing" if x is None else repr(x) for x in (self.recorded, self.now))
        part = f" (differs by {self.part:.2g} of its largest value)" if math.isfinite(self.part) else ""
        return f"{at} {self.field}: recorded {recorded}, now {now}{part}"


class TopicDifferences:
    """Pairs the messages of a topic by their stamps and compares them.

    Parameters
    ----------
    topic : str
        Name of the topic.
    largest : mapping of str to float
        Largest recorded magnitude of each field.
    tolerance : float
        Allowed difference, a part of the largest magnitude; 0: equal to the bit.
    ignored : callable
        Tells whether a field is left out, or with an empty name the whole topic.

    Attributes
    ----------
    compared : int
        Pairs of messages.
    differing : int
        Messages with a difference, or without a partner.
    worst : float
        Largest difference of a number, a part of the largest magnitude.
    first : FieldDifference or None
    """

    def __init__(
        self, topic: str, largest: Mapping[str, float], tolerance: float, ignored: Callable[[str], bool]
    ) -> None:
        self.topic, self._largest, self._tolerance, self._ignored = topic, largest, tolerance, ignored
        self._recorded: deque[Any] = deque()
        self._now: deque[Any] = deque()
        self.compared, self.differing, self.worst = 0, 0, 0.0
        self.first: FieldDifference | None = None

    def take_recorded(self, message: Any) -> None:
        """Take the next recorded message."""
        self._recorded.append(message)
        self._pair()

    def take_now(self, message: Any) -> None:
        """Take the next message of the replay."""
        self._now.append(message)
        self._pair()

    def finish(self) -> None:
        """Count the messages without a partner."""
        for waiting, is_now in ((self._recorded, False), (self._now, True)):
            for message in waiting:
                self._lonely(stamp_of(message), is_now)
            waiting.clear()

    def _pair(self) -> None:
        while self._recorded and self._now:
            recorded, now = stamp_of(self._recorded[0]), stamp_of(self._now[0])
            if recorded < now:
                self._recorded.popleft()
                self._lonely(recorded, False)
            elif now < recorded:
                self._now.popleft()
                self._lonely(now, True)
            else:
                self._compare(recorded, flat(self._recorded.popleft()), flat(self._now.popleft()))

    def _lonely(self, stamp_ns: int, is_now: bool) -> None:
        if self._ignored(""):
            return
        recorded, now = (None, "message") if is_now else ("message", None)
        self._note(FieldDifference(stamp_ns, self.topic, "", recorded, now, math.inf))

    def _note(self, difference: FieldDifference) -> None:
        self.differing += 1
        if self.first is None or difference.stamp_ns < self.first.stamp_ns:
            self.first = difference

    def _compare(self, stamp_ns: int, recorded: dict[str, Value], now: dict[str, Value]) -> None:
        self.compared += 1
        if recorded == now:
            return
        found: FieldDifference | None = None
        for field in dict.fromkeys((*recorded, *now)):
            old, new = recorded.get(field), now.get(field)
            both_nan = old != old and new != new
            if old == new or both_nan or self._ignored(field):
                continue
            part = self._part(field, old, new)
            if math.isfinite(part):
                self.worst = max(self.worst, part)
            if part > self._tolerance and found is None:
                found = FieldDifference(stamp_ns, self.topic, field, old, new, part)
        if found is not None:
            self._note(found)

    def _part(self, field: str, old: Value | None, new: Value | None) -> float:
        if isinstance(old, float) and isinstance(new, float) and math.isfinite(new - old):
            return abs(new - old) / (self._largest.get(field) or math.ulp(0.0))
        return math.inf


def stamp_of(message: Any) -> int:
    """Return the time of a message [ns]; of one without a stamp 0: such messages pair in their order."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return messages.to_ns(stamp) if hasattr(stamp, "nanosec") else 0
