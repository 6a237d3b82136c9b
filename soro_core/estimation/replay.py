"""Prediction of the newest steps, and of those before that a late sample changes.

A sample stamped in the past belongs to an earlier segment: the filter rolls back to the start of that segment
and replays the following ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter

from soro_core.estimation.filter import Filter
from soro_core.estimation.kernel.advance import FOUND, FROZEN, MISSED, SAME_S
from soro_core.estimation.kernel.belief import Belief
from soro_core.estimation.kernel.noise import N_NOISE, NOISE
from soro_core.estimation.kernel.update import FAILED, FUSED, OUTLIER
from soro_core.estimation.sensors.monitor import Innovation
from soro_core.estimation.sensors.samples import PoseSample, Sample
from soro_core.estimation.state import Segment, Sensor
from soro_core.estimation.tick_state import TickState

_STAMP = attrgetter("stamp_s")
# Counts by what becomes of a new sample.
_COUNTED = {
    FUSED: ("accepted",),
    OUTLIER: ("outliers",),
    FAILED: ("failed",),
    FROZEN: ("frozen",),
    FOUND: ("reacquired", "accepted"),
    MISSED: ("reacquired", "failed"),
}


def replay(filter_: Filter, tick: TickState, fresh: list[Sample]) -> None:
    """Compute the newest segments, and those before that the samples change.

    Parameters
    ----------
    filter_ : Filter
    tick : TickState
        At the new time, its newest segments not predicted yet.
    fresh : list of Sample
        Samples of this tick.
    """
    history = tick.history
    if not history:
        return
    first, new = _places(history, fresh)
    tick.belief = history[first].belief
    ahead = _predicted(tick, first)
    for i in range(first, len(history)):
        history[i] = _segment(filter_, tick, history[i], new.get(i, ()), ahead if i == first else None)


def _places(history: list[Segment], fresh: list[Sample]) -> tuple[int, dict[int, list[Sample]]]:
    """Return the first segment to compute, and the new samples of each."""
    new: dict[int, list[Sample]] = {}
    first = last = len(history) - 1
    for sample in fresh:
        i = last
        while i > 0 and sample.stamp_s <= history[i - 1].end_s + SAME_S:
            i -= 1
        new.setdefault(i, []).append(sample)
        first = min(first, i)
    # The newest segments still have the belief of the one before: the pass computes theirs.
    while first > 0 and history[first].belief is history[first - 1].belief:
        first -= 1
    return first, new


def _predicted(tick: TickState, i: int) -> Belief | None:
    """Return the belief at the end of a segment where it is known, and no sample has changed it since."""
    history, start_s = tick.history, tick.history[i].start_s
    if i + 1 == len(history) or any(one.stamp_s > start_s for one, _ in tick.sensors.values()):
        return None
    ahead = history[i + 1].belief
    return None if ahead is history[i].belief else ahead


def _segment(
    filter_: Filter, tick: TickState, part: Segment, arrivals: Sequence[Sample], ahead: Belief | None = None
) -> Segment:
    """Predict one segment with its samples and return it.

    Parameters
    ----------
    filter_ : Filter
    tick : TickState
        With the belief at the start of the segment.
    part : Segment
    arrivals : sequence of Sample
        New samples in it.
    ahead : Belief or None
        At its end without them, where it is known.
    """
    start_s, end_s, pressure_pa, _, old, known = part
    initial, t, kept = tick.belief, start_s, []
    samples = sorted((*old, *arrivals), key=_STAMP) if old else arrivals  # which come in this order
    if ahead is not None and samples and samples[0].stamp_s == end_s and isinstance(samples[0], PoseSample):
        tick.belief, t = ahead, end_s
    for sample in samples:
        is_new = not old or any(sample is one for one in arrivals)
        if _take(filter_, tick, part, sample.stamp_s - t, sample, is_new):
            kept.append(sample)
        t = max(t, sample.stamp_s)
    if end_s - t > SAME_S:
        tick.belief, ok = filter_.predict(tick.belief, pressure_pa, end_s - t, known)
        if not ok:
            tick.count("failed")
            if not tick.belief.finite():  # a covariance that outliers have inflated beyond all bounds
                tick.belief = filter_.start()
    return Segment(start_s, end_s, pressure_pa, initial, tuple(kept), known)


def _take(filter_: Filter, tick: TickState, part: Segment, dt: float, sample: Sample, is_new: bool) -> bool:
    """Predict to a sample and use it; gives whether a replay needs it again.

    Parameters
    ----------
    filter_ : Filter
    tick : TickState
        With the belief before.
    part : Segment
    dt : float
        Time from the belief to the sample [s].
    sample : Sample
    is_new : bool
        False for one that is replayed.
    """
    name = sample.sensor
    last = tick.sensors.get(name)
    record = last.record if last is not None else None
    found = filter_.advance(tick.belief, part.pressure_pa, dt, part.known, sample, record, is_new)
    outcome = found.outcome
    tick.belief = found.belief
    if not found.ok:
        tick.count("failed")
    if used := outcome in (FUSED, FOUND):
        tick.last_s = max(tick.last_s, sample.stamp_s)
        if isinstance(sample, PoseSample):
            tick.position_s = max(tick.position_s, sample.stamp_s)
    if not is_new:
        if not used:
            tick.count("failed")
        return True
    tick.count(*_COUNTED[outcome])
    tick.sensors[name] = Sensor(sample, found.record)
    if outcome != FROZEN:
        noise = found.record[NOISE : NOISE + N_NOISE].tolist()
        tick.innovations.append(Innovation(name, sample.stamp_s, found.nis, found.position_nis, *noise))
    return used
