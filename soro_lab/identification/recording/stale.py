"""Readings that are not new: repeated by a logger, or given again and again by a frozen sensor.

A reading equal to the bit to the one before is no evidence by itself: set points stand still, and a sensor
of coarse steps gives one value as long as the arm rests. The rule is therefore:

- Equal readings over no longer than `frozen_s` are repeats of a logger, and only the first one counts.
- Equal readings over a longer time are frozen if what drives the stream has moved by more than `moved` of its
  range until `frozen_s` before their end (a shorter time may be the delay of the arm), or if the readings
  flickered in the `frozen_s` before (noise does not stop) while another stream gives new readings. Only the
  first one counts.
- Other equal readings are those of something at rest, and all of them count.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array, Flags
from soro_lab.identification.recording.streams import Stream

# Part of a column's range below which a change is round-off of a simulation, not noise of a sensor.
_ROUND_OFF = 1e-6


@dataclass(frozen=True)
class StaleLimits:
    """When readings are repeated or frozen.

    Attributes
    ----------
    frozen_s : float
        Longest time [s] over which a logger repeats a reading.
    moved : float
        Motion of what drives a stream, part of its range in the recording.
    flicker : int
        Reversals of direction of the readings, over all columns, in `frozen_s`.
    """

    frozen_s: float = 1.0
    moved: float = 0.2
    flicker: int = 5


@dataclass(frozen=True)
class Stale:
    """Rows of a stream that are not new: masks (n,), and first and last time [s] of each frozen stretch."""

    repeated: Flags
    frozen: Flags
    stretches: tuple[tuple[float, float], ...]


def find_stale(
    stream: Stream,
    drivers: Sequence[tuple[Array, Array]],
    others: Sequence[Stream],
    limits: StaleLimits,
    columns: Sequence[tuple[Array, Array] | None] = (),
) -> Stale:
    """Return which samples of a stream are not new.

    Parameters
    ----------
    stream : Stream
        Samples (n,) with rising stamps.
    drivers : sequence of (t (k,), values (k, m))
        What moves the stream: stamps [s] and values in any unit.
    others : sequence of Stream
        Other streams of the recording, whose new readings show that time goes on.
    limits : StaleLimits
        The rule.
    columns : sequence of (t (k,), values (k, 1)) or None
        What moves each column of the stream by itself; a column that stands still alone is frozen as well.
    """
    t, table = stream.t, stream.table()
    repeated, frozen = np.zeros(len(t), bool), np.zeros(len(t), bool)
    for first, last in _chains(table):
        if t[last] - t[first] <= limits.frozen_s:
            repeated[first + 1 : last + 1] = True
        elif any(_moves(driver, t[first], t[last] - limits.frozen_s, limits.moved) for driver in drivers) or (
            _flickers(t, table, first, limits) and any(_is_new(other, t[first], t[last]) for other in others)
        ):
            frozen[first + 1 : last + 1] = True
    for column, driver in zip(table.T, columns, strict=False):
        for first, last in _chains(column[:, None]) if driver is not None else ():
            if t[last] - t[first] > limits.frozen_s and _moves(
                driver, t[first], t[last] - limits.frozen_s, limits.moved
            ):
                frozen[first + 1 : last + 1] = True
    repeated &= ~frozen
    return Stale(repeated, frozen, _stretches(t, frozen))


def _chains(table: Array) -> Iterator[tuple[int, int]]:
    """Yield the first and last row of each run of equal rows."""
    changed = np.concatenate([[True], (np.diff(table, axis=0) != 0.0).any(axis=1)])
    starts = np.flatnonzero(changed)
    for first, following in zip(starts, np.append(starts[1:], len(table)), strict=True):
        if following - first > 1:
            yield int(first), int(following) - 1


def _moves(driver: tuple[Array, Array] | None, start: float, end: float, part: float) -> bool:
    if driver is None or end <= start:
        return False
    t, values = driver
    inside = (t >= start) & (t <= end)
    if inside.sum() < 2:
        return False
    span = np.ptp(values, axis=0)
    return bool((np.ptp(values[inside], axis=0) > part * span)[span > 0.0].any())


def _flickers(t: Array, table: Array, first: int, limits: StaleLimits) -> bool:
    before = table[(t >= t[first] - limits.frozen_s) & (np.arange(len(t)) <= first)]
    reversals = 0
    for column, span in zip(before.T, np.ptp(table, axis=0), strict=True):
        steps = np.diff(column)
        signs = np.sign(steps[np.abs(steps) > _ROUND_OFF * span])
        reversals += int((signs[1:] != signs[:-1]).sum())
    return reversals >= limits.flicker


def _is_new(stream: Stream, start: float, end: float) -> bool:
    inside = stream.table()[(stream.t > start) & (stream.t < end)]
    return len(inside) > 1 and bool((np.diff(inside, axis=0) != 0.0).any())


def _stretches(t: Array, frozen: Flags) -> tuple[tuple[float, float], ...]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], frozen, [False]]).astype(int)))
    # The reading before the first one left out is the one that stayed.
    return tuple((float(t[begin - 1]), float(t[end - 1])) for begin, end in edges.reshape(-1, 2))
