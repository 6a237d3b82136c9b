"""States at rest: mean pressures and mean shape where both stand still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_lab.identification.recording.base_frame import aligned
from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.stillness import StillLimits, blocks, still_limits, stretches
from soro_lab.identification.recording.streams import Attitude, Plate, Stream

# Parts of a stretch whose means are compared: samples that follow each other are no independent evidence.
_PARTS = 8
# Longest time [s] within a rest in which noise looks like a motion.
_PAUSE_S = 1.0


@dataclass(frozen=True)
class Mean:
    """Mean of a stream over a stretch of time.

    Attributes
    ----------
    stream : str
        Name of the stream.
    value : array of shape (m,)
        Mean of the columns of `Stream.table`: of a plate position [m] and quaternion.
    deviation : array of shape (m,)
        Standard deviation of the mean, from the means of up to 8 parts of the stretch: it counts slow drift
        and creep as well as noise.
    samples : int
        Number of samples.
    """

    stream: str
    value: Array
    deviation: Array
    samples: int


@dataclass(frozen=True)
class RestState:
    """Pressures and shape of an arm at rest.

    Attributes
    ----------
    start, end : float
        The stretch [s].
    pressure : Mean
        Pressures (n_u,) [Pa].
    shapes : tuple of Mean
        Streams of the shape that have samples there.
    """

    start: float
    end: float
    pressure: Mean
    shapes: tuple[Mean, ...]

    def of(self, stream: str) -> Mean | None:
        """Return the mean of a stream; None where it has no samples in this state."""
        return next((mean for mean in self.shapes if mean.stream == stream), None)


def rest_states(recording: Recording, limits: StillLimits | None = None) -> tuple[RestState, ...]:
    """Return the states at rest of a recording, in the order of time.

    Parameters
    ----------
    recording : Recording
        Pressures and shapes.
    limits : StillLimits, optional
        What stands still, and the shortest rest; default: parts of the ranges of this recording.
    """
    limits = still_limits([recording]) if limits is None else limits
    found = blocks(recording, limits)
    states: list[RestState] = []
    for begin, end in stretches(found.rest):
        state = _state(recording, float(found.edges[begin]), float(found.edges[end]))
        near = bool(states) and state.start - states[-1].end <= _PAUSE_S
        if near and _same(states[-1], state, recording, limits):
            state = _state(recording, states.pop().start, state.end)
        states.append(state)
    return tuple(state for state in states if state.end - state.start >= limits.least_s - 1e-9)


def _state(recording: Recording, start: float, end: float) -> RestState:
    part = recording.window(start, end)
    return RestState(start, end, mean(part.pressure), tuple(mean(s) for s in part.shapes if s.t.size))


def _same(one: RestState, other: RestState, recording: Recording, limits: StillLimits) -> bool:
    """Return whether two states are one level: a block of noise between them is no motion."""
    levels = [(recording.pressure, one.pressure, other.pressure)]
    shown = [(stream, one.of(stream.name), other.of(stream.name)) for stream in recording.shapes]
    pairs: list[tuple[Stream, Mean, Mean]] = [*levels, *((s, a, b) for s, a, b in shown if a and b)]
    return all(
        (np.abs(a.value - b.value)[: stream.motion().shape[1]] <= 2.0 * limits.of(stream)).all()
        for stream, a, b in pairs
    )


def mean(stream: Stream) -> Mean:
    """Return the mean of all samples of a stream, one or more."""
    table = stream.table()
    if isinstance(stream, Plate):  # q and -q are one rotation, and the mean of rotations has length 1
        quaternion = aligned(stream.quaternion)
        table = np.column_stack([stream.position, quaternion / np.linalg.norm(quaternion.mean(axis=0))])
    if isinstance(stream, Attitude):
        quaternion = aligned(stream.quaternion)
        table = quaternion / np.linalg.norm(quaternion.mean(axis=0))
    number = min(_PARTS, len(table) // 2)
    if number < 2:
        deviation = np.full(table.shape[1], np.nan)
    else:
        means = np.array([part.mean(axis=0) for part in np.array_split(table, number)])
        deviation = means.std(axis=0, ddof=1) / np.sqrt(number)
    return Mean(stream.name, table.mean(axis=0), deviation, len(table))
