"""Which samples are used at a tick: finite, neither too old nor too early, and not repeated."""

from __future__ import annotations

import math
from collections.abc import Iterable

from soro_core.estimation.config import EstimatorConfig
from soro_core.estimation.kernel.advance import SAME_S
from soro_core.estimation.sensors.samples import PoseSample, Sample
from soro_core.estimation.sensors.tracker import Tracker
from soro_core.estimation.tick_state import TickState

# Samples stamped in the future that wait; more come from a sensor whose clock is wrong.
_MOST_WAITING = 16


def admit(
    tick: TickState,
    offered: Iterable[Sample],
    config: EstimatorConfig,
    length_m: float,
    tracker: Tracker | None = None,
) -> list[Sample]:
    """Return the samples to be used now, sorted by stamp; those of later wait, others are counted.

    Parameters
    ----------
    tick : TickState
        At the new time.
    offered : iterable of Sample
    config : EstimatorConfig
    length_m : float
        Length of the arm [m].
    tracker : Tracker, optional
        What poses are seen by; they are returned as those of cross-sections in the robot's world.
    """
    fresh: list[Sample] = []
    waiting: list[Sample] = []
    stamps, now_s = tick.stamps, tick.t_s
    start = tick.history[0].start_s if tick.history else now_s
    for sample in sorted(offered, key=_stamp):
        noise = config.pose if isinstance(sample, PoseSample) else config.imu
        oldest = max(now_s - noise.max_age_s, start)
        if not sample.finite() or not -1e-9 <= sample.s <= length_m + 1e-6:
            tick.count("invalid")
        elif sample.stamp_s > now_s + config.future_s:
            tick.count("early")
        elif sample.stamp_s > now_s + SAME_S:
            waiting.append(sample)
        elif sample.stamp_s < oldest or sample.stamp_s <= stamps.get(name := sample.sensor, -math.inf):
            tick.count("stale")
        else:
            stamps[name] = sample.stamp_s
            if tracker is not None and isinstance(sample, PoseSample):
                sample = tracker.section(sample)
            fresh.append(sample)
    tick.waiting = tuple(waiting[-_MOST_WAITING:])
    return fresh


def _stamp(sample: Sample) -> float:
    return sample.stamp_s if math.isfinite(sample.stamp_s) else -math.inf
