"""The estimator: a Kalman filter with a short history, which fuses a late sample at the time of its stamp.

The state keeps one segment for each step: pressures, learned force, belief at its start, samples fused in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from soro_core.adaptation.external_force import ExternalForce
from soro_core.adaptation.learned import Learned
from soro_core.adaptation.scales import q_scale_of
from soro_core.arrays import Array
from soro_core.errors import ModelError, short
from soro_core.estimation.config import EstimatorConfig
from soro_core.estimation.filter import Filter
from soro_core.estimation.force.observer import Noise, force_observer_of
from soro_core.estimation.force.state import ForceState
from soro_core.estimation.force_samples import positions_since
from soro_core.estimation.kernel.advance import SAME_S
from soro_core.estimation.learned_input import update_learned_input
from soro_core.estimation.noise_scaling import scaled_noise
from soro_core.estimation.replay import replay
from soro_core.estimation.sample_validity import admit
from soro_core.estimation.sensors.monitor import note_of, watched
from soro_core.estimation.sensors.samples import ImuSample, PoseSample
from soro_core.estimation.sensors.tracker import Tracker
from soro_core.estimation.state import EstimatorState
from soro_core.estimation.status import Estimate, EstimatorStatus
from soro_core.estimation.tick_state import TickState
from soro_core.estimation.unmeasured_subspace import unmeasured_covariance
from soro_core.model.checks import number, require, shaped
from soro_core.model.discretised import discretised
from soro_core.robot import Discretisation, Robot, refuse_tendons


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

    Raises
    ------
    ModelError
        If an argument is of another type, or dt is not a number above 0.
    ConfigError
        If the robot has tendons.
    """

    def __init__(
        self,
        robot: Robot,
        config: EstimatorConfig | None = None,
        dt: float = 0.005,
        model: Discretisation = Discretisation(),  # noqa: B008 -- frozen
    ) -> None:
        require(robot, Robot, "robot", "a Robot, from load_robot or robot_from_dict")
        require(config, EstimatorConfig | None, "config", "an EstimatorConfig")
        require(model, Discretisation, "model", "a Discretisation")
        if not 0.0 < number(dt) < math.inf:
            raise ModelError(f"dt = {short(dt)} s: allowed is a number above 0", "dt")
        refuse_tendons(robot, "estimator")
        self.config = scaled_noise(config if config is not None else EstimatorConfig(), robot)
        self.arm = discretised(robot, model)
        self.filter = Filter(self.arm, self.config, model.links, dt)
        self._tracker = Tracker.of(robot)
        self._units = np.diag(q_scale_of(self.arm, model.links) ** 2)
        self.length = float(sum(link.length for link in robot.links))
        self._kept = max(1, math.ceil(self.config.history_s / dt))
        noise = Noise(self.config.pose.position_std_m, self.config.pressure_std_pa)
        self._force = force_observer_of(self.arm, self.config.force, model.links, noise)

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

        Raises
        ------
        ModelError
            If a shape is not allowed.
        """
        n_u, name = self.arm.n_u, self.arm.robot.name
        pressure = np.zeros(n_u) if pressure_pa is None else shaped(pressure_pa, (n_u,), "pressure_pa", name)
        q = None if q is None else shaped(q, (self.arm.n_q,), "q", name)
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

        Raises
        ------
        ModelError
            If the pressures are not (n_u,) numbers, whatever their values.

        Notes
        -----
        Bad values raise nothing: the estimator refuses and counts them, and the status names them.
        """
        measured = shaped(chamber_pressure_pa, (self.arm.n_u,), "chamber_pressure_pa", self.arm.robot.name)
        if not (math.isfinite(dt) and dt > 0.0):
            counts = state.counts._replace(failed=state.counts.failed + 1)
            state = state._replace(counts=counts)
            return state, self._estimate(state, f"time step of {dt} s refused")
        tick = TickState(state, dt)
        self._learn(tick, state, learned)
        if dt > self.config.max_gap_s:
            tick.belief, tick.history = self.filter.widen(state.belief), []
            tick.count("restarted")
        else:
            tick.read(measured)
            mean = 0.5 * (state.pressure_pa + tick.pressure_pa)
            parts = max(1, math.ceil(dt / self.config.max_step_s - 1e-9))
            tick.extend(mean, parts, self._kept)
        fresh = admit(tick, [*state.waiting, *poses, *imus], self.config, self.length, self._tracker)
        replay(self.filter, tick, fresh)
        pushed = tick.force.external is not None and tick.force.external.stage != "free"
        if tick.innovations:
            tick.monitors = watched(tick.monitors, tick.innovations, self.config.watch, pushed)
        if self._force is not None and tick.t_s >= tick.force.due_s - SAME_S:
            tick.force = self._observed(tick)
        state = tick.result()
        return state, self._estimate(state)

    def external_force(self, state: EstimatorState) -> ExternalForce | None:
        """Return what pushes on the arm at its tip, None where it is not estimated.

        It is not where it is switched off, for an arm of varying strain, or without positions of late.
        """
        late = state.t_s - state.position_s > self.config.lost_after_s
        return None if late else state.force.external

    def _observed(self, tick: TickState) -> ForceState:
        """Return what is known of the external force after a tick."""
        assert self._force is not None
        if tick.t_s - tick.position_s > self.config.lost_after_s:
            return tick.force.begun_anew(tick.t_s + self.config.force.period_s)
        last = tick.force.last
        after_s = -math.inf if last is None else last.stamp_s
        seen, place = positions_since(tick.history, tick.belief, after_s)
        return self._force.step(tick.force, seen, place, tick.known, tick.t_s)

    def _learn(self, tick: TickState, state: EstimatorState, learned: Learned | None) -> None:
        """Put the learned force that the next step uses into the state of the tick."""
        late_s = self.config.lost_after_s
        # Whether what is fused has positions in it; without any sample nothing speaks against them.
        placed = not (state.t_s - state.position_s > late_s >= state.t_s - state.last_s)
        if learned is not None and not learned.usable(self.filter.nothing.theta.size):
            learned = None
            tick.count("learned")
        if learned is not None:
            # In the form that kernels take.
            learned = Learned(np.array(learned.theta, dtype=np.float64), learned.own, learned.doubt)
        tick.known = update_learned_input(
            tick.known, learned, tick.dt, placed, self.filter.mean_strain is not None
        )
        if tick.force.held is not None and tick.known.learned is not None:
            tick.known = tick.known._replace(held=tick.force.held.learned)

    def _unseen(self, state: EstimatorState) -> Array:
        """Return the covariance of what the positions of late leave open."""
        t_s, late_s = state.t_s, self.config.lost_after_s
        places = [
            one.s
            for one, _ in state.sensors.values()
            if t_s - one.stamp_s <= late_s and isinstance(one, PoseSample)
        ]
        return unmeasured_covariance(self.filter, state.belief.q, places, self._units)

    def _estimate(self, state: EstimatorState, failure: str = "") -> Estimate:
        mean, _, covariance, n = state.belief
        pose, spread, force = self.filter.tip(state.belief, state.pressure_pa)
        age = state.t_s - state.last_s
        if not failure and age > self.config.lost_after_s:
            failure = (
                f"no good sample for {age:.2f} s" if math.isfinite(age) else "no good sample since the start"
            )
        said = note_of(state.monitors, state.t_s, self.config.lost_after_s, self.config.watch)
        note = "; ".join(filter(None, (state.known.note, said)))
        return Estimate(
            state.t_s,
            mean[:n],
            mean[n : 2 * n],
            covariance[: 2 * n, : 2 * n],
            pose,
            spread,
            force,
            mean[2 * n : 3 * n] if self.filter.n_d else np.zeros(n),
            state.t_s - state.position_s <= self.config.lost_after_s,
            self._unseen(state),
            EstimatorStatus(not failure, failure, state.counts, age, note),
            None
            if failure or state.t_s - state.position_s > self.config.lost_after_s
            else state.force.external,
        )
