"""What happened in a run at which time: trips, vents on request, warnings, contacts and injected faults."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array
from soro_ros.status_words import is_requested

Kind: TypeAlias = Literal["trip", "vent", "warning", "over", "injected", "contact"]

# The same words from two sources, the latch and /diagnostics, within this time [s] are one event.
_SAME_S = 1.5


class Event(NamedTuple):
    """One event: time [s] in the run, kind, node, and what it said."""

    t_s: float
    kind: Kind
    node: str
    text: str


class Said(NamedTuple):
    """A recorded status of a node: log time [ns], node, level (1 a warning, 2 or more an error), words."""

    log_ns: int
    node: str
    level: int
    text: str


class NodeStatus(NamedTuple):
    """What a node says from a time [s] in the run on; the level is that of `Said`."""

    t_s: float
    node: str
    level: int
    text: str


def statuses_of(said: Iterable[Said], time_of: Callable[[int], float]) -> tuple[NodeStatus, ...]:
    """Return the statuses of nodes that differ from their last one; parameters as of `events_of`."""
    found: dict[str, NodeStatus] = {}
    changes = []
    for log_ns, node, level, text in said:
        if node not in found or found[node][2:] != (level, text):
            found[node] = NodeStatus(time_of(log_ns), node, level, text)
            changes.append(found[node])
    return tuple(changes)


def warnings_at(statuses: Iterable[NodeStatus], at_s: float) -> dict[str, str]:
    """Return the warnings that stand at a time [s], by node."""
    found: dict[str, NodeStatus] = {}
    for status in statuses:
        if status.t_s <= at_s:
            found[status.node] = status
    return {node: status.text for node, status in found.items() if status.level == 1}


def events_of(said: Iterable[Said], time_of: Callable[[int], float]) -> tuple[Event, ...]:
    """Return the changes among statuses in their order; `time_of` turns log time [ns] into run time [s]."""
    found: list[Event] = []
    last: dict[str, tuple[int, str]] = {}
    for log_ns, node, level, text in said:
        before, words = last.get(node, (0, "")), _without_numbers(text) if level else ""
        last[node] = (level, words)
        if (level, words) == before:
            continue
        kind: Kind = "trip" if level >= 2 else "warning" if level == 1 else "over"
        if kind == "trip" and is_requested(text):
            kind = "vent"
        if kind == "over" and before[0] < 2:
            continue
        event = Event(time_of(log_ns), kind, node, text)
        if not any(_are_same(event, other) for other in found[-4:]):
            found.append(event)
    return tuple(found)


def contacts_of(t_s: Array, touches: NDArray[np.bool_], force_n: Array) -> tuple[Event, ...]:
    """Return when the estimator says that the arm touches something, and that it leaves it.

    Parameters
    ----------
    t_s, touches, force_n : ndarray (n,)
        Times [s], whether the arm touches something, and sizes of the force on it [N].
    """
    found = []
    for k in np.flatnonzero(np.diff(touches, prepend=False)):
        what = (
            f"touches something, with {1e3 * force_n[k]:.0f} mN" if touches[k] else "leaves what it touched"
        )
        found.append(Event(float(t_s[k]), "contact", "estimator", what))
    return tuple(found)


def under_control(events: Sequence[Event], end_s: float) -> tuple[Event, ...]:
    """Return events without the warnings and contacts behind the first trip or the end of control [s]."""
    last_s = min((event.t_s for event in events if event.kind == "trip"), default=end_s)
    return tuple(
        event
        for event in events
        if event.kind not in ("warning", "contact") or event.t_s <= min(last_s, end_s)
    )


def clock(log_ns: Sequence[int], stamp_ns: Sequence[int], start_ns: int) -> Callable[[int], float]:
    """Return the function from the time at which a message was recorded [ns] to the time in the run [s].

    The stamps of a run in lockstep are simulated time; those of /diagnostics never are.

    Parameters
    ----------
    log_ns, stamp_ns : sequence of int
        Both times of messages of the loop; empty: the log time counts from `start_ns`.
    start_ns : int
        Stamp at which the time of the run is 0.
    """
    if not log_ns:
        return lambda at: (at - start_ns) * 1e-9
    order = np.argsort(np.asarray(log_ns), kind="stable")
    log, stamp = np.asarray(log_ns)[order], np.asarray(stamp_ns)[order]
    # Whole nanoseconds since 1970 need more digits than a float has.
    from_log, from_stamp = (log - log[0]).astype(float), (stamp - start_ns).astype(float)

    def time_of(at: int) -> float:
        since = float(at - int(log[0]))
        outside = min(since, 0.0) + max(since - from_log[-1], 0.0)
        return float(np.interp(since, from_log, from_stamp) + outside) * 1e-9

    return time_of


def _are_same(one: Event, other: Event) -> bool:
    return one.text == other.text and one.kind == other.kind and abs(one.t_s - other.t_s) < _SAME_S


def _without_numbers(text: str) -> str:
    return "".join(letter for letter in text if letter not in "0123456789.")
