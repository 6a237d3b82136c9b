"""Free decays and excited stretches of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.stillness import StillLimits, blocks, noise, still_limits, stretches
from soro_lab.identification.recording.streams import Series

# A decay is larger than the limit of rest by this factor: neither creep is one, nor the effect of pressures
# that still count as standing still.
_LARGE = 20.0


@dataclass(frozen=True)
class Phase:
    """A stretch of time of one kind."""

    kind: Literal["excited", "decay"]
    """`excited`: pressures move; `decay`: only the arm moves."""
    start: float
    """Time of its start in the recording [s]."""
    end: float
    """Time of its end in the recording [s]."""

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.end - self.start


def decays(recording: Recording, limits: StillLimits | None = None) -> tuple[Phase, ...]:
    """Return the free decays: the arm still moves after a step or a release, while the pressures stand still.

    After a step a decay begins at the first sample at which all pressures are those of its end, after a
    release at the last sample at which the arm was still held.

    Parameters
    ----------
    recording : Recording
        Pressures and shapes.
    limits : StillLimits, optional
        What stands still; default: parts of the ranges of this recording.
    """
    limits = still_limits([recording]) if limits is None else limits
    found = blocks(recording, limits)
    moving = found.pressure_known & found.pressure_still & found.shape_known & ~found.shape_still
    phases: list[Phase] = []
    for begin, end in stretches(moving):
        stop = float(found.edges[end])
        if begin and found.pressure_known[begin - 1] and not found.pressure_still[begin - 1]:
            start = _settled(recording.pressure, float(found.edges[begin]), stop, limits)
        else:
            start = _let_go(recording, float(found.edges[begin]), stop, limits)
        earliest = phases[-1].end if phases else recording.span[0]
        phases.append(Phase("decay", max(start, earliest), stop))
    return tuple(phase for phase in phases if _is_large(recording.window(phase.start, phase.end), limits))


def excited(
    recording: Recording, limits: StillLimits | None = None, pause_s: float = 1.0
) -> tuple[Phase, ...]:
    """Return the stretches in which a pressure moves.

    Parameters
    ----------
    recording : Recording
        Pressures and shapes.
    limits : StillLimits, optional
        What stands still; default: parts of the ranges of this recording.
    pause_s : float
        Longest pause [s] within a stretch.
    """
    limits = still_limits([recording]) if limits is None else limits
    found = blocks(recording, limits)
    moving = found.pressure_known & ~found.pressure_still
    phases: list[Phase] = []
    for begin, end in stretches(moving):
        start, stop = float(found.edges[begin]), float(found.edges[end])
        if phases and start - phases[-1].end < pause_s:
            start = phases.pop().start
        phases.append(Phase("excited", start, stop))
    # Noise that fills one block moves nothing.
    return tuple(phase for phase in phases if _changes(recording.pressure, phase, limits))


def _is_large(part: Recording, limits: StillLimits) -> bool:
    shown = [stream for stream in part.shapes if stream.t.size]
    return any((np.ptp(each.motion(), axis=0) > _LARGE * limits.of(each)).any() for each in shown)


def _changes(pressure: Series, phase: Phase, limits: StillLimits) -> bool:
    """Return whether a phase ends at another pressure, or takes longer than a block."""
    sides = ((phase.start - limits.block_s, phase.start), (phase.end, phase.end + limits.block_s))
    before, after = (pressure.window(*side).values for side in sides)
    if phase.duration > 1.5 * limits.block_s or not len(before) or not len(after):
        return True
    return bool((np.abs(after.mean(axis=0) - before.mean(axis=0)) > limits.pressure_pa).any())


def _let_go(recording: Recording, start: float, stop: float, limits: StillLimits) -> float:
    """Return the time of the last sample at which the shape is that of the block before a stretch."""
    times = [stop]
    for stream in recording.shapes:
        before, inside = stream.window(start - limits.block_s, start), stream.window(start, stop)
        if before.t.size and inside.t.size:
            band = limits.of(stream) + 3.0 * noise(stream)
            off = (np.abs(inside.motion() - before.motion().mean(axis=0)) > band).any(axis=1)
            last = int(np.argmax(off)) - 1 if off.any() else inside.t.size - 1
            times.append(float(inside.t[last]) if last >= 0 else start)
    return start if len(times) == 1 else min(times)


def _settled(pressure: Series, start: float, stop: float, limits: StillLimits) -> float:
    """Return the time from which on the pressures are those of a stretch: at most one second before it."""
    inside = pressure.window(start, stop).values
    if not len(inside):
        return start
    band = limits.pressure_pa + 2.0 * inside.std(axis=0)
    near = pressure.window(start - 1.0, stop)
    off = np.flatnonzero((np.abs(near.values - np.median(inside, axis=0)) > band).any(axis=1))
    if not len(off):
        return float(near.t[0])
    return float(near.t[off[-1] + 1]) if off[-1] + 1 < len(near.t) else start
