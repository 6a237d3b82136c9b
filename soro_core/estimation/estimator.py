"""The estimator: a Kalman filter with a short history, which fuses a late sample at the time of its stamp.

The state keeps one segment for each step (pressures, linearisation, belief at its start, samples fused in
it). A sample stamped in the past belongs to an earlier segment; the filter rolls back to the start of that
segment and replays the following ones with their stored linearisations, which are correct to second order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from soro_core.adaptation.learned import Learned
from soro_core.estimation.config import EstimatorConfig
from soro_core.estimation.filter import Belief, Filter
from soro_core.estimation.frozen import LastPose, next_pose
from soro_core.estimation.known import updated
from soro_core.estimation.measurement import Innovation, innovation
from soro_core.estimation.samples import ImuSample, PoseSample, Sample
from soro_core.estimation.scaled import scaled_noise
from soro_core.estimation.state import EstimatorState, Segment
from soro_core.estimation.status import Counts, Estimate, EstimatorStatus
from soro_core.model.discretised import discretised
from soro_core.robot import Discretisation, Robot

Array: TypeAlias = NDArray[np.float64]


class Estimator:
    """Extended Kalman filter on (q, qd) from chamber pressures, tip poses and IMUs.

    Parameters
    ----------
    robot : Robot
        Robot of the prediction model.
    config : EstimatorConfig
        Noise, gates and limits.
    dt : float
        Nominal step [s], which gives the number of segments in the history.
    model : Discretisation
        Discretisation of the robot; the attribute `arm` is the discretised model.
    """

    def __init__(
        self,
        robot: Robot,
        config: EstimatorConfig | None = None,
        dt: float = 0.005,
        model: Discretisation = Discretisation(),  # noqa: B008 -- frozen
    ) -> None:
        self.config = scaled_noise(config if config is not None else EstimatorConfig(), robot)
        self.arm = discretised(robot, model)
        self.filter = Filter(self.arm, self.config, model.links)
        self.length = float(sum(link.length for link in robot.links))
        self._kept = max(1, math.ceil(self.config.history_s / dt))
        position, orientation = (
            self.config.pose.position_model_std_m,
            self.config.pose.orientation_model_std_rad,
        )
        self._kinematics = np.diag(3 * [position**2] + 3 * [orientation**2])
        self._gates = {m: float(chdtri(m, 1.0 - self.config.gate_probability)) for m in (3, 6, 9)}

    def initial_state(
        self, t_s: float = 0.0, q: Array | None = None, pressure_pa: Array | None = None
    ) -> EstimatorState:
        """Return the state before the first step.

        Parameters
        ----------
        t_s : float
            Time of the start [s].
        q : ndarray (n_q,), optional
            Coordinates; 0, the straight arm, by default.
        pressure_pa : ndarray (n_u,), optional
            Pressures [Pa gauge]; 0 by default.

        Returns
        -------
        EstimatorState
        """
        pressure = np.zeros(self.arm.n_u) if pressure_pa is None else np.array(pressure_pa, dtype=np.float64)
        return EstimatorState(t_s=t_s, belief=self.filter.start(q), pressure_pa=pressure)

    def step(
        self,
        state: EstimatorState,
        chamber_pressure_pa: Array,
        poses: Sequence[PoseSample],
        imus: Sequence[ImuSample],
        dt: float,
        learned: Learned | None = None,
    ) -> tuple[EstimatorState, Estimate]:
        """Advance to ``state.t_s + dt``, the time of `chamber_pressure_pa`, and fuse the samples.

        Parameters
        ----------
        state : EstimatorState
            State after the last step.
        chamber_pressure_pa : ndarray (n_u,)
            Measured gauge pressures [Pa] at the new time; between two readings the model uses their mean.
        poses, imus : sequence of PoseSample, ImuSample
            Samples that arrived since the last step, in any order, stamped when they were taken.
        dt : float
            Time since the last step [s].
        learned : Learned or None
            What a law has learned since the last step; the prediction uses it. Without a new one for 0.1 s
            its force fades out, and the status says so.

        Returns
        -------
        state : EstimatorState
            State at the new time.
        estimate : Estimate
            Estimate at the new time.

        Notes
        -----
        Bad input raises nothing: the estimator refuses and counts it, and the status names it.
        """
        if not (math.isfinite(dt) and dt > 0.0):
            counts = replace(state.counts, failed=state.counts.failed + 1)
            state = replace(state, counts=counts)
            return state, self._estimate(state, f"time step of {dt} s refused")
        # The checks for finiteness below find overflows; numpy's warnings would only fill the log.
        with np.errstate(all="ignore"):
            state = self._known(state, learned, dt)
            if dt > self.config.max_gap_s:
                state = self._restarted(state, dt)
            else:
                state = self._extended(state, dt, chamber_pressure_pa)
            state = self._fuse(state, [*state.waiting, *poses, *imus])
        return state, self._estimate(state)

    def _known(self, state: EstimatorState, learned: Learned | None, dt: float) -> EstimatorState:
        """Return the state with the learned force that the next step uses."""
        counts = state.counts
        if learned is not None and not learned.usable(self.arm.n_q):
            learned, counts = None, replace(counts, learned=counts.learned + 1)
        return replace(state, known=updated(state.known, learned, dt, self._placed(state)), counts=counts)

    def _placed(self, state: EstimatorState) -> bool:
        """Whether what is fused has positions in it; without any sample nothing speaks against them."""
        late_s = self.config.lost_after_s
        return not (state.t_s - state.position_s > late_s >= state.t_s - state.last_s)

    def _pressure(self, state: EstimatorState, pressure_pa: Array) -> tuple[Array, Counts]:
        measured = np.asarray(pressure_pa, dtype=np.float64)
        if measured.shape != (self.arm.n_u,):
            return state.pressure_pa, replace(state.counts, pressures=state.counts.pressures + 1)
        good = np.isfinite(measured)
        if good.all():
            return measured.copy(), state.counts
        counts = replace(state.counts, pressures=state.counts.pressures + 1)
        return np.where(good, measured, state.pressure_pa), counts

    def _extended(self, state: EstimatorState, dt: float, pressure_pa: Array) -> EstimatorState:
        """Append the new step to the history; its prediction follows in `_fuse`."""
        measured, counts = self._pressure(state, pressure_pa)
        mean = 0.5 * (state.pressure_pa + measured)
        parts = max(1, math.ceil(dt / self.config.max_step_s - 1e-9))
        transition = self.filter.transition(state.belief, mean, state.known)
        edges = [state.t_s + dt * i / parts for i in range(parts + 1)]
        added = [
            Segment(edges[i], edges[i + 1], mean, transition, state.belief, known=state.known)
            for i in range(parts)
        ]
        return replace(
            state,
            t_s=state.t_s + dt,
            pressure_pa=measured,
            history=(*state.history, *added)[-self._kept :],
            counts=counts,
        )

    def _restarted(self, state: EstimatorState, dt: float) -> EstimatorState:
        counts = replace(state.counts, restarted=state.counts.restarted + 1)
        return replace(
            state, t_s=state.t_s + dt, belief=self.filter.widen(state.belief), history=(), counts=counts
        )

    def _fuse(self, state: EstimatorState, offered: list[Sample]) -> EstimatorState:
        state, fresh, waiting = self._admit(state, offered)
        history = list(state.history)
        if not history:
            return replace(state, waiting=waiting)
        new: dict[int, list[Sample]] = {}
        for sample in fresh:
            index = next(
                (i for i, part in enumerate(history) if sample.stamp_s <= part.end_s), len(history) - 1
            )
            new.setdefault(index, []).append(sample)
        belief, counts, refused = state.belief, state.counts, dict(state.refused)
        last, position, poses = state.last_s, state.position_s, dict(state.poses)
        first = min([*new, len(history) - 1])
        # The newest segments still have the belief of the one before: the replay computes theirs.
        while first > 0 and history[first].belief is history[first - 1].belief:
            first -= 1
        belief = history[first].belief
        for i in range(first, len(history)):
            part, begun = history[i], belief
            arrivals = new.get(i, [])
            kept, t = [], part.start_s
            for sample in sorted([*part.samples, *arrivals], key=lambda one: one.stamp_s):
                belief, counts = self._predicted(belief, part, sample.stamp_s - t, counts)
                t = max(t, sample.stamp_s)
                gated = any(sample is one for one in arrivals)
                if gated and isinstance(sample, PoseSample) and self._frozen(poses, sample, belief):
                    counts = replace(counts, frozen=counts.frozen + 1)
                    continue
                belief, counts, accepted = self._updated(belief, sample, refused, gated, counts)
                if accepted:
                    kept.append(sample)
                    last = max(last, sample.stamp_s)
                    if isinstance(sample, PoseSample):
                        position = max(position, sample.stamp_s)
                    if gated and isinstance(sample, PoseSample):
                        after = self._place(sample, belief)
                        poses[sample.sensor] = replace(poses[sample.sensor], after=after)
            belief, counts = self._predicted(belief, part, part.end_s - t, counts)
            history[i] = replace(part, belief=begun, samples=tuple(kept))
        if not belief.finite():
            counts = replace(counts, restarted=counts.restarted + 1)
            belief, history = self.filter.start(), []
        return replace(
            state,
            belief=belief,
            history=tuple(history),
            waiting=waiting,
            refused=refused,
            last_s=last,
            position_s=position,
            poses=poses,
            counts=counts,
        )

    def _place(self, sample: PoseSample, belief: Belief) -> Array:
        """Return the estimated position (3,) at the place of a sample [m]."""
        return self.arm.pose(belief.q, min(max(sample.s, 0.0), self.length))[:3, 3]

    def _frozen(self, poses: dict[str, LastPose], sample: PoseSample, belief: Belief) -> bool:
        """Whether a sensor repeats itself while the arm moves; the sample is noted in `poses`."""
        record = next_pose(poses.get(sample.sensor), sample, self._place(sample, belief))
        poses[sample.sensor] = record
        return record.is_frozen(self.config.pose.position_std_m)

    def _admit(
        self, state: EstimatorState, offered: list[Sample]
    ) -> tuple[EstimatorState, list[Sample], tuple[Sample, ...]]:
        """Sort samples by stamp and return the state with counts, the fresh samples and those that wait."""
        counts, stamps = state.counts, dict(state.stamps)
        fresh: list[Sample] = []
        waiting: list[Sample] = []
        start = state.history[0].start_s if state.history else state.t_s
        for sample in sorted(
            offered, key=lambda one: one.stamp_s if math.isfinite(one.stamp_s) else -math.inf
        ):
            noise = self.config.pose if isinstance(sample, PoseSample) else self.config.imu
            oldest = max(state.t_s - noise.max_age_s, start)
            if not sample.finite() or not -1e-9 <= sample.s <= self.length + 1e-6:
                counts = replace(counts, invalid=counts.invalid + 1)
            elif sample.stamp_s > state.t_s + self.config.future_s:
                counts = replace(counts, early=counts.early + 1)
            elif sample.stamp_s > state.t_s:
                waiting.append(sample)
            elif sample.stamp_s < oldest or sample.stamp_s <= stamps.get(sample.sensor, -math.inf):
                counts = replace(counts, stale=counts.stale + 1)
            else:
                stamps[sample.sensor] = sample.stamp_s
                fresh.append(sample)
        return replace(state, counts=counts, stamps=stamps), fresh, tuple(waiting[-16:])

    def _predicted(self, belief: Belief, part: Segment, dt: float, counts: Counts) -> tuple[Belief, Counts]:
        moved, ok = self.filter.predict(belief, part.pressure_pa, part.transition, dt, part.known)
        finite = moved.finite()
        if not (ok and finite):
            counts = replace(counts, failed=counts.failed + 1)
        return (moved if finite else self.filter.widen(belief)), counts

    def _updated(
        self, belief: Belief, sample: Sample, refused: dict[str, int], gated: bool, counts: Counts
    ) -> tuple[Belief, Counts, bool]:
        """Fuse one sample; `gated`: apply the chi-square gate (a replay does not apply it again)."""

        def measure(q: Array, qd: Array) -> Innovation:
            return innovation(self.arm, self.config, sample, q, qd)

        seen = measure(belief.q, belief.qd)
        name = sample.sensor
        if gated and self.filter.distance(belief, seen) > self._gates[seen.residual.shape[0]]:
            refused[name] = refused.get(name, 0) + 1
            if refused[name] < self.config.reacquire_after:
                belief = replace(belief, covariance=self.config.outlier_inflation * belief.covariance)
                return belief, replace(counts, outliers=counts.outliers + 1), False
            # After so many outliers in a row the state is more likely wrong than the sensor. The belief
            # restarts at the straight arm, from which the iterated update converges.
            belief = self.filter.start()
            seen = measure(belief.q, belief.qd)
            counts = replace(counts, reacquired=counts.reacquired + 1)
        updated = self.filter.update(belief, seen, measure)
        if updated is None:
            return self.filter.start(), replace(counts, failed=counts.failed + 1), False
        if gated:
            refused[name] = 0
            counts = replace(counts, accepted=counts.accepted + 1)
        return updated, counts, True

    def _estimate(self, state: EstimatorState, trouble: str = "") -> Estimate:
        belief, n = state.belief, self.arm.n_q
        pose, jacobian = self.arm.pose_and_jacobian(belief.q, self.length)
        rotation = pose[:3, :3]
        world = np.concatenate([rotation @ jacobian[3:], rotation @ jacobian[:3]])
        tip = world @ belief.covariance[:n, :n] @ world.T + self._kinematics
        age = state.t_s - state.last_s
        if not trouble and age > self.config.lost_after_s:
            trouble = (
                f"no good sample for {age:.2f} s" if math.isfinite(age) else "no good sample since the start"
            )
        return Estimate(
            t_s=state.t_s,
            q=belief.q,
            qd=belief.qd,
            covariance=belief.covariance[: 2 * n, : 2 * n],
            tip_pose=pose,
            tip_covariance=0.5 * (tip + tip.T),
            force=np.asarray(self.arm.actuation_matrix(belief.q) @ state.pressure_pa),
            disturbance=belief.disturbance if self.filter.n_d else np.zeros(n),
            positions=state.t_s - state.position_s <= self.config.lost_after_s,
            status=EstimatorStatus(not trouble, trouble, state.counts, age, state.known.note),
        )
