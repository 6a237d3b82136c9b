"""Samples that cannot be used are left out and counted."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import ConfigError
from soro_lab.identification.recording.recording import OmittedSamples
from soro_lab.identification.recording.stale import StaleLimits, find_stale
from soro_lab.identification.recording.streams import Bend, Curvature, Imu, Marker, Plate, Series, Stream
from soro_lab.identification.records import LATE_S

# A quaternion whose length is further from 1 than this is no rotation.
_LENGTH = 0.1


@dataclass(frozen=True)
class Raw:
    """A stream as it stands in a file.

    Attributes
    ----------
    stream : Stream
        All samples (n,), stamps in any order.
    bad : ndarray (n,) of bool
        Samples that the source marks as bad.
    outside : ndarray (n,) of bool
        Samples outside the stated range.
    """

    stream: Stream
    bad: Flags
    outside: Flags


def raw(stream: Stream, bad: Flags | None = None, outside: Flags | None = None) -> Raw:
    """Return a raw stream; without a mask no sample is marked.

    Parameters
    ----------
    stream : Stream
        All samples (n,).
    bad, outside : ndarray (n,) of bool, optional
        Samples that are marked as bad, or lie outside the stated range.
    """
    none = np.zeros(len(stream.t), bool)
    return Raw(stream, none if bad is None else bad, none if outside is None else outside)


def usable(found: Raw, where: str) -> tuple[Stream, OmittedSamples]:
    """Return the samples that are finite, not marked, in range, and later than the one before.

    Parameters
    ----------
    found : Raw
        Samples (n,).
    where : str
        File, for errors.

    Raises
    ------
    ConfigError
        If the clock was set back, or a stream keeps fewer than two samples.
    """
    stream = found.stream
    if isinstance(stream, Plate):
        stream, is_rotation = _unit(stream)
        found = Raw(stream, found.bad | ~is_rotation, found.outside)
    keep = np.isfinite(stream.t) & np.isfinite(stream.table()).all(axis=1)
    not_finite = int((~keep).sum())
    late = keep & ~_rises(stream, keep, where)
    keep &= ~late
    bad = keep & found.bad
    keep &= ~bad
    outside = keep & found.outside
    keep &= ~outside
    bad_count, outside_count, late_count = (int(mask.sum()) for mask in (bad, outside, late))
    faults = OmittedSamples(stream.name, len(stream.t), not_finite, bad_count, outside_count, late_count)
    if keep.sum() < 2:
        raise ConfigError(where, stream.name, str(faults), "two or more usable samples")
    return stream.rows(keep), faults


def without_stale(
    streams: Sequence[tuple[Stream, OmittedSamples]],
    exempt: Collection[str] = ("command",),
    limits: StaleLimits | None = None,
) -> list[tuple[Stream, OmittedSamples]]:
    """Return the streams of a recording without repeated and frozen samples, and their faults with these.

    What is fixed to the base does not move: its readings are never called frozen because the arm moves.

    Parameters
    ----------
    streams : sequence of (Stream, OmittedSamples)
        Streams named `pressure` and `command`, and those of the shape.
    exempt : collection of str
        Streams that stand still by nature, as set points do: all of their samples count.
    limits : StaleLimits, optional
        The rule.
    """
    limits = StaleLimits() if limits is None else limits
    by_name = {stream.name: stream for stream, _ in streams}
    command = by_name.get("command")
    result = []
    for stream, faults in streams:
        others = [other for other in by_name.values() if other.name not in (stream.name, *exempt)]
        drivers, columns = _drivers(stream, others, command)
        if stream.name in exempt:
            result.append((stream, faults))
            continue
        stale = find_stale(stream, drivers, others, limits, columns)
        changed = replace(
            faults,
            repeated=int(stale.repeated.sum()),
            frozen=stale.stretches,
            frozen_samples=int(stale.frozen.sum()),
        )
        result.append((stream.rows(~(stale.repeated | stale.frozen)), changed))
    return result


_Driver: TypeAlias = tuple[Array, Array]


def _drivers(
    stream: Stream, others: Sequence[Stream], command: Stream | None
) -> tuple[list[_Driver], list[_Driver | None]]:
    """Return what drives a stream as a whole, and what drives each of its columns."""
    if isinstance(stream, Series):
        if command is None:
            # An arm can be moved by hand at a constant pressure: its motion says nothing of the pressures.
            return [], []
        table = command.table()
        return [(command.t, table)], [(command.t, column[:, None]) for column in table.T]
    if isinstance(stream, Plate | Marker | Imu) and stream.place.is_base:
        return [], []
    moving = [other for other in others if isinstance(other, Series | Plate | Marker | Curvature | Bend)]
    return [(other.t, other.motion()) for other in moving], []


def _rises(stream: Stream, usable_rows: Flags, where: str) -> Flags:
    """Return which samples are later than all before them, apart from single stamps far off."""
    at = np.flatnonzero(usable_rows)
    t = stream.t[at]
    off = (t[:-2] < t[2:]) & ((t[:-2] - t[1:-1] > LATE_S) | (t[1:-1] - t[2:] > LATE_S))
    usable_rows = usable_rows.copy()
    usable_rows[at[1:-1][off]] = False
    before = np.concatenate([[-np.inf], np.maximum.accumulate(np.where(usable_rows, stream.t, -np.inf))[:-1]])
    fall = np.where(usable_rows, before - stream.t, -np.inf)
    if fall.size and fall.max() > LATE_S:
        row = int(np.argmax(fall))
        text = (
            f"time that runs backwards: sample {row + 1} at {stream.t[row]:.3f} s after {before[row]:.3f} s"
        )
        raise ConfigError(where, stream.name, text, f"rising stamps; one may be late by {LATE_S:g} s")
    rises: Flags = usable_rows & (fall < 0.0)
    return rises


def _unit(plate: Plate) -> tuple[Plate, Flags]:
    """Return a plate with quaternions of length 1, and which of them are rotations."""
    length = np.linalg.norm(plate.quaternion, axis=1)
    is_rotation = ~(np.abs(length - 1.0) > _LENGTH)
    scale = np.where(is_rotation, length, 1.0)
    return replace(plate, quaternion=plate.quaternion / scale[:, None]), is_rotation
