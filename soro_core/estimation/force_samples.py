"""Positions for the estimate of the force, and what the arm did at their stamps, from the history."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soro_core.arrays import Array
from soro_core.estimation.force.state import Seen
from soro_core.estimation.kernel.belief import Belief
from soro_core.estimation.sensors.samples import PoseSample
from soro_core.estimation.state import Segment


def positions_since(history: Sequence[Segment], belief: Belief, after_s: float) -> tuple[list[Seen], float]:
    """Return the fused positions of the outermost place that has some, and the place [m].

    Parameters
    ----------
    history : sequence of Segment
    belief : Belief
        At the end of the last one.
    after_s : float
        Only those with later stamps [s].
    """
    poses = [
        (one, i)
        for i, part in enumerate(history)
        if part.samples and part.end_s > after_s
        for one in part.samples
        if isinstance(one, PoseSample) and one.stamp_s > after_s
    ]
    if not poses:
        return [], 0.0
    place = max(one.s for one, _ in poses)
    found = [_seen(history, belief, one, i) for one, i in poses if one.s == place]
    return sorted(found, key=lambda one: one.stamp_s), place


def _seen(history: Sequence[Segment], last: Belief, pose: PoseSample, i: int) -> Seen:
    part = history[i]
    ahead = history[i + 1].belief if i + 1 < len(history) else last
    share = (pose.stamp_s - part.start_s) / (part.end_s - part.start_s)
    start = part.belief

    n, mean = start.n, start.mean + share * (ahead.mean - start.mean)
    return Seen(
        pose.stamp_s,
        np.array(pose.position, dtype=np.float64),
        _pressure(history, i, share),
        mean[:n],
        mean[n : 2 * n],
        start.internal + share * (ahead.internal - start.internal),
    )


def _pressure(history: Sequence[Segment], i: int, share: float) -> Array:
    """Return the pressures a share of the way along segment i: those of a segment are right at its middle."""
    beside = i + 1 if share > 0.5 else i - 1
    if not 0 <= beside < len(history):
        return np.asarray(history[i].pressure_pa)
    part = abs(share - 0.5)
    return np.asarray((1.0 - part) * history[i].pressure_pa + part * history[beside].pressure_pa)
