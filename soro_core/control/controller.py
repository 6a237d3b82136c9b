"""The controller: reference, adaptive law, allocation and the regulators' lag, once a tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.config import changed
from soro_core.control.actuation import complete_pressures, pressure_bounds
from soro_core.control.adaptive import adapt, law
from soro_core.control.allocation import allocate, balanced_weight
from soro_core.control.command import Command, ControllerState, ControllerStatus, held_command, input_error
from soro_core.control.config import ControllerConfig, require_chambers
from soro_core.control.creep import advance_creep
from soro_core.control.demand import supply_of
from soro_core.control.following import follow, reference_ahead
from soro_core.control.lag import compensate
from soro_core.control.motion import Planner
from soro_core.control.parameters import ParameterSet
from soro_core.control.references import (
    bounds_of,
    check_configured,
    configured_reference,
    tip_reference,
    trajectory_reference,
)
from soro_core.control.spread import feedback_gains, per_coordinate
from soro_core.control.trajectory import Reference
from soro_core.errors import SoroError
from soro_core.model.discretised import discretised
from soro_core.pneumatics.lag import follow as follow_lag
from soro_core.robot import Discretisation, Robot
from soro_core.robot.coordinates import strain_fields

Array: TypeAlias = NDArray[np.float64]


class Controller:
    """Passivity-based adaptive controller of one robot.

    Parameters
    ----------
    robot : Robot
        The robot of the robot file.
    config : ControllerConfig, optional
        Parameters; keys of limits and regulators that it leaves out get defaults, see
        `soro_core.control.actuation.complete_pressures`.
    model : Discretisation
        Discretisation of the robot; the attributes `arm` and `robot` are the discretised ones.

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
        config = config if config is not None else ControllerConfig()
        self.pressures = complete_pressures(config.pressures)
        self.config = changed(config, pressures=self.pressures)
        require_chambers(robot, "controller")
        self.arm = discretised(robot, model)
        robot = self.robot = self.arm.robot
        self.parameters = ParameterSet(self.arm, self.config.adaptation)
        pressures = self.pressures
        self.fields = strain_fields(robot)
        self.gains = feedback_gains(self.fields, self.config.gains, model.links)
        self.force_weight, _ = per_coordinate(self.fields, pressures.force_weight, "pressures.force_weight")
        low, high = pressure_bounds(pressures, robot)
        self.minimum_pa, self.maximum_pa = np.full(self.arm.n_u, low), np.full(self.arm.n_u, high)
        self.preferred_pa = np.full(self.arm.n_u, min(max(pressures.preferred_pa, low), high))
        adaptation = self.config.adaptation
        # For a strain with several coefficients, the dead zone is that of the root mean square along the
        # link.
        self.dead_zone = np.where(
            self.fields.stretch, adaptation.dead_zone_stretch_per_s, adaptation.dead_zone_curvature_per_m_s
        ) / np.sqrt(np.diag(self.fields.weight))
        self.configured = configured_reference(self.arm, self.fields, self.config)
        self.bounds = bounds_of(self.fields, self.config.reference, model.links)
        check_configured(self.bounds, self.configured)
        self.limit = self.bounds.strain

    def initial_state(self, pressure_pa: Array | None = None) -> ControllerState:
        """Return the state before the first tick, at pressures (n_u,) [Pa gauge], 0 by default."""
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
        state : ControllerState
            State after the last tick.
        q, qd : ndarray (n_q,)
            Estimated coordinates and rates.
        t, dt : float
            Time and time since the last tick [s].
        measured_pressure_pa : ndarray (n_u,)
            Measured pressures [Pa gauge], for the applied force.
        reference : Reference or None
            From `trajectory` or `tip`; None for the configured one. A passage leads to a new one.

        Returns
        -------
        state : ControllerState
            State after this tick.
        command : Command
            Set points and diagnostics.

        Notes
        -----
        Bad input, and coordinates for which the model has no value, raise nothing: the last set point is held
        and the status says why.
        """
        trouble = input_error(q, qd, t, dt, self.arm.n_q)
        if not trouble:
            try:
                return self._tick(state, q, qd, t, dt, measured_pressure_pa, reference)
            except (SoroError, np.linalg.LinAlgError) as error:
                trouble = f"no command: {error}"
        return state, held_command(self.arm, state, self.parameters.named(state.estimate), trouble)

    def _tick(
        self,
        state: ControllerState,
        q: Array,
        qd: Array,
        t: float,
        dt: float,
        measured_pressure_pa: Array,
        reference: Reference | None,
    ) -> tuple[ControllerState, Command]:
        measured = np.asarray(measured_pressure_pa, dtype=np.float64)
        if measured.shape != (self.arm.n_u,) or not np.all(np.isfinite(measured)):
            measured = state.model_pa
        start_s, before = self.config.reference.start_s, state.following
        following = follow(self.bounds, start_s, self.configured, before, q, t, dt, reference)
        # A set point acts after lag and dead time: the law uses the reference and the state at that time.
        preview_s = self.pressures.preview_s
        point, future = (reference_ahead(self.bounds, following, time_s) for time_s in (0.0, preview_s))
        moved = self.fields.within(q + preview_s * qd, self.limit)
        internal = np.asarray(self.arm.internal_force(moved, state.internal))
        desired = self.config.compensation == "reference"
        terms = law(self.parameters, self.gains, state.estimate, internal, moved, qd, future, desired)
        actuation = self.arm.actuation_matrix(future.q if desired else moved)
        believed = actuation * self.parameters.gains(state.estimate)
        pressures = self.pressures
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
        # The limiter would clip a faster change as well; clipped here, the lag model includes it.
        command = compensate(
            wish.pressure_pa,
            state.model_pa,
            pressures.lag_s,
            pressures.lag_filter_s,
            np.maximum(self.minimum_pa, state.setpoint_pa - pressures.fall_pa_s * dt),
            np.minimum(self.maximum_pa, state.setpoint_pa + pressures.rise_pa_s * dt),
        )
        if not (wish.ok and np.all(np.isfinite(command))):
            trouble = "no finite pressures for the wished force"
            return state, held_command(self.arm, state, self.parameters.named(state.estimate), trouble)
        estimate = state.estimate
        if self.config.adapt:
            # Errors of the chamber gains multiply the measured pressures, not the commanded ones.
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
        after = replace(
            state,
            estimate=estimate,
            setpoint_pa=command,
            model_pa=follow_lag(state.model_pa, command, dt, pressures.lag_s),
            wish_pa=wish.pressure_pa,
            internal=advance_creep(self.arm, state.internal, future.q, future.qd, dt),
            following=following,
            point=point,
        )
        edge = 1e-9 * (self.maximum_pa - self.minimum_pa)
        at_bound = (command <= self.minimum_pa + edge) | (command >= self.maximum_pa - edge)
        return after, Command(
            setpoint_pa=command,
            wished_force=terms.wished,
            applied_force=np.asarray(believed @ measured),
            estimates=self.parameters.named(estimate),
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
        stamp_ns: int = 0,
    ) -> Reference:
        """Return a reference from a JointTrajectory that starts at `t` [s].

        Other parameters as in `trajectory_reference`.

        Returns
        -------
        Reference

        Raises
        ------
        ConfigError
            If names, times or numbers are wrong, or a strain or a rate is beyond `bounds`.
        """
        return trajectory_reference(
            self.bounds,
            self.robot.coordinate_names,
            names,
            times_s,
            positions,
            velocities,
            accelerations,
            start_s=t,
            stamp_ns=stamp_ns,
        )

    def planner(self, state: ControllerState, dt: float) -> Planner:
        """Return what plans motions along paths with the estimates of now; `dt` [s] of the loop."""
        return Planner(supply_of(self, state), self.bounds, self.config, dt)

    def tip(self, state: ControllerState, position: Array, quaternion: Array | None = None) -> Reference:
        """Return a set point that brings the tip to a pose.

        Parameters
        ----------
        state : ControllerState
            The search starts at its reference.
        position : ndarray (3,)
            Position of the tip in the world frame [m].
        quaternion : ndarray (4,), optional
            Orientation (x, y, z, w), weighted with `reference.rotation_weight_m`.

        Returns
        -------
        Reference

        Raises
        ------
        ConfigError
            If a number is not finite, or the arm misses the position by more than the configured tolerance.
        """
        # From the reference in force, so that neighbouring poses get neighbouring coordinates.
        start = np.zeros(self.arm.n_q) if state.following is None else state.following.passage.at.q
        return tip_reference(
            self.arm, self.fields, self.config.reference, self.limit, start, position, quaternion
        )
