"""One tick of the simulated robot: air, arm, sensors. Only the generators of its noise keep a state."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.errors import ModelError
from soro_core.estimation.sensors.samples import ImuSample, PoseSample
from soro_core.estimation.sensors.tracker import Tracker
from soro_core.frozen import replaced
from soro_core.integrate import OK, State, Status
from soro_core.model.checks import finite, shaped
from soro_core.pneumatics import regulator
from soro_core.pneumatics.valve_condition import ValveAction, ValveCondition
from soro_core.robot import Robot
from soro_core.twin.config import SensorConfig, TwinConfig
from soro_core.twin.followed_base import AT_REST, BaseWay
from soro_core.twin.plant import ArmPlant, Instant
from soro_core.twin.sensors import (
    Sample,
    SectionMotion,
    SensorClock,
    SensorState,
    measure_imu,
    measure_pose,
    sample,
)

# Shorter parts of a tick [s] are rounding of a dead time of whole ticks.
SHORTEST_S = 1e-9


@dataclass(frozen=True)
class TwinState:
    """State of arm, air and sensors.

    Attributes
    ----------
    tick : int
        Counts from 0.
    arm : State
        Coordinates, rates and internal states.
    air : RegulatorState
        Regulators and pressures [Pa gauge].
    poses, imus : tuple of SensorState
        Sensors of poses; IMUs: by place.
    status : Status
        Result of the last step.
    start_tick : int or None
        Tick from which the times of payload, wrench and wall count; None: they wait.
    push : ndarray (6,), optional
        Torque [N m] and force [N] at the tip in the world, beside those of the scene.
    base : BaseWay
        Where the base goes, if it follows poses.
    touched_n : ndarray (3,), optional
        Force of bodies on the arm, in the world [N].
    """

    tick: int
    arm: State
    air: regulator.RegulatorState
    poses: tuple[SensorState[PoseSample], ...]
    imus: tuple[SensorState[ImuSample], ...]
    status: Status
    start_tick: int | None = 0
    push: Array | None = None
    base: BaseWay = AT_REST
    touched_n: Array | None = None


@dataclass(frozen=True)
class Observation:
    """Measurements of one tick.

    Attributes
    ----------
    reading_pa : ndarray (n_u,)
        Measured chamber pressures [Pa gauge].
    poses, imus : tuple of samples
        Samples that reach their reader at this tick.
    tip : ndarray (4, 4)
        True pose of the tip.
    push_n, contact_n : ndarray (3,)
        True force of wrenches, and sum of those of contact, on the arm in the world [N].
    """

    reading_pa: Array
    poses: tuple[PoseSample, ...]
    imus: tuple[ImuSample, ...]
    tip: Array
    push_n: Array = field(default_factory=lambda: np.zeros(3))
    contact_n: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def force_n(self) -> Array:
        """All that pushes on the arm from outside, without its weight and load (3,), in the world [N]."""
        return self.push_n + self.contact_n


class Twin:
    """The simulated robot.

    Parameters
    ----------
    robot : Robot
        Robot as the controller knows it.
    config : TwinConfig, optional
        Parameters of the plant, the sensors and the noise; default: those of `TwinConfig()`.
    """

    def __init__(self, robot: Robot, config: TwinConfig | None = None) -> None:
        config = config or TwinConfig()
        self.plant = ArmPlant(robot, config)
        """The arm at the begin."""
        later = config.payload_changes.payload_kg
        self._plants = (
            self.plant,
            *(ArmPlant(robot, with_changes(config, payload_kg=mass)) for mass in later),
        )
        self.config = config
        self.dt = 1.0 / config.rate_hz
        self._length = self.plant.arm.length
        # A world of bodies moves the arm; the twin itself has its air and its sensors.
        self._is_held = bool(config.bodies_file)
        self._tracker = Tracker.of(self.plant.arm.robot)
        self._pose_clock = SensorClock.of(config.pose, config.rate_hz)
        self._imu_clock = SensorClock.of(config.imu, config.rate_hz)
        # A generator a source: a sensor that is switched off does not change what the others measure.
        air, pose, imu = np.random.SeedSequence(config.seed).spawn(3)
        self._air_rng = np.random.default_rng(air)
        self._pose_rngs = _generators(pose, len(config.pose.locations))
        self._imu_rngs = _generators(imu, len(config.imu.locations))

    @property
    def length(self) -> float:
        """Undeformed length of the arm [m]."""
        return self._length

    def since(self, state: TwinState) -> float:
        """Time after the begin of control [s], -inf before it."""
        return -math.inf if state.start_tick is None else (state.tick - state.start_tick) * self.dt

    def _plant(self, state: TwinState) -> ArmPlant:
        """The arm with the payload that it carries in a state."""
        plant = self._plants[self.config.payload_changes.passed(self.since(state))]
        plant.follow(state.base)
        return plant

    def initial(self, pressure_pa: Array | None = None) -> TwinState:
        """Return the state at tick 0: at rest under constant pressures (n_u,) [Pa], none by default."""
        pressure = np.zeros(self.plant.arm.n_u) if pressure_pa is None else pressure_pa
        arm = self.plant.rest(pressure)
        air = regulator.RegulatorState(pressure_pa=pressure, target_pa=pressure)
        poses = tuple(SensorState[PoseSample]() for _ in self.config.pose.locations)
        imus = tuple(SensorState[ImuSample]() for _ in self.config.imu.locations)
        return TwinState(0, arm, air, poses, imus, OK)

    def observe(self, state: TwinState) -> tuple[TwinState, Observation]:
        """Sample every sensor at the tick of `state`; to be called once a tick."""
        plant, config, t = self._plant(state), self.config, state.tick * self.dt
        tip = plant.pose(state.arm, self._length, t)

        def pose(at: float, rng: np.random.Generator) -> PoseSample:
            section = tip if at == self._length else plant.pose(state.arm, at, t)
            shown = section if self._tracker is None else self._tracker.seen(section, at)
            return measure_pose(config.pose, shown, t, at, rng)

        def imu(at: float, rng: np.random.Generator) -> ImuSample:
            gravity = np.array(plant.arm.robot.gravity)
            return measure_imu(config.imu, self._motion(state, at), gravity, t, at, rng)

        poses, seen_poses = self._sampled(
            config.pose, self._pose_clock, state.poses, state.tick, pose, self._pose_rngs
        )
        imus, seen_imus = self._sampled(
            config.imu, self._imu_clock, state.imus, state.tick, imu, self._imu_rngs
        )
        reading = regulator.reading(config.regulator, state.air, self._air_rng)
        since = self.since(state)
        push = config.wrench.at(since)[3:] + (0.0 if state.push is None else state.push[3:])
        contact = plant.contact_force(state.arm, t, since)
        if state.touched_n is not None:
            contact = contact + state.touched_n
        seen = Observation(reading, seen_poses, seen_imus, tip, push, contact)
        return replaced(state, poses=poses, imus=imus), seen

    def _sampled(
        self,
        config: SensorConfig,
        clock: SensorClock,
        states: tuple[SensorState[Sample], ...],
        tick: int,
        measure: Callable[[float, np.random.Generator], Sample],
        rngs: list[np.random.Generator],
    ) -> tuple[tuple[SensorState[Sample], ...], tuple[Sample, ...]]:
        """Advance the sensors of one kind by one tick; return their states and the samples that are due."""
        if not config.enabled:
            return states, ()
        after: list[SensorState[Sample]] = []
        due: list[Sample] = []
        for place, state, rng in zip(config.locations, states, rngs, strict=True):
            state, samples = sample(
                config, clock, state, tick, partial(measure, place * self._length, rng), rng
            )
            after.append(state)
            due += samples
        return tuple(after), tuple(due)

    def step_setpoints(self, state: TwinState, setpoint_pa: Array) -> TwinState:
        """Advance one tick with the twin's own regulators following set points (n_u,) [Pa gauge]."""
        if self.plant.has_air:
            air, spans = regulator.targets(self.config.regulator, state.air, setpoint_pa, self.dt)
            return self._breathe(state, air, spans)
        air = regulator.step(self.config.regulator, state.air, setpoint_pa, self.dt)
        return self._step(state, air)

    def step_valves(self, state: TwinState, action: ValveAction) -> TwinState:
        """Advance one tick with the action of valves in another process; the air is simulated here.

        Raises
        ------
        ModelError
            If the air in the chambers is no part of the state (`air: lag`).
        """
        air = replace(state.air, target_pa=action.spans[-1][1])
        return self._breathe(state, air, action.spans, action.condition)

    def at_pressures(self, state: TwinState, pressure_pa: Array) -> TwinState:
        """Return the state with other pressures (n_u,) [Pa gauge] in its chambers, the arm as it is."""
        air = regulator.RegulatorState(pressure_pa=pressure_pa, target_pa=pressure_pa)
        return replace(state, arm=self.plant.at_pressures(state.arm, pressure_pa), air=air)

    def at_wrench(
        self, state: TwinState, force_n: ArrayLike, torque_nm: ArrayLike = (0.0, 0.0, 0.0)
    ) -> TwinState:
        """Return the state with a push at the tip, in the world, that stays until another one.

        Parameters
        ----------
        state : TwinState
        force_n, torque_nm : array_like (3,)
            Force [N] and torque [N m].

        Raises
        ------
        ModelError
            If they are not three finite numbers each.
        """
        name = self.plant.arm.robot.name
        torque, force = shaped(torque_nm, (3,), "torque_nm", name), shaped(force_n, (3,), "force_n", name)
        push = finite(np.concatenate((torque, force)), "torque and force of a push")
        return replaced(state, push=push if push.any() else None)

    def at_base(self, state: TwinState, pose: ArrayLike) -> TwinState:
        """Return the state with a base on its way to another pose (4, 4) in the world.

        Raises
        ------
        ModelError
            If the base does not follow poses (`base_by_topic`), or this is none, or too far from the last.
        """
        arm = self.plant.arm
        there = shaped(pose, (4, 4), "pose", arm.robot.name)
        finite(there.ravel(), "pose of the base")
        if not self.config.base_by_topic:
            text = "a pose of the base with base_by_topic: false: allowed with true"
            raise ModelError(text, "base_by_topic")
        rotation = there[:3, :3] @ arm.tables.base_rotation.T
        if not np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-6:
            raise ModelError("a pose of the base without a rotation: allowed is a rigid one", "pose")
        way = state.base.towards(state.tick * self.dt, there[:3, 3] - arm.tables.base_position, rotation)
        return replaced(state, base=way)

    def step_pressures(self, state: TwinState, pressure_pa: Array) -> TwinState:
        """Advance one tick with true chamber pressures (n_u,) [Pa gauge] from elsewhere.

        Raises
        ------
        ModelError
            If the air in the chambers is a part of the state (`air: states`).
        """
        if self.plant.has_air:
            text = "pressures from elsewhere with air: states: allowed are set points, or air: lag"
            raise ModelError(text, "air")
        pressure = np.asarray(pressure_pa, dtype=np.float64)
        return self._step(state, regulator.RegulatorState(pressure_pa=pressure, target_pa=pressure))

    def _step(self, state: TwinState, air: regulator.RegulatorState) -> TwinState:
        if self._is_held:
            return replaced(state, tick=state.tick + 1, air=air)
        start_pa, end_pa = state.air.pressure_pa, air.pressure_pa
        at = Instant(state.tick * self.dt, self.since(state), state.push)
        arm, status = self._plant(state).advance(state.arm, start_pa, end_pa, self.dt, at=at)
        return replaced(state, tick=state.tick + 1, arm=arm, air=air, status=status)

    def _breathe(
        self,
        state: TwinState,
        air: regulator.RegulatorState,
        spans: Iterable[tuple[float, Array]],
        condition: ValveCondition | None = None,
    ) -> TwinState:
        """Advance arm and air together; the valves move towards the targets of their regulators."""
        arm, status, plant = state.arm, OK, self._plant(state)
        since = self.since(state)
        for span, target in spans:
            if status.ok and span > SHORTEST_S:
                at = Instant(since=since, push=state.push)
                arm, status = plant.advance(arm, target, target, span, condition, at)
                since += span
        air = replace(air, pressure_pa=self.plant.pressures(arm))
        return replaced(state, tick=state.tick + 1, arm=arm, air=air, status=status)

    def _motion(self, state: TwinState, s: float) -> SectionMotion:
        """Pose, twist and acceleration of the cross-section at `s`."""
        plant, since = self._plant(state), self.since(state)
        arm, q, qd = plant.arm, state.arm.q, state.arm.qd
        # Behind the states of creep and hysteresis there may be those of the air.
        internal = state.arm.internal[: arm.n_internal]
        plant.move_wall(since)
        wrench = plant.wrench(state.arm, state.tick * self.dt, since, state.push)
        qdd = arm.forward_dynamics(q, qd, state.air.pressure_pa, wrench, internal)
        jacobian = arm.jacobian(q, s)
        # d/dt (J qd) = J qdd + Jdot qd, the second by a central difference along qd.
        h = 1e-6
        drift = (arm.jacobian(q + h * qd, s) - arm.jacobian(q - h * qd, s)) @ qd / (2 * h)
        return SectionMotion(arm.pose(q, s), jacobian @ qd, jacobian @ qdd + drift)


def _generators(seed: np.random.SeedSequence, places: int) -> list[np.random.Generator]:
    """Return a generator for each place; that of the first one does not depend on their number."""
    return [np.random.default_rng(one) for one in (seed, *seed.spawn(places - 1))]
