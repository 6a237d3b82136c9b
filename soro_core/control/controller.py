"""The controller: reference, law, allocation and the regulators' lag, once a tick."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from soro_core.adaptation.modes import least_stiffness
from soro_core.adaptation.regulators import RegulatorObserver
from soro_core.arrays import Array, all_finite
from soro_core.control.bumpless import apply_transfer
from soro_core.control.command import Command, ControllerState, ControllerStatus, held_command
from soro_core.control.config import ControllerConfig, require_chambers
from soro_core.control.control_monitor import ControlMonitorState, input_error, update_monitor
from soro_core.control.external_references import GivenReferences
from soro_core.control.force.force_loop import ForceLoop
from soro_core.control.gains import gains_of
from soro_core.control.laws.call import call_law, try_law
from soro_core.control.laws.guard import refused
from soro_core.control.laws.limit_cycle import AskedForce, no_limit_cycle, scaled_feedback, watch_of
from soro_core.control.laws.protocol import ArmBelief, Certainty, Made, MeasuredJoint, Preview, Setting
from soro_core.control.laws.registry import find_law, options_of
from soro_core.control.motions.references import bounds_of, check_configured, configured_reference
from soro_core.control.nonuniform_strain import nonuniform_of
from soro_core.control.pressures.actuation import (
    DEFAULT_RATE_HZ,
    CompletePressures,
    complete_pressures,
    with_own_range,
)
from soro_core.control.pressures.setpoints import SetpointMaker
from soro_core.control.probing.plan import ProbedArm
from soro_core.control.probing.procedure import Probe, ProbeSample, ProbeState
from soro_core.control.probing.stamps import StampedPosition
from soro_core.control.reference.active_reference import follow, reference_ahead
from soro_core.control.reference.trajectory import Point, Reference
from soro_core.control.reference.underactuation import UnderactuatedReference, UnderactuatedState
from soro_core.control.trial import refuse_lost_arm
from soro_core.errors import ConfigError, SoroError
from soro_core.frozen import replaced
from soro_core.model.discretised import discretised
from soro_core.planning.obstacles import obstacles_of
from soro_core.robot import Discretisation, Robot
from soro_core.robot.coordinates import strain_fields


class Controller(GivenReferences):
    """Controller of one robot: a law of the registry, with allocation and references around it.

    Parameters
    ----------
    robot : Robot
        The robot of the robot file.
    config : ControllerConfig, optional
        Parameters.
    model : Discretisation
        Discretisation of the robot; the attributes `arm` and `robot` are the discretised ones.
    pressures : CompletePressures, optional
        The section of that name with what limits and regulators add; default: the range of the robot, and
        as `soro_core.control.pressures.actuation.complete_pressures` has it without them.

    Raises
    ------
    ConfigError
        If the configuration does not fit the robot.
    """

    @refused()
    def __init__(
        self,
        robot: Robot,
        config: ControllerConfig | None = None,
        model: Discretisation = Discretisation(),  # noqa: B008 -- frozen
        pressures: CompletePressures | None = None,
    ) -> None:
        self.config = config = config or ControllerConfig()
        self.pressures = pressures or complete_pressures(with_own_range(config.pressures, robot))
        require_chambers(robot, "controller")
        self.arm = discretised(robot, model)
        robot = self.robot = self.arm.robot
        self.fields, self._chamber_names = strain_fields(robot), robot.chamber_names
        law = find_law(self.config.law)
        self.gains = gains_of(
            self.arm,
            self.fields,
            self.config.gains,
            model.links,
            self.pressures.preview_s,
            law.feedback_factors,
        )
        self.setpoints = SetpointMaker(robot, self.fields, self.pressures)
        self.minimum_pa, self.maximum_pa = self.setpoints.minimum_pa, self.setpoints.maximum_pa
        self.bounds = bounds_of(self.fields, self.config.reference, model.links)
        self.configured = configured_reference(self.arm, self.bounds, config, self.pressures)
        check_configured(self.bounds, self.configured)
        self.limit = self.bounds.strain
        self.underactuated = UnderactuatedReference(self.arm, self.fields, self.limit, model.links)
        self.law = law(
            Setting(
                self.arm,
                self.fields,
                self.gains,
                self.config,
                self.pressures,
                self.configured,
                self.limit,
                model.links,
            ),
            options_of(self.config.law, self.config.law_options),
        )
        known, self.limit_cycles = self.pressures, watch_of(self.law)
        self._nothing = np.zeros(self.arm.n_u)
        self.force_loop = ForceLoop(self.arm, self.fields, self.gains.k_p, self.limit, config.force)
        self.observer = RegulatorObserver(known.lag_s, known.dead_time_s, known.play_pa)
        self.obstacles = obstacles_of(self.arm, self.arm.robot.contacts)
        self.nonuniform = None if self.obstacles is None else nonuniform_of(self.arm, model.links)
        self.check_way(self.law.initial_state(), np.zeros(self.arm.n_q))
        self.probe: Probe | None = None
        begin, still, dt = self.initial_state(), np.zeros(self.arm.n_q), 1.0 / DEFAULT_RATE_HZ
        tick = partial(self._tick, begin, still, still, 0.0, dt, self._nothing, None, None)
        try_law(self.law, tick, still)
        refuse_lost_arm(self.law, begin, self.step)
        if (how := config.probe_at_enable) in ("refuse", "warn"):
            heaviest_kg = self.law.heaviest_kg()
            probed = ProbedArm(self.arm, self.fields, self.limit, known, heaviest_kg, config.enable)
            self.probe = Probe(probed, how == "warn")

    def initial_state(self, pressure_pa: Array | None = None) -> ControllerState:
        """Return the state before the first tick, at pressures (n_u,) [Pa gauge], 0 by default."""
        start = np.zeros(self.arm.n_u) if pressure_pa is None else np.array(pressure_pa, dtype=np.float64)
        start = np.clip(start, self.minimum_pa, self.maximum_pa)
        return ControllerState(
            law=self.law.initial_state(),
            setpoint_pa=start,
            model_pa=start,
            wish_pa=start,
            creep=np.zeros(self.arm.n_internal),
            shape=self.underactuated.initial_state(),
            saturated=np.zeros(self.arm.n_u, dtype=bool),
            regulators=self.observer.initial_state(start) if self.law.observes_regulators else None,
            probe=None if self.probe is None else self.probe.initial_state(),
            limit_cycle=no_limit_cycle(self.arm.n_q),
            force=self.force_loop.initial_state(),
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
        certainty: Certainty | None = None,
        between: Callable[[], None] = lambda: None,
        seen: Sequence[StampedPosition] = (),
        joint: MeasuredJoint | None = None,
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
            From `trajectory` or `tip`; None for the configured one. A transition leads to a new one.
        certainty : Certainty or None
            What the filter says of (q, qd); None where it has none, or has lost the arm: nothing is learned
            from the prediction error then.
        between : callable
            Called again and again at the end of the probe, with all set points at 0: it takes longer than a
            tick.
        seen : sequence of StampedPosition
            What sensors have seen since the last tick: the probe judges the stamps.
        joint : MeasuredJoint or None
            That of `config.joint`.

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
        failure = input_error(q, qd, t, dt, self.arm.n_q)
        if failure:
            state = replace(state, watch=replace(state.watch, refused=state.watch.refused + 1))
        elif self.probe is not None and state.probe is not None:
            sample = ProbeSample(t, q, qd, np.asarray(measured_pressure_pa, dtype=np.float64), tuple(seen))
            return self._probed(self.probe.step(state.probe, sample, between), state)
        else:
            try:
                return self._tick(state, q, qd, t, dt, measured_pressure_pa, reference, certainty, joint)
            except (SoroError, np.linalg.LinAlgError) as error:
                failure = f"no command: {error}"
        return self._held(state, failure)

    def _tick(
        self,
        state: ControllerState,
        q: Array,
        qd: Array,
        t: float,
        dt: float,
        measured_pressure_pa: Array,
        reference: Reference | None,
        certainty: Certainty | None,
        joint: MeasuredJoint | None = None,
    ) -> tuple[ControllerState, Command]:
        measured = np.asarray(measured_pressure_pa, dtype=np.float64)
        is_measured = measured.shape == (self.arm.n_u,) and all_finite(measured)
        if not is_measured:
            measured = state.model_pa
            state = replace(state, watch=replace(state.watch, refused=state.watch.refused + 1))
        start_s, before = self.config.reference.start_s, state.following
        if state.watch.fallen:
            return self._vented(state, dt)
        if reference is None:
            try:
                reference = self.configured_press(state, t)
            except ConfigError as error:  # the arm stays on its reference
                state = replace(state, force=replace(state.force, refusal=str(error)))
        elongation = state.elongation
        if state.watch.saturated or elongation is not None:
            elongation, before = self.rechosen_circle(state, t, dt)
        following = follow(self.bounds, start_s, self.configured, before, q, t, dt, reference)
        # A set point acts after lag and dead time: the law uses the reference and the state at that time.
        preview_s = self.pressures.preview_s
        point = reference_ahead(self.bounds, following, 0.0)
        external = None if certainty is None else certainty.external
        force = self.force_loop.step(state.force, following, point, (q, qd, measured), external, dt)

        def later(time_s: float) -> Point:
            return self.force_loop.moved_point(force, reference_ahead(self.bounds, following, time_s), time_s)

        point, future = self.force_loop.moved_point(force, point, 0.0), later(preview_s)
        try:
            shape, ahead = state.shape, Preview(point, future, preview_s, later=later)
            # A law that learns from the tracking error needs that of all coordinates.
            if self.underactuated.exist and self.law.learns:
                shape, ahead = self._with_underactuated(state, ahead)
        except np.linalg.LinAlgError:
            return self._held(state, "the shape that no chamber moves has no balance")
        belief = ArmBelief(
            q=q,
            qd=qd,
            covariance=None if certainty is None else certainty.covariance,
            positions=certainty is not None and certainty.positions,
            creep=state.creep,
            pressure_pa=measured,
            saturated=state.saturated,
            external=self.force_loop.told(force),
            joint=joint,
            is_measured=is_measured,
        )
        part, regulators = state.limit_cycle.part, state.regulators
        if regulators is not None:
            regulators = self.observer.observe(regulators, measured, dt, min(part, 1.0))
        inner, desired, terms = call_law(self.law, self.config.law, state.law, belief, ahead, dt)
        if part != 1.0:
            terms, desired = scaled_feedback(terms, desired, part)
        transfer, desired = apply_transfer(state.transfer, desired, dt)
        desired = desired + self.force_loop.push(force, ahead.ahead.q)
        place = self.law.place(belief, ahead)
        actuation = self.arm.actuation_matrix(place)
        believed = self.law.actuation(inner, actuation, place)
        wish = self.setpoints.allocate(believed, desired, state.wish_pa)
        bias = self._nothing if regulators is None else regulators.bias_pa + regulators.play_pa
        made = self.setpoints.make(wish, state.model_pa, state.setpoint_pa, bias, dt)
        if not made.ok:
            return self._held(state, f"no finite pressures for the force that law {self.config.law} asks for")
        saturated, acting = any(wish.saturated.tolist()), self.arm.acting_pressure(measured)
        inner = self.law.allocated(inner, Made(desired, wish.force, actuation, acting, saturated), dt)
        missing = self.setpoints.missing_pa(believed, desired, wish) if saturated else self._nothing
        alone = partial(self._stiffness, inner, state.creep, q, acting)
        asked = AskedForce(terms, believed @ bias, missing, alone)
        force = self.force_loop.relieved(force, missing, dt)
        limit_cycle = self.limit_cycles.step(state.limit_cycle, asked, point.q, belief, dt)
        tip_reference = self.arm.pose(point.q, self.arm.length)
        after = replaced(
            state,
            law=inner,
            watch=self._judged(state, q, tip_reference, missing, self.law.note(inner), dt),
            setpoint_pa=made.command_pa,
            model_pa=made.model_pa,
            wish_pa=wish.pressure_pa,
            creep=self.arm.internal_midpoint(q, qd, state.creep, dt),
            saturated=made.at_bound,
            regulators=regulators and self.observer.commanded(regulators, made.command_pa),
            following=following,
            transfer=transfer,
            shape=shape,
            point=point,
            limit_cycle=limit_cycle,
            force=force,
            elongation=elongation,
        )
        changed = "" if elongation is None else elongation.note(following)
        told = after.watch.note, limit_cycle.note, self.force_loop.note(force), changed, state.probed
        notes = filter(None, told)
        return after, Command(
            setpoint_pa=made.command_pa,
            desired_force=desired,
            applied_force=np.asarray(believed @ acting),
            named=partial(self.law.estimates, inner),
            deviations=partial(self.law.deviations, inner),
            learned=self.law.learned(inner),
            reference=point,
            tip_reference=tip_reference,
            saturated=made.at_bound,
            terms=terms,
            status=ControllerStatus(True, "", "; ".join(notes)),
            configured_tip=None if elongation is None else self.configured_tip(elongation, following, t),
        )

    def _probed(self, probe: ProbeState, state: ControllerState) -> tuple[ControllerState, Command]:
        """Return what follows from a tick of the probe; one that has refused vents for good."""
        over, law = probe.done and not probe.refusal, state.law
        if over and probe.gains is not None:
            law = self.law.with_gains(law, *probe.gains)
        after = None if over else probe
        state = replace(state, law=law, probe=after, probed=probe.said, setpoint_pa=probe.setpoint_pa)
        note = probe.said if probe.done else "probing the chambers before the law begins"
        return state, replace(self._held(state, "")[1], status=ControllerStatus(True, "", note))

    def _with_underactuated(
        self, state: ControllerState, given: Preview
    ) -> tuple[UnderactuatedState, Preview]:
        """Return the reference with the shape of what no chamber moves."""
        now, future = given.now, given.ahead

        def force(q: Array) -> Array:
            known = self.law.reference_force(state.law, q, future.qd, future.qdd)
            return np.asarray(known + self.arm.internal_force(q, state.creep))

        def actuation(q: Array) -> Array:
            return self.law.actuation(state.law, self.arm.actuation_matrix(q), q)

        shape, ahead, motions = self.underactuated.step(state.shape, future, force, actuation)
        # The shape changes little until a set point acts.
        q, qd, qdd = ahead.q - future.q, ahead.qd - future.qd, ahead.qdd - future.qdd

        def shaped(point: Point) -> Point:
            return Point(point.q + q, point.qd + qd, point.qdd + qdd)

        return shape, Preview(
            shaped(now), ahead, given.ahead_s, motions, lambda time_s: shaped(given.at(time_s))
        )

    def _stiffness(self, law: object, creep: Array, q: Array, acting_pa: Array) -> float:
        """Return the least stiffness of the learned arm with its gains, at constant pressures."""
        still = np.zeros(self.arm.n_q)

        def force(q: Array) -> Array:
            known = self.law.reference_force(law, q, still, still) + self.arm.internal_force(q, creep)
            return np.asarray(known - self.law.actuation(law, self.arm.actuation_matrix(q), q) @ acting_pa)

        return least_stiffness(self.arm, force, q, self.gains.k_p)

    def _judged(
        self, state: ControllerState, q: Array, wanted: Array, missing: Array, event: str, dt: float
    ) -> ControlMonitorState:
        """Return the watch after a tick; `wanted` is the pose (4, 4) of the tip at the reference."""
        away = 0.0
        if self.law.learns:  # the lost arm of another law is the verdict's
            away = math.dist(self.arm.pose(q, self.arm.length)[:3, 3], wanted[:3, 3]) / self.arm.length
        start_s = self.config.reference.start_s
        return update_monitor(state.watch, away, missing, self._chamber_names, event, start_s, dt)

    def _vented(self, state: ControllerState, dt: float) -> tuple[ControllerState, Command]:
        """Vent an arm that has fallen over."""
        least = np.maximum(self.minimum_pa, state.setpoint_pa - self.pressures.fall_pa_s * dt)
        state = replace(state, setpoint_pa=least)
        command = self._held(state, "")[1]
        return state, replace(command, status=ControllerStatus(True, "", state.watch.note))

    def _held(self, state: ControllerState, failure: str) -> tuple[ControllerState, Command]:
        """Hold the last set points and say why."""
        named, learned = partial(self.law.estimates, state.law), self.law.learned(state.law)
        return state, held_command(self.arm, state, named, learned, failure)
