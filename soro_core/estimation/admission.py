"""Which samples are used at a tick: finite, neither too old nor too early, and not repeated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from soro_core.estimation.config import EstimatorConfig
from soro_core.estimation.samples import PoseSample, Sample
from soro_core.estimation.state import EstimatorState
from soro_core.estimation.status import Counts

# Samples stamped in the future that wait; more come from a sensor whose clock is wrong.
_MOST_WAITING = 16
# Times that differ by less [s] are equal: ticks and stamps are sums of periods.
SAME_S = 1e-9


class Admitted(NamedTuple):
    """Samples sorted by stamp.

    Attributes
    ----------
    fresh, waiting : tuple of Sample
        To be used now, and at a later tick.
    stamps : mapping of str to float
        Last stamp of each sensor [s].
    counts : Counts
        With those that were refused.
    """

    fresh: tuple[Sample, ...]
    waiting: tuple[Sample, ...]
    stamps: Mapping[str, float]
    counts: Counts


def admit(
    state: EstimatorState, offered: Iterable[Sample], config: EstimatorConfig, length_m: float
) -> Admitted:
    """Sort the offered samples.

    Parameters
    ----------
    state : EstimatorState
        At the new time.
    offered : iterable of Sample
    config : EstimatorConfig
    length_m : float
        Length of the arm [m].
    """
    counts, stamps = state.counts, dict(state.stamps)
    fresh: list[Sample] = []
    waiting: list[Sample] = []
    start = state.history[0].start_s if state.history else state.t_s
    for sample in sorted(offered, key=_stamp):
        noise = config.pose if isinstance(sample, PoseSample) else config.imu
        oldest = max(state.t_s - noise.max_age_s, start)
        if not sample.finite() or not -1e-9 <= sample.s <= length_m + 1e-6:
            counts = counts._replace(invalid=counts.invalid + 1)
        elif sample.stamp_s > state.t_s + config.future_s:
            counts = counts._replace(early=counts.early + 1)
        elif sample.stamp_s > state.t_s + SAME_S:
            waiting.append(sample)
        elif sample.stamp_s < oldest or sample.stamp_s <= stamps.get(sample.sensor, -math.inf):
            counts = counts._replace(stale=counts.stale + 1)
        else:
            stamps[sample.sensor] = sample.stamp_s
            fresh.append(sample)
    return Admitted(tuple(fresh), tuple(waiting[-_MOST_WAITING:]), stamps, counts)


def _stamp(sample: Sample) -> float:
    return sample.stamp_s if math.isfinite(sample.stamp_s) else -math.inf
