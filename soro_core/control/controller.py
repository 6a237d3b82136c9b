"""The controller: reference, adaptive law, allocation and the regulators' lag, once a tick."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.control.adaptive import FeedbackGains, adapt, law
from soro_core.control.allocation import allocate, balanced_weight
from soro_core.control.command import Command, ControllerState, ControllerStatus
from soro_core.control.config import ControllerConfig, require_chambers
from soro_core.control.lag import advance, compensate
from soro_core.control.parameters import ParameterSet
from soro_core.control.references import (
    check_limits,
    configured_reference,
    gain_matrix,
    per_coordinate,
    strain_limits,
    tip_reference,
)
from soro_core.control.trajectory import Blend, Hold, Reference, Stop, Waypoints
from soro_core.errors import ConfigError
from soro_core.model.discretised import discretised
from soro_core.robot import Discretisation, Robot
from soro_core.robot.coordinates import strain_fields

Array: TypeAlias = NDArray[np.float64]


class Controller:
    """Passivity-based adaptive controller of one robot.

    Parameters
    ----------
    robot : Robot
        As its file describes it.
    config : ControllerConfig, optional
    model : Discretisation
        How the robot is computed; `arm` and `robot` are what becomes of it.

    Raises
    ------
    ConfigError
        If the configuration does not fit the robot.
    """

    def __init__(
        self,
        robot: Robot,
        config: ControllerConfig | None = None,
        model: Discretisation = Discretisation(),  # noqa: B008 -- frozen
    ) -> None:
        self.config = config if config is not None else ControllerConfig()
        require_chambers(robot, "controller")
        self.arm = discretised(robot, model)
        robot = self.robot = self.arm.robot
        self.parameters = ParameterSet(self.arm, self.config.adaptation)
        gains, pressures = self.config.gains, self.config.pressures
        self.fields = strain_fields(robot)
        self.gains = FeedbackGains(
            # Those of a link, of which each piece takes its share.
            gain_matrix(self.fields, gains.k_p, "gains.k_p") / model.links,
            gain_matrix(self.fields, gains.k_d, "gains.k_d") / model.links,
            per_coordinate(self.fields, gains.lambda_per_s, "gains.lambda_per_s")[0],
        )
        self.force_weight, _ = per_coordinate(self.fields, pressures.force_weight, "pressures.force_weight")
        low = max(pressures.minimum_pa, robot.pressure_range_pa[0])
        high = min(pressures.maximum_pa, robot.pressure_range_pa[1])
        if not low < high:
            allowed = f"a range that overlaps the robot's, {robot.pressure_range_pa}"
            raise ConfigError(
                "controller", "pressures", (pressures.minimum_pa, pressures.maximum_pa), allowed
            )
        self.minimum_pa, self.maximum_pa = np.full(self.arm.n_u, low), np.full(self.arm.n_u, high)
        self.preferred_pa = np.full(self.arm.n_u, min(max(pressures.preferred_pa, low), high))
        adaptation = self.config.adaptation
        # Of a strain with several coefficients it is the root mean square along the link that counts.
        self.dead_zone = np.where(
            self.fields.stretch, adaptation.dead_zone_stretch_per_s, adaptation.dead_zone_curvature_per_m_s
        ) / np.sqrt(np.diag(self.fields.weight))
        self.limit = strain_limits(self.fields, self.config.reference)

    def initial_state(self, pressure_pa: Array | None = None) -> ControllerState:
        """Return the state before the first tick, with the robot file's parameters."""
        start = np.zeros(self.arm.n_u) if pressure_pa is None else np.array(pressure_pa, dtype=np.float64)
        start = np.clip(start, self.minimum_pa, self.maximum_pa)
        return ControllerState(
            estimate=self.parameters.nominal.copy(),
            setpoint_pa=start,
            model_pa=start,
            wish_pa=start,
            internal=np.zeros(self.arm.n_internal),
        )

    def step(
        self,
        state: ControllerState,
        q: Array,
        qd: Array,
        t: float,
        dt: float,
        measured_pressure_pa: Array,
        reference: Reference | None = None,
    ) -> tuple[ControllerState, Command]:
        """Return the command for the state (q, qd) at time `t`.

        Parameters
        ----------
        q, qd : ndarray (n_q,)
            Estimated state.
        t, dt : float
            Time and time since the last tick [s].
        measured_pressure_pa : ndarray (n_u,)
            For the applied force [Pa gauge].
        reference : Reference or None
            From `trajectory` or `tip`; None for the configured one. A new one is approached smoothly.

        Notes
        -----
        Nothing is raised for bad input: the last set point is held and the status says why.
        """
        trouble = self._trouble(q, qd, t, dt)
        if trouble:
            return state, self._held(state, trouble)
        measured = np.asarray(measured_pressure_pa, dtype=np.float64)
        if measured.shape != (self.arm.n_u,) or not np.all(np.isfinite(measured)):
            measured = state.model_pa
        state = self._follow(state, q, t, reference)
        assert state.active is not None
        point = state.active.sample(t)
        # A set point of now acts later: the law speaks of then, with the state carried on as it moves.
        ahead = self.config.pressures.preview_s
        future, moved = state.active.sample(t + ahead), self._within(q + ahead * qd)
        internal = np.asarray(self.arm.internal_force(moved, state.internal))
        desired = self.config.compensation == "reference"
        terms = law(self.parameters, self.gains, state.estimate, internal, moved, qd, future, desired)
        actuation = self.arm.actuation_matrix(future.q if desired else moved)
        believed = actuation * self.parameters.gains(state.estimate)
        pressures = self.config.pressures
        wish = allocate(
            believed,
            terms.wished,
            self.minimum_pa,
            self.maximum_pa,
            self.force_weight[:, None] * balanced_weight(believed, self.fields),
            pressures.regularisation,
            self.preferred_pa,
            state.wish_pa,
        )
        # The limiter behind would cut a faster change as well; cut here, the lag model knows of it.
        command = compensate(
            wish.pressure_pa,
            state.model_pa,
            pressures.lag_s,
            pressures.lag_filter_s,
            np.maximum(self.minimum_pa, state.setpoint_pa - pressures.fall_pa_s * dt),
            np.minimum(self.maximum_pa, state.setpoint_pa + pressures.rise_pa_s * dt),
        )
        if not (wish.ok and np.all(np.isfinite(command))):
            return state, self._held(state, "no finite pressures for the wished force")
        estimate = state.estimate
        if self.config.adapt:
            # What the chambers really did is what errors of their gains multiply.
            regressor = terms.regressor + self.parameters.gain_regressor(actuation, measured)
            shortfall = terms.wished - wish.force if bool(wish.saturated.any()) else None
            adaptation = self.config.adaptation
            estimate = adapt(
                self.parameters,
                estimate,
                regressor,
                terms.s,
                dt,
                self.dead_zone,
                adaptation.leakage_per_s,
                shortfall if adaptation.hold_saturated else None,
            )
        following = replace(
            state,
            estimate=estimate,
            setpoint_pa=command,
            model_pa=advance(state.model_pa, command, pressures.lag_s, dt),
            wish_pa=wish.pressure_pa,
            internal=self._creep(state.internal, future.q, future.qd, dt),
            point=point,
        )
        edge = 1e-9 * (self.maximum_pa - self.minimum_pa)
        at_bound = (command <= self.minimum_pa + edge) | (command >= self.maximum_pa - edge)
        return following, Command(
            setpoint_pa=command,
            wished_force=terms.wished,
            applied_force=np.asarray(believed @ measured),
            estimates=self._named(estimate),
            reference=point,
            tip_reference=self.arm.pose(point.q, self.robot.length),
            saturated=wish.saturated | at_bound,
            terms=terms,
            status=ControllerStatus(True, ""),
        )

    def trajectory(
        self,
        t: float,
        names: Sequence[str],
        times_s: Sequence[float],
        positions: Array | Sequence[Sequence[float]],
        velocities: Array | Sequence[Sequence[float]] | None = None,
        accelerations: Array | Sequence[Sequence[float]] | None = None,
    ) -> Reference:
        """Return a reference from the fields of a JointTrajectory that starts at `t`.

        Raises
        ------
        ConfigError
            If names, times or numbers are wrong, or a position is beyond `limit`.
        """
        known = self.robot.coordinate_names
        return Waypoints(
            known,
            names,
            times_s,
            positions,
            velocities,
            accelerations,
            start_s=t,
            limit=lambda q: check_limits(self.fields, known, self.limit, q),
        )

    def tip(self, state: ControllerState, position: Array, quaternion: Array | None = None) -> Reference:
        """Return a set point that brings the tip to a position (and orientation, as far as its weight says).

        Raises
        ------
        ConfigError
            If a number is not finite or the arm cannot come within the configured tolerance.
        """
        start = np.zeros(self.arm.n_q) if state.point is None else state.point.q
        return tip_reference(
            self.arm, self.fields, self.config.reference, self.limit, start, position, quaternion
        )

    def _trouble(self, q: Array, qd: Array, t: float, dt: float) -> str:
        n = self.arm.n_q
        if np.shape(q) != (n,) or np.shape(qd) != (n,):
            return f"state of shape {np.shape(q)}, {np.shape(qd)} instead of ({n},)"
        if not (np.all(np.isfinite(q)) and np.all(np.isfinite(qd))):
            return "state is not finite"
        if not (math.isfinite(t) and math.isfinite(dt) and dt > 0.0):
            return f"time {t} s with step {dt} s"
        return ""

    def _follow(
        self, state: ControllerState, q: Array, t: float, reference: Reference | None
    ) -> ControllerState:
        """Start, and change references, through a smooth passage from where the reference is."""
        if state.active is not None and reference is state.source:
            return state
        configured, duration = state.configured, self.config.reference.start_s
        if configured is None:
            configured = configured_reference(self.arm, self.fields, self.config, np.array(q), t)
        wanted = configured if reference is None else reference
        leaving = Hold(np.array(q)) if state.point is None else Stop(t, duration, state.point)
        return replace(
            state, source=reference, configured=configured, active=Blend(leaving, wanted, t, duration)
        )

    def _within(self, q: Array) -> Array:
        return self.fields.within(q, self.limit)

    def _creep(self, internal: Array, q: Array, qd: Array, dt: float) -> Array:
        """Advance creep and hysteresis along the given motion (midpoint rule)."""
        if internal.size == 0:
            return internal
        half = internal + 0.5 * dt * self.arm.internal_rate(q, qd, internal)
        new = internal + dt * self.arm.internal_rate(q, qd, half)
        return np.where(np.isfinite(new), new, internal)

    def _held(self, state: ControllerState, trouble: str) -> Command:
        n = self.arm.n_q
        point = state.point if state.point is not None else Hold(np.zeros(n)).sample(0.0)
        return Command(
            setpoint_pa=state.setpoint_pa,
            wished_force=np.zeros(n),
            applied_force=np.zeros(n),
            estimates=self._named(state.estimate),
            reference=point,
            tip_reference=self.arm.pose(point.q, self.robot.length),
            saturated=np.zeros(self.arm.n_u, dtype=bool),
            terms=None,
            status=ControllerStatus(False, trouble),
        )

    def _named(self, estimate: Array) -> dict[str, float]:
        return {name: float(value) for name, value in zip(self.parameters.names, estimate, strict=True)}
