"""The external force from tick to tick: samples behind a low-pass, balance, covariance and stage."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.adaptation.config import mass_prior
from soro_core.adaptation.external_force import ExternalForce
from soro_core.adaptation.force import LearnedForce
from soro_core.adaptation.learned import Learned
from soro_core.arrays import Array
from soro_core.errors import ConfigError, ModelError
from soro_core.estimation.force.average import (
    ALONG_LOAD,
    Average,
    Axes,
    NoisyForce,
    averaged,
    axes_of,
    covariance_of,
)
from soro_core.estimation.force.before import Before, Reading, kept, read
from soro_core.estimation.force.config import ForceConfig
from soro_core.estimation.force.hold import HeldPlace, hold
from soro_core.estimation.force.stage import ForceSeen, next_stage
from soro_core.estimation.force.state import ForceState, Seen
from soro_core.estimation.force.tip_balance import Measured, TipBalance, TipBalancer
from soro_core.estimation.learned_input import LearnedInput
from soro_core.model import SoftArm

# Pieces of an arm of few links; the time of a balance grows with the cube of their number.
_MOST_PIECES = 8
# Deviation of the common gain of an arm whose robot file states none or a larger one: by a doubt of a third
# of itself no force would be one.
_GAIN_STD = 0.03
# Time constants of the low-pass after which it tells a force from noise.
_BEGUN = 5.0
# Time after which a force is one where no law says what it has learned [s].
_ALONE_S = 2.0
# Time without a position of a place after which one further in is used [s].
_PLACE_S = 0.25
# Deviation of the force of inertia at the tip, as a part of it.
_INERTIA = 0.5
# Speed of the tip, in lengths of the arm a second, from which on it moves; behind a low-pass of a rate
# [rad/s].
_MOVES_PER_S, _STEADY_PER_S = 0.15, 2.0
# Largest force, in that whose work over the length of the arm is the energy of one unit of each strain:
# an arm that leans on something all along, or is bent to where its tip hardly moves, has balances under any.
_MOST_FORCE = 1e3
# Learned load, as a part of the arm's mass, below which it is none, but a stiffness: no load is below zero.
_LEAST_LOAD = -0.1
# Part of a new position in the mean of their scatter.
_SCATTER_PART = 0.05


@dataclass(frozen=True)
class Noise:
    """Deviations of what is measured: of a position [m] and of a pressure [Pa]."""

    position_m: float
    pressure_pa: float


class ForceObserver:
    """Estimates the external force on one arm.

    Parameters
    ----------
    arm : SoftArm
        Discretised model.
    config : ForceConfig
    links : int
        Number of pieces into which the model divides each link.
    noise : Noise

    Raises
    ------
    ConfigError, ModelError
        If the arm has no such balance, see `TipBalancer`.
    """

    def __init__(self, arm: SoftArm, config: ForceConfig, links: int, noise: Noise) -> None:
        self.arm, self.config, self.noise = arm, config, noise
        self._pieces = max(1, min(config.pieces, _MOST_PIECES // len(arm.robot.links)))
        self.balancer = TipBalancer(arm, links, self._pieces)
        self.force = LearnedForce(arm, links)
        self._nothing = np.zeros(self.force.size)
        self._mass_kg = sum(link.mass for link in arm.robot.links)
        measured = min(arm.robot.calibration.gain_std or _GAIN_STD, _GAIN_STD)
        self._gain_std = measured if config.gain_std is None else config.gain_std
        scales = self.force.scales
        self._most_n = _MOST_FORCE * float(scales.force @ scales.q) / arm.length

    def step(
        self, state: ForceState, seen: Sequence[Seen], s: float, known: LearnedInput, now_s: float
    ) -> ForceState:
        """Return the state with the estimate from new positions of one place.

        Parameters
        ----------
        state : ForceState
        seen : sequence of Seen
            In the order of their stamps, after the last ones.
        s : float
            The place, along the whole arm [m].
        known : LearnedInput
            What a law has learned.
        now_s : float
            Time of the tick [s].
        """
        state = state._replace(due_s=now_s + self.config.period_s)
        if not seen:
            return state
        if state.last is not None and s != state.place:  # a low-pass of two places would be of neither
            if s < state.place and seen[-1].stamp_s - state.last.stamp_s < _PLACE_S:
                return state
            state = state.begun_anew(state.due_s)
        state = state._replace(place=s)
        start_s = state.passed_s
        for one in seen:
            state = self._passed(state, one)
        measured, q, learned = state.measured, state.q, known.learned
        assert measured is not None
        assert q is not None
        dt, theta = state.passed_s - start_s, self._nothing
        if learned is not None:
            theta = known.share * (learned.theta if learned.own is None else learned.own)
        now, is_free = Before(0.0, theta, q), state.stage.stage == "free"
        if is_free:
            state = state._replace(past=kept(state.past, now, dt), reading=None)
        if is_free or not state.past:
            before, reading = now, Reading(float(theta[0]))
            if theta[0] < _LEAST_LOAD * self._mass_kg:
                reading = read(self.force, now, self.config.model_std_pa)
        else:
            # What is learned as a load since then may be the push.
            before = state.past[0]
            reading = state.reading or read(self.force, before, self.config.model_std_pa)
            state = state._replace(reading=reading)
        theta, modulus, bent = reading.theta_of(theta), reading.modulus, q - before.q
        losses = self.force.damping.force(Learned(theta).damping_s(self.arm.n_q), measured.qd)
        measured = measured._replace(force=measured.force + losses)
        balance = self.balancer.step(state.balance, measured, theta, s, seen[-1].q, modulus)
        tip = None if balance is None else self._tip(balance)
        if balance is None or tip is None:
            return state.begun_anew(state.due_s)
        noise = self._noise(balance, state)
        density = axes_of(state.interval_s * noise)
        state = state._replace(balance=balance)
        state = self._averaged(state, measured, density, float(theta[0]), seen[-1].q, dt)
        told = self._told(state, measured, (noise, density.weak), learned, float(theta[0]), bent)
        stage = next_stage(state.stage, told, dt) if self._may_tell(state, learned) else state.stage
        slow, covariance = told.slow
        if state.stage.stage != "free" and stage.stage == "free":
            # What is known since the touch is of the push; or it is a load, which is known now.
            state = state._replace(past=() if stage.mass_free else state.past[:1])
            state = state._replace(average=_emptied(state.average), of_any=_emptied(state.of_any))
        held = None
        if stage.stage != "free" and learned is not None and learned.doubt is not None:
            place = HeldPlace(measured.position, s, q, measured.pressure_pa, seen[-1].internal, slow)
            part = _part_of(self.config.low_pass_per_s, dt)
            # No coordinates may have the place there.
            with contextlib.suppress(ModelError, np.linalg.LinAlgError):
                held = hold(self.force, state.held, place, learned, part, dt)
        external = ExternalForce(slow, stage.doubt * covariance, stage.stage, stage.mass_free, tip)
        return state._replace(stage=stage, held=held, external=external)

    def _tip(self, balance: TipBalance) -> Array | None:
        """Return the tip of a balance; None where Newton's method left what an arm and a force can be."""
        if not float(np.linalg.norm(balance.force_n)) <= self._most_n:
            return None
        with contextlib.suppress(ModelError):
            return self.balancer.fine.pose(balance.x, self.balancer.fine.length)[:3, 3]
        return None

    def _averaged(
        self, state: ForceState, measured: Measured, density: Axes, mass_kg: float, q: Array, dt: float
    ) -> ForceState:
        """Return the state with the force of its new balance in both averages, and the motion of the tip."""
        assert state.balance is not None
        jacobian = self.arm.jacobian(q, state.place)[3:]
        acceleration = float(np.linalg.norm(jacobian @ measured.qdd))
        inertia = (self._inertia_kg(mass_kg) * acceleration) ** 2 / self.config.fast_per_s
        noisy, rate = NoisyForce(state.balance.force_n, density, inertia), self.config.low_pass_per_s
        speed = velocity = jacobian @ measured.qd
        if state.speed is not None:
            speed = state.speed + _part_of(_STEADY_PER_S, dt) * (velocity - state.speed)
        return state._replace(
            average=averaged(state.average, noisy, rate, dt),
            of_any=averaged(state.of_any, noisy, rate, dt, ALONG_LOAD),
            speed=speed,
            acceleration=acceleration,
        )

    def _told(
        self,
        state: ForceState,
        measured: Measured,
        by_noise: tuple[Array, Array],
        learned: Learned | None,
        mass_kg: float,
        bent: Array,
    ) -> ForceSeen:
        """Return what the balance and the averages of a state say of the force.

        `by_noise`: the covariance of the balance by noise, and its weak direction.
        """
        balance, average, of_any, speed = state.balance, state.average, state.of_any, state.speed
        assert balance is not None
        assert average is not None
        assert of_any is not None
        assert speed is not None
        (noise, weak), doubt = by_noise, self._doubt(balance, measured, learned, bent)
        return ForceSeen(
            (balance.force_n, self._part(state, self.config.fast_per_s) * noise + doubt),
            (average.force_n, covariance_of(average, weak) + doubt),
            (of_any.force_n, covariance_of(of_any, weak) + doubt),
            self.balancer.fine.tables.gravity,
            self.arm.robot.tip_mass + mass_kg,
            self._inertia_kg(mass_kg),
            state.acceleration,
            float(np.linalg.norm(speed)) > _MOVES_PER_S * self.arm.length,
        )

    def _inertia_kg(self, mass_kg: float) -> float:
        """Return the mass [kg] whose inertia is in doubt at the tip, with a learned load [kg]."""
        return float(_INERTIA * (0.5 * self._mass_kg + max(self.arm.robot.tip_mass + mass_kg, 0.0)))

    def _may_tell(self, state: ForceState, learned: Learned | None) -> bool:
        """Whether a force has a stage: before a law says how well it knows the arm it may be the load."""
        if learned is None:
            return state.passed_s > _ALONE_S
        return learned.doubt is not None and state.passed_s > _BEGUN / self.config.low_pass_per_s

    def _passed(self, state: ForceState, one: Seen) -> ForceState:
        """Return the state with one more position behind the low-pass."""
        before, arm = state.last, self.arm
        dt = one.stamp_s - before.stamp_s if before is not None else 0.0
        qdd = np.zeros(arm.n_q) if before is None else (one.qd - before.qd) / dt
        force = arm.damping_force(one.q, one.qd) + arm.internal_force(one.q, one.internal)
        new = Measured(one.position, one.pressure_pa, one.qd, qdd, force)
        passed_s = state.passed_s + dt
        q = one.q
        if state.measured is not None and state.q is not None and dt > 0.0:
            # At first a mean: the first position alone would count for the time of the low-pass.
            part = max(-math.expm1(-self.config.fast_per_s * dt), dt / (passed_s + dt))
            q = state.q + part * (one.q - state.q)
            new = Measured(*(old + part * (x - old) for old, x in zip(state.measured, new, strict=True)))
        interval_s = state.interval_s + 0.1 * (dt - state.interval_s) if state.interval_s else dt
        scatter, step = state.scatter, None
        if before is not None:
            step = (one.position - before.position) / dt
            if state.step is not None:
                # With even intervals the second difference of white noise has six times its variance.
                found = float(np.mean(np.square(dt * (step - state.step)))) / 6.0
                scatter += max(_SCATTER_PART, dt / passed_s) * (found - scatter)
        return state._replace(
            last=one, passed_s=passed_s, interval_s=interval_s, measured=new, q=q, scatter=scatter, step=step
        )

    def _part(self, state: ForceState, rate: float) -> float:
        """Return how much of the variance of one position a low-pass of this rate [rad/s] leaves."""
        dt = state.interval_s
        return max(0.5 * rate * dt, dt / (state.passed_s + dt)) if dt > 0.0 else 1.0

    def _noise(self, balance: TipBalance, state: ForceState) -> Array:
        """Return the covariance (3, 3) by the noise of one position and one set of pressures [N^2]."""
        position = max(self.noise.position_m, math.sqrt(state.scatter)) * balance.by_position
        pressure = self.noise.pressure_pa * balance.by_pressure
        return np.asarray(position @ position.T + pressure @ pressure.T)

    def _doubt(self, balance: TipBalance, measured: Measured, learned: Learned | None, bent: Array) -> Array:
        """Return the covariance (3, 3) by what is not known of the arm [N^2]; `bent`: q since a touch."""
        config, arm = self.config, self.arm
        single = config.model_std_pa * balance.by_pressure
        doubt = None if learned is None else learned.doubt
        by_strain = config.stiffness_std * self.force.scales.stiffness * self.force.scales.force
        # Free motion teaches the gains against the stiffness: an error of their scale is one of F alone.
        gain = balance.force_n
        if doubt is None or doubt.shape != (arm.n_q, arm.n_q):
            gain = balance.by_pressure @ arm.acting_pressure(measured.pressure_pa)
            bent = balance.x @ self.balancer.spread / self._pieces
            load = mass_prior(arm)[0] * arm.tip_mass_force(bent, measured.qd, measured.qdd)
            doubt = np.outer(load, load)
        doubt = doubt + np.diag((by_strain * bent) ** 2)
        found = (
            self._gain_std**2 * np.outer(gain, gain)
            + single @ single.T
            + balance.by_force @ doubt @ balance.by_force.T
        )
        return np.asarray(0.5 * (found + found.T))


def _part_of(rate: float, dt: float) -> float:
    """Return the part of the way of a low-pass of a rate [rad/s] in a time [s]."""
    return -math.expm1(-rate * dt)


def _emptied(average: Average | None) -> Average | None:
    """Return an average that begins at no force."""
    return None if average is None else average._replace(force_n=np.zeros(3))


def force_observer_of(arm: SoftArm, config: ForceConfig, links: int, noise: Noise) -> ForceObserver | None:
    """Return what estimates the force on an arm; None where it is switched off, or the arm has no balance.

    Parameters
    ----------
    arm : SoftArm
    config : ForceConfig
    links : int
        As in `ForceObserver`.
    noise : Noise
    """
    if not config.enabled:
        return None
    try:
        return ForceObserver(arm, config, links, noise)
    except (ConfigError, ModelError):
        return None
