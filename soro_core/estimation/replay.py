"""Prediction of the newest steps, and of those before that a late sample changes.

A sample stamped in the past belongs to an earlier segment: the filter rolls back to the start of that segment
and replays the following ones.
"""

from __future__ import annotations

from operator import attrgetter

import numpy as np

from soro_core.estimation.admission import SAME_S, Admitted
from soro_core.estimation.config import EstimatorConfig
from soro_core.estimation.filter import Filter, Fused
from soro_core.estimation.frozen import next_pose
from soro_core.estimation.monitor import Innovation
from soro_core.estimation.samples import PoseSample, Sample
from soro_core.estimation.state import EstimatorState, Segment


class Replay:
    """One tick's pass over the history; it holds what changes under way.

    Parameters
    ----------
    filter_ : Filter
    config : EstimatorConfig
    state : EstimatorState
        At the new time, its newest segments not predicted yet.
    admitted : Admitted
        Samples of this tick.
    """

    def __init__(
        self, filter_: Filter, config: EstimatorConfig, state: EstimatorState, admitted: Admitted
    ) -> None:
        self.filter, self.config, self.state = filter_, config, state
        self.belief, self.counts, self.admitted = state.belief, admitted.counts, admitted
        self.refused, self.poses = dict(state.refused), dict(state.poses)
        self.last_s, self.position_s = state.last_s, state.position_s
        self.innovations: list[Innovation] = []  # of the new samples

    def result(self) -> EstimatorState:
        """Pass over the history and return the state."""
        history = list(self.state.history)
        if history:
            first, new = self._places(history)
            self.belief = history[first].belief
            for i in range(first, len(history)):
                history[i] = self._segment(history[i], new.get(i, ()))
        return self.state._replace(
            belief=self.belief,
            history=tuple(history),
            waiting=self.admitted.waiting,
            stamps=self.admitted.stamps,
            refused=self.refused,
            last_s=self.last_s,
            position_s=self.position_s,
            poses=self.poses,
            counts=self.counts,
        )

    def _places(self, history: list[Segment]) -> tuple[int, dict[int, list[Sample]]]:
        """Return the first segment to compute, and the new samples of each."""
        new: dict[int, list[Sample]] = {}
        first = last = len(history) - 1
        for sample in self.admitted.fresh:
            i = last
            while i > 0 and sample.stamp_s <= history[i - 1].end_s + SAME_S:
                i -= 1
            new.setdefault(i, []).append(sample)
            first = min(first, i)
        # The newest segments still have the belief of the one before: the pass computes theirs.
        while first > 0 and history[first].belief is history[first - 1].belief:
            first -= 1
        return first, new

    def _segment(self, part: Segment, arrivals: list[Sample] | tuple[()]) -> Segment:
        """Predict one segment with its samples and return it."""
        begun, t = self.belief, part.start_s
        if not (arrivals or part.samples):
            self._predict(part, part.end_s - t)
            return part._replace(belief=begun)
        kept = []
        for sample in sorted([*part.samples, *arrivals], key=attrgetter("stamp_s")):
            self._predict(part, sample.stamp_s - t)
            t = max(t, sample.stamp_s)
            is_new = not part.samples or any(sample is one for one in arrivals)
            if self._use(sample, is_new):
                kept.append(sample)
        self._predict(part, part.end_s - t)
        return part._replace(belief=begun, samples=tuple(kept))

    def _predict(self, part: Segment, dt: float) -> None:
        if dt <= SAME_S:
            return
        self.belief, ok = self.filter.predict(self.belief, part.pressure_pa, dt, part.known)
        if not ok:
            if not self.belief.finite():  # a covariance that outliers have inflated beyond all bounds
                self.belief = self.filter.start()
            self.counts = self.counts._replace(failed=self.counts.failed + 1)

    def _use(self, sample: Sample, new: bool) -> bool:
        """Fuse one sample and return whether it was used; a replayed one has passed its checks before."""
        fused = self.filter.fuse(self.belief, sample, new)
        pose = isinstance(sample, PoseSample)
        if not new:
            self._accept(fused, sample)
            return True
        if isinstance(sample, PoseSample):
            record = next_pose(self.poses.get(sample.sensor), sample, fused.before)
            self.poses[sample.sensor] = record
            if record.is_frozen(self.config.pose.position_std_m):
                self.counts = self.counts._replace(frozen=self.counts.frozen + 1)
                return False
        residual = None
        if isinstance(sample, PoseSample) and fused.belief is not None:
            residual = sample.position - fused.after
        self.innovations.append(
            Innovation(sample.sensor, sample.stamp_s, fused.nis, fused.position_nis, residual)
        )
        if fused.outlier:
            if not self._is_lost(sample):
                return False
            fused = self.filter.fuse(self.belief, sample, False)
        if not self._accept(fused, sample):
            return False
        self.refused[sample.sensor] = 0
        self.counts = self.counts._replace(accepted=self.counts.accepted + 1)
        if pose:
            self.poses[sample.sensor] = self.poses[sample.sensor]._replace(after=fused.after)
        return True

    def _is_lost(self, sample: Sample) -> bool:
        """Count an outlier; after many in a row the state is more likely wrong than the sensor.

        The belief then restarts at the straight arm, from which the iterated update converges.
        """
        name, config = sample.sensor, self.config
        self.refused[name] = self.refused.get(name, 0) + 1
        if self.refused[name] < config.reacquire_after:
            with np.errstate(over="ignore"):  # the next prediction finds it
                covariance = config.outlier_inflation * self.belief.covariance
            self.belief = self.belief._replace(covariance=covariance)
            self.counts = self.counts._replace(outliers=self.counts.outliers + 1)
            return False
        self.belief = self.filter.start()
        self.counts = self.counts._replace(reacquired=self.counts.reacquired + 1)
        return True

    def _accept(self, fused: Fused, sample: Sample) -> bool:
        """Take the result of a sample; without a finite one the filter starts anew."""
        if fused.belief is None:
            self.belief = self.filter.start()
            self.counts = self.counts._replace(failed=self.counts.failed + 1)
            return False
        self.belief = fused.belief
        self.last_s = max(self.last_s, sample.stamp_s)
        if isinstance(sample, PoseSample):
            self.position_s = max(self.position_s, sample.stamp_s)
        return True
