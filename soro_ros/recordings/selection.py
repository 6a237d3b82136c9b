"""Chosen fields of chosen topics over time, for a picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from soro_core.arrays import Array
from soro_core.errors import BagError, ConfigError
from soro_lab.bag import BagReader, Topic
from soro_ros.conversion.decoding import Messages
from soro_ros.conversion.fields import flat
from soro_ros.conversion.units import unit_of
from soro_ros.recordings.convert import wanted
from soro_ros.recordings.differences import stamp_of
from soro_ros.recordings.events import clock

# Messages that hold until the next one.
_HOLD = ("diagnostic_msgs/msg/DiagnosticStatus", "diagnostic_msgs/msg/DiagnosticArray", "std_msgs/msg/Bool")
_FLAGS = {"false": 0.0, "true": 1.0}
# What a picture can show; more is a mistake.
MOST_LINES = 400
# Fields that an error names.
_NAMED = 20
# A clock below this [ns] began at 0: it is simulated.
_SIMULATED_NS = 10**15


class FieldSeries(NamedTuple):
    """One number of a topic over time: times (n,) [s] and values (n,); each may hold until the next."""

    topic: str
    path: str
    unit: str
    t: Array
    value: Array
    holds: bool = False


def fields_of(
    bag: Path, topics: Sequence[str], fields: Sequence[str], say: Callable[[str], None]
) -> list[FieldSeries]:
    """Return numbers of a bag over time.

    Time counts from the first reference of the tip, or from the first message with a stamp.

    Parameters
    ----------
    bag : Path
    topics : sequence of str
        Names or patterns; empty: all.
    fields : sequence of str
        Paths or patterns, as ``effort.*``, ``pose.pose.position.x``; empty: all but stamps. A number in
        /diagnostics is ``NODE.KEY``.
    say : callable
        Takes a line for each topic that is left out.

    Raises
    ------
    BagError
        If the bag cannot be read, or has no such topic.
    ConfigError
        If nothing fits, or too much.
    """
    found: list[FieldSeries] = []
    with BagReader(bag) as reader:
        chosen = wanted(reader, topics)
        messages = Messages(reader, {topic.name: None for topic in reader.topics})
        for error in (messages.refused[topic.name] for topic in chosen if topic.name in messages.refused):
            if len(chosen) == 1:
                raise error
            say(f"left out: {error}")
        start_ns, time_of = _clock(reader, messages)
        seen: dict[str, None] = {}
        for topic in chosen:
            rows: dict[str, tuple[list[float], list[float]]] = {}
            path = ""
            for item, message in messages([topic.name]):
                stamp = stamp_of(message)
                # Of simulated time 0 is a stamp; /diagnostics has the time of the wall always.
                is_stamped = hasattr(message, "header") and (stamp or start_ns < _SIMULATED_NS)
                if not isinstance(message, DiagnosticArray) and (is_stamped or stamp):
                    at = (stamp - start_ns) * 1e-9
                else:
                    at = time_of(item.log_time_ns)
                for path, value in _numbers(message):
                    if _is_chosen(path, fields):
                        times, values = rows.setdefault(path, ([], []))
                        times.append(at)
                        values.append(value)
                    elif len(seen) < MOST_LINES:
                        seen[path] = None
                if len(found) + len(rows) > MOST_LINES:
                    allowed = f"--topic and --field that choose at most {MOST_LINES} numbers"
                    raise ConfigError("soro plot", "--field", f"more, as {topic.name} {path}", allowed)
            found += _found(topic, rows, time_of(reader.end_ns))
            for line in messages.left_out:
                say(line)
        for problem in reader.problems:
            say(f"the bag is damaged: {problem}")
        if not found and len(messages.refused) == len(reader.topics):
            raise BagError("no topic can be read", bag, "format")
    if not found:
        more = f", and {len(seen) - _NAMED} more" if len(seen) > _NAMED else ""
        known = ", ".join(list(seen)[:_NAMED]) + more or "none in these topics"
        raise ConfigError("soro plot", "--field", ", ".join(fields) or "no number", known)
    return found


def _found(
    topic: Topic, rows: dict[str, tuple[list[float], list[float]]], end_s: float
) -> Iterator[FieldSeries]:
    holds = topic.type in _HOLD
    for path, (t, value) in rows.items():
        if holds:
            t, value = [*t, max(t[-1], end_s)], [*value, value[-1]]
        yield FieldSeries(topic.name, path, unit_of(topic.name, path), np.array(t), np.array(value), holds)


def _is_chosen(path: str, fields: Sequence[str]) -> bool:
    if not fields:
        return not path.endswith("stamp_ns")
    return any(fnmatchcase(path, pattern) for pattern in fields)


def _numbers(message: Any) -> Iterator[tuple[str, float]]:
    if isinstance(message, DiagnosticArray | DiagnosticStatus):
        is_array = isinstance(message, DiagnosticArray)
        for status in message.status if is_array else [message]:
            of = f"{status.name}." if is_array else ""
            yield f"{of}level", float(status.level[0])
            for pair in status.values:
                try:
                    yield f"{of}{pair.key}", float(_FLAGS.get(pair.value, pair.value))
                except ValueError:
                    continue
        return
    for path, value in flat(message).items():
        if not isinstance(value, str):
            yield path, float(value)


def _clock(reader: BagReader, messages: Messages) -> tuple[int, Callable[[int], float]]:
    """Return the stamp at which time is 0, and the function from log times to times [s]."""
    for end in ("/arm/desired/tip", "/chambers/state", "/arm/tip", "/arm/state", "/sensors/pose0"):
        for topic in reader.topics:
            if not topic.name.endswith(end):
                continue
            times = [(item.log_time_ns, stamp_of(message)) for item, message in messages([topic.name])]
            if times:
                logged, stamps = zip(*times, strict=True)
                return stamps[0], clock(list(logged), list(stamps), stamps[0])
    return reader.start_ns, clock([], [], reader.start_ns)
