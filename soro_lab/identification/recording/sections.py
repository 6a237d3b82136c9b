"""Sections of a long recording, so that some of each kind can be held out of a fit."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from soro_lab.identification.recording.phases import decays, excited
from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.rest import rest_states
from soro_lab.identification.recording.stillness import StillLimits, still_limits

Kind: TypeAlias = Literal["rest", "step", "sweep", "release"]


@dataclass(frozen=True)
class SectionLimits:
    """How a recording is cut.

    Attributes
    ----------
    lead_s : float
        Rest before a motion that belongs to its section [s]: a simulation starts at rest.
    gap_s : float
        Time without pressures at which a section ends [s].
    longest_s : float
        Longest section [s]; one without a rest inside is cut into equal parts.
    sweep_s : float
        Time [s] above which pressures that move all the while make a sweep of a section, not a step.
    """

    lead_s: float = 0.5
    gap_s: float = 1.0
    longest_s: float = 15.0
    sweep_s: float = 5.0


@dataclass(frozen=True)
class RecordingSegment:
    """A part of a recording.

    Attributes
    ----------
    kind : {"rest", "step", "sweep", "release"}
        Nothing moves; pressures move for a short time; they move for a long one; only the arm moves.
    start, end : float
        [s]; the end belongs to the next section.
    starts_at_rest : bool
        Whether the arm is at rest at the start, under the pressures there.
    """

    kind: Kind
    start: float
    end: float
    starts_at_rest: bool


def sections(
    recording: Recording, limits: SectionLimits | None = None, still: StillLimits | None = None
) -> tuple[RecordingSegment, ...]:
    """Cut a recording where a rest ends, so that each part begins at rest and ends with the next rest.

    Of two sweeps one can be held out: a single one of twice `sweep_s` or more is cut in two.

    Parameters
    ----------
    recording : Recording
        Pressures and shapes.
    limits : SectionLimits, optional
        How it is cut.
    still : StillLimits, optional
        What stands still; default: parts of the ranges of this recording.
    """
    limits = SectionLimits() if limits is None else limits
    still = still_limits([recording]) if still is None else still
    rests = [(state.start, state.end) for state in rest_states(recording, still)]
    cuts = []
    for begin, end in _without_gaps(recording, limits.gap_s):
        ends = [max(stop - limits.lead_s, start) for start, stop in rests]
        inner = [cut for cut, (_, stop) in zip(ends, rests, strict=True) if begin < cut and stop < end - 1e-9]
        marks = [begin, *inner, end]
        for first, last in itertools.pairwise(marks):
            number = max(1, int(np.ceil((last - first) / limits.longest_s - 1e-9)))
            inside = any(first < start and stop < last for start, stop in rests)
            edges = np.linspace(first, last, (1 if inside else number) + 1)
            cuts += [(float(a), float(b)) for a, b in itertools.pairwise(edges)]
    moving = [(phase.start, phase.end) for phase in excited(recording, still)]
    free = [(phase.start, phase.end) for phase in decays(recording, still)]
    kinds = [_kind(start, end, moving, free, limits) for start, end in cuts]
    if kinds.count("sweep") == 1:
        at = kinds.index("sweep")
        cuts[at : at + 1], kinds[at : at + 1] = _halves(*cuts[at], limits)
    found = []
    for (start, end), kind in zip(cuts, kinds, strict=True):
        at_rest = any(a <= start + 1e-9 and start < b for a, b in rests)
        found.append(RecordingSegment(kind, start, end, at_rest))
    return tuple(found)


def hold_out(
    parts: Sequence[RecordingSegment], every: int = 4
) -> tuple[tuple[RecordingSegment, ...], tuple[RecordingSegment, ...]]:
    """Return the sections for a fit, and those held out: of each kind the second one, and each `every`-th on.

    A kind with one section has none to hold out.
    """
    by_kind: dict[Kind, list[RecordingSegment]] = defaultdict(list)
    for part in parts:
        by_kind[part.kind].append(part)
    out = {id(part) for group in by_kind.values() for part in group[1::every]}
    return tuple(p for p in parts if id(p) not in out), tuple(p for p in parts if id(p) in out)


def _halves(start: float, end: float, limits: SectionLimits) -> tuple[list[tuple[float, float]], list[Kind]]:
    if end - start < 2.0 * limits.sweep_s:
        return [(start, end)], ["sweep"]
    middle = 0.5 * (start + end)
    return [(start, middle), (middle, end)], ["sweep", "sweep"]


def _without_gaps(recording: Recording, gap_s: float) -> list[tuple[float, float]]:
    """Return the stretches [s] in which pressures are known."""
    start, end = recording.span
    t = recording.pressure.window(start, np.nextafter(end, np.inf)).t
    gaps = np.flatnonzero(np.diff(t) > gap_s)
    begins = [start, *(float(t[gap + 1]) for gap in gaps)]
    ends = [*(float(t[gap]) for gap in gaps), end]
    return [(begin, stop) for begin, stop in zip(begins, ends, strict=True) if stop > begin]


def _kind(
    start: float,
    end: float,
    moving: Sequence[tuple[float, float]],
    free: Sequence[tuple[float, float]],
    limits: SectionLimits,
) -> Kind:
    if longest := _overlap(start, end, moving):
        return "sweep" if longest > limits.sweep_s else "step"
    return "release" if _overlap(start, end, free) else "rest"


def _overlap(start: float, end: float, parts: Sequence[tuple[float, float]]) -> float:
    """Return the longest time [s] of one of the parts between start and end."""
    return max((max(0.0, min(end, stop) - max(start, begin)) for begin, stop in parts), default=0.0)
