"""Recordings in which a person bends the arm and lets it go, without the time in which a hand holds it."""

from __future__ import annotations

import numpy as np

from soro_lab.identification.recording.phases import decays, excited
from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.rest import RestState, rest_states
from soro_lab.identification.recording.stillness import StillLimits, noise, still_limits

# A motion that begins later than this after the pressures [s] is not theirs.
_AFTER_S = 1.0
# The arm is back where it was: so many limits; creep leaves more than noise.
_BACK = 10.0
# Longest fall of a released arm to half of its bend [s].
_PEAK_S = 0.25


def without_hands(recording: Recording, limits: StillLimits | None = None) -> tuple[Recording, ...]:
    """Return the parts of a recording in which nobody holds the arm.

    The arm leaves a rest while the pressures stand still: a hand takes it. It lets go at the last
    peak before the arm falls to half of its bend. Where no such rest comes, the remainder is left out.

    Parameters
    ----------
    recording : Recording
    limits : StillLimits, optional
        What stands still; default: parts of the ranges of this recording.

    Returns
    -------
    tuple of Recording
        The recording itself if nobody holds the arm. Else the first has its name; others begin with a
        release, and their names say when.
    """
    limits = still_limits([recording]) if limits is None else limits
    rests, driven = rest_states(recording, limits), excited(recording, limits)
    begin, end = recording.span
    parts: list[Recording] = []

    def part(start: float, stop: float) -> Recording:
        name = recording.name if not parts else f"{recording.name}, let go at {start:.2f} s"
        return recording.window(start, stop).renamed(name)

    for phase in decays(recording, limits):
        before = [rest for rest in rests if begin <= rest.start and rest.end <= phase.start + limits.block_s]
        if not before or any(p.start <= phase.start <= p.end + _AFTER_S for p in driven):
            continue
        parts.append(part(begin, phase.start))
        later = [p.start for p in driven if p.start > phase.start]
        back = [
            rest
            for rest in rests
            if phase.start < rest.start < min(later, default=np.inf)
            and _is_back(before[-1], rest, recording, limits)
        ]
        if not back:
            return tuple(parts)
        begin = _let_go(recording, phase.start, back[0])
    return (*parts, part(begin, float(np.nextafter(end, np.inf)))) if parts else (recording,)


def _is_back(before: RestState, after: RestState, recording: Recording, limits: StillLimits) -> bool:
    """Whether the arm rests where it did."""
    for stream in recording.shapes:
        sides = [stream.window(rest.start, rest.end).motion() for rest in (before, after)]
        if all(map(len, sides)):
            apart = np.abs(sides[1].mean(axis=0) - sides[0].mean(axis=0))
            if (apart > _BACK * limits.of(stream)).any():
                return False
    return True


def _let_go(recording: Recording, start: float, rest: RestState) -> float:
    """Return the time of the last peak before the arm falls towards a rest, between a start and that."""
    times = []
    for stream in recording.shapes:
        moved, still = stream.window(start, rest.start), stream.window(rest.start, rest.end)
        if not (moved.t.size and still.t.size):
            continue
        away = moved.motion() - still.motion().mean(axis=0)
        # In the direction of the largest excursion: the swing back is another one.
        far = away[np.argmax(np.linalg.norm(away, axis=1))]
        along = away @ far / np.linalg.norm(far)
        band = 3.0 * float(np.linalg.norm(noise(stream)))
        most = int(np.argmax(along))
        fallen = most + int(np.argmax(along[most:] < 0.5 * along[most]))
        # A hand trembles: the last peak before the fall counts, not the largest.
        first = max(most, int(np.searchsorted(moved.t, moved.t[fallen] - _PEAK_S)))
        last = along[first : fallen + 1]
        times.append(float(moved.t[first + np.flatnonzero(last >= last.max() - band)[-1]]))
    return max(times)
