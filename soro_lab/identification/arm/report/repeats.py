"""How well an arm repeats: its shape at two times with the same pressures, now and over the second before.

What differs between such times no model of the pressures can predict: the spread is the floor of its error.
Two times count as a repeat if every pressure, over the last second, was within a share of its range of what
it was at the other time, and the pressures were elsewhere in between. Rests that are visited twice and
sequences that are commanded twice are both repeats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from soro_core.arrays import Array
from soro_lab.identification.arm.report.traces import ShapeTrace

# Share of its range by which a pressure may differ; the time before, at so many points; elsewhere in between.
_ALIKE = 0.01
_HISTORY_S = np.linspace(-1.0, 0.0, 6)
_ELSEWHERE = 0.1
# Samples a second that are compared.
_RATE_HZ = 10.0


@dataclass(frozen=True)
class Repeats:
    """Spread of one shape between repeats.

    Attributes
    ----------
    shape : str
    pairs : int
        Samples that have a repeat.
    samples : int
        Samples that were looked at.
    spread : float
        RMS of the difference of two repeats over the root of 2: the RMS error of the best prediction, in the
        unit of the shape.
    error : float
        RMS error of the model at the same samples.
    """

    shape: str
    pairs: int
    samples: int
    spread: float
    error: float


def repeats(traces: Sequence[ShapeTrace]) -> tuple[Repeats, ...]:
    """Return the spread of each shape that repeats, over all runs."""
    names = dict.fromkeys(trace.shape for trace in traces)
    found = [_of_shape([trace for trace in traces if trace.shape == name]) for name in names]
    return tuple(each for each in found if each.pairs)


def _of_shape(traces: Sequence[ShapeTrace]) -> Repeats:
    picked = [_thinned(trace.stream.t) for trace in traces]
    run = np.concatenate([np.full(len(k), i) for i, k in enumerate(picked)])
    t = np.concatenate([trace.stream.t[k] for trace, k in zip(traces, picked, strict=True)])
    table = [trace.recording.pressure.values for trace in traces]
    span = np.ptp(np.concatenate(table), axis=0)
    scale = np.where(span > 0.0, span, 1.0)
    past = np.concatenate(
        [
            np.hstack([trace.recording.pressure.at(trace.stream.t[k] + s) / scale for s in _HISTORY_S])
            for trace, k in zip(traces, picked, strict=True)
        ]
    )
    load = np.array([(1e3 * trace.recording.load_kg, *trace.recording.push_n) for trace in traces])
    load[:, 1:] *= 100.0  # a gram, or 10 mN, is another state
    past = np.column_stack((load[run], past))
    begin = np.array([float(trace.recording.pressure.t[0]) for trace in traces])
    known = t + _HISTORY_S[0] >= begin[run] - 1e-9
    places = [trace.stream.motion().reshape(len(trace.stream.t), -1) for trace in traces]
    width = places[0].shape[1]
    shown = np.concatenate([p[k] for p, k in zip(places, picked, strict=True)])
    missed = np.concatenate(
        [trace.differences[k][:, :width] for trace, k in zip(traces, picked, strict=True)]
    )
    pairs = _pairs(np.where(known[:, None], past, np.nan), run, past[:, -len(span) :])
    if not pairs:
        return Repeats(traces[0].shape, 0, len(t), float("nan"), float("nan"))
    one, other = np.array(pairs).T
    apart = np.sum((shown[one] - shown[other]) ** 2, axis=1)
    error = np.sum(missed[one] ** 2, axis=1)
    return Repeats(
        traces[0].shape,
        len(pairs),
        len(t),
        float(np.sqrt(0.5 * apart.mean())),
        float(np.sqrt(error.mean())),
    )


def _pairs(past: Array, run: NDArray[np.intp], now: Array) -> list[tuple[int, int]]:
    """Each sample and the nearest one that is a repeat of it, by their numbers.

    Parameters
    ----------
    past : (n, k)
        Pressures of the last second, in ranges; nan where they are not known.
    run : (n,)
        Number of the run.
    now : (n, n_u)
        Pressures, in ranges.
    """
    usable = np.flatnonzero(np.isfinite(past).all(axis=1))
    if not len(usable):
        return []
    near = cKDTree(past[usable]).query_ball_point(past[usable], _ALIKE, p=np.inf)
    found = []
    for at, numbers in zip(usable, near, strict=True):
        others = usable[np.asarray(numbers)]
        first, last = _visit(now, run, int(at))
        others = others[(others < first) | (others > last)]
        if len(others):
            apart = np.abs(past[others] - past[at]).max(axis=1)
            found.append((int(at), int(others[np.argmin(apart)])))
    return found


def _visit(now: Array, run: NDArray[np.intp], at: int) -> tuple[int, int]:
    """First and last sample around one until which its run stays at its pressures."""
    gone = (np.abs(now - now[at]).max(axis=1) > _ELSEWHERE) | (run != run[at])
    before, after = np.flatnonzero(gone[:at]), np.flatnonzero(gone[at:])
    first = int(before[-1]) + 1 if len(before) else 0
    return first, at + int(after[0]) - 1 if len(after) else len(now) - 1


def _thinned(t: Array) -> NDArray[np.intp]:
    return np.unique(np.floor((t - t[0]) * _RATE_HZ + 1e-6), return_index=True)[1]
