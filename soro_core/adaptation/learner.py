"""A learner driven by the prediction error: recursive least squares on what the measured pressures make.

r = H(q) p - [M qdd + C qd + G + f_e + R qd + creep] = Y_m m + U W phi(q) + d(q, m)

Measured pressures say what force acts, so the lag of the regulators does not enter. Both sides pass one
low-pass. The information about theta grows with each sample, weighed by its noise S = sigma^2 I + B P B', B
the slope of elastic force and weight, P the covariance of q, and is forgotten towards the prior. What samples
do not determine stays at the prior.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs

from soro_core.adaptation.config import LearnerConfig, complete_learner, follow_rate
from soro_core.adaptation.force import LearnedForce
from soro_core.adaptation.learned import Learned
from soro_core.adaptation.uneven import UnevenForce

if TYPE_CHECKING:
    from soro_core.model import SoftArm

Array: TypeAlias = NDArray[np.float64]

# Information whose condition is worse than this is singular.
_SINGULAR = 1e14
# Part of a unit of q for the difference quotient of the force.
_STEP = 1e-6
# The filter first moves from its start to the arm, and the low-pass would keep that: it begins when the
# filter is sure, or after this time [s].
_WAIT_S = 0.5


@dataclass(frozen=True)
class Sample:
    """What one tick shows.

    Attributes
    ----------
    q, qd : ndarray (n_q,)
        Estimated coordinates and rates.
    pressure_pa : ndarray (n_u,)
        Measured pressures [Pa gauge].
    creep : ndarray (n_internal,)
        Creep and hysteresis states.
    covariance : ndarray (n_q, n_q)
        Covariance of q.
    uneven : UnevenForce or None
        What the model lacks near to q; the rest is learned.
    """

    q: Array
    qd: Array
    pressure_pa: Array
    creep: Array
    covariance: Array
    uneven: UnevenForce | None = None

    def finite(self) -> bool:
        """Whether all numbers are finite."""
        parts = (self.q, self.qd, self.pressure_pa, self.creep, self.covariance)
        return all(bool(np.isfinite(part).all()) for part in parts)


@dataclass(frozen=True)
class LearnerState:
    """State of the learner.

    Attributes
    ----------
    learned : Learned
        The model in force.
    information, moment : ndarray (size, size), (size,)
        A and b of A theta = b.
    residual, regressor : ndarray (n_q,), (n_q, size); None before the first sample
        Both sides after the low-pass, in units of force.
    rate : ndarray (n_q,) or None
        qd of the last sample; None before the first one.
    waited_s, passed_s : float
        Time before the low-pass began, and since then [s].
    at_bound_s : float
        Time at a bound without a break [s].
    refused, restored : int
        Samples that were not finite; restorations of the prior.
    note : str
        What the last sample has caused, for the user; else empty.
    """

    learned: Learned
    information: Array
    moment: Array
    residual: Array | None = None
    regressor: Array | None = None
    rate: Array | None = None
    waited_s: float = 0.0
    passed_s: float = 0.0
    at_bound_s: float = 0.0
    refused: int = 0
    restored: int = 0
    note: str = ""


class Learner:
    """The learner of one arm.

    Parameters
    ----------
    arm : SoftArm
        Model.
    config : LearnerConfig
        Prior, noise, forgetting and bounds.
    pieces : int
        Number of pieces into which each link is discretised.
    """

    def __init__(self, arm: SoftArm, config: LearnerConfig, pieces: int = 1) -> None:
        self.arm, self.force = arm, LearnedForce(arm, pieces)
        self.config = config = complete_learner(config, arm, self.force.scales.force)
        weights = self.force.size - 1
        deviation = np.concatenate([[config.mass_std_kg], np.full(weights, config.weight_std)])
        self.slope = self._slope()
        self.noise = config.noise**2 * np.eye(arm.n_q)
        self.prior = np.diag(deviation**-2)
        self.mass_rate = follow_rate(config.mass_std_kg, arm, self.force.scales)
        self.lower = np.concatenate([[config.mass_lower_kg], np.full(weights, -config.weight_bound)])
        self.upper = np.concatenate([[config.mass_upper_kg], np.full(weights, config.weight_bound)])

    def initial_state(self) -> LearnerState:
        """Return the prior."""
        size = self.force.size
        return LearnerState(Learned(np.zeros(size)), self.prior.copy(), np.zeros(size))

    def step(self, state: LearnerState, sample: Sample, dt: float) -> LearnerState:
        """Return the state after one sample.

        Parameters
        ----------
        state : LearnerState
            After the last sample.
        sample : Sample
        dt : float
            Time since the last sample [s].
        """
        if not sample.finite():
            return replace(state, refused=state.refused + 1, note="a sample that is not finite: not learned")
        # Differences of the rates are noise, of which the low-pass leaves what the rates alone have; the mean
        # of the first samples would keep what the filter does until it is sure.
        qdd = np.zeros(len(sample.q))
        if state.rate is not None and self.config.low_pass_per_s * state.passed_s > 1.0:
            qdd = (sample.qd - state.rate) / dt
        residual, regressor = self._sides(sample, qdd)
        if not (np.isfinite(residual).all() and np.isfinite(regressor).all()):
            return replace(state, refused=state.refused + 1, note="a force that is not finite: not learned")
        if state.residual is None and state.waited_s < _WAIT_S and self._doubtful(sample.covariance):
            return replace(state, rate=sample.qd, waited_s=state.waited_s + dt, note="")
        if state.residual is not None and state.regressor is not None:
            # At first a mean: the first sample alone would count for the time of the low-pass.
            part = max(-math.expm1(-self.config.low_pass_per_s * dt), dt / (state.passed_s + dt))
            residual = state.residual + part * (residual - state.residual)
            regressor = state.regressor + part * (regressor - state.regressor)
        passed_s = state.passed_s + dt
        state = replace(
            state, residual=residual, regressor=regressor, rate=sample.qd, passed_s=passed_s, note=""
        )
        try:
            information, moment = self._gained(state, residual, regressor, sample.covariance, dt)
            theta = _solved(information, moment)
        except np.linalg.LinAlgError:  # a covariance that cancels the noise
            theta = None
        if theta is None:
            return self._restored(state, "the information is singular: prior restored")
        return self._projected(replace(state, information=information, moment=moment), theta, dt)

    def follow(self, state: LearnerState, power: float, dt: float) -> LearnerState:
        """Return the state after a tick without positions: the mass follows the tracking error.

        A bend from orientations alone is biased by the load itself, and so is the prediction error. W is
        forgotten.

        Parameters
        ----------
        state : LearnerState
            After the last sample.
        power : float
            Y_m' s at the reference [J/(kg s)].
        dt : float
            Time since the last sample [s].
        """
        theta = math.exp(-dt / self.config.forget_s) * state.learned.theta
        theta[0] = state.learned.mass_kg - self.mass_rate * power * dt
        within = np.minimum(np.maximum(theta, self.lower), self.upper)
        return replace(
            self.initial_state(),
            learned=Learned(within),
            moment=self.prior @ within,
            refused=state.refused,
            restored=state.restored,
        )

    def _slope(self) -> Array:
        """Return the slope of the static force, in units of force, by q where the arm is straight.

        Weight counts: a shape that no position shows would else leak into what they show.
        """
        arm, scales = self.arm, self.force.scales
        steps = np.diag(_STEP * scales.q)
        forces = [
            arm.gravity_force(x) + arm.elastic_force(x) - arm.gravity_force(-x) - arm.elastic_force(-x)
            for x in steps
        ]
        return np.asarray(np.stack(forces, axis=1) / (2.0 * _STEP * scales.force[:, None] * scales.q))

    def _doubtful(self, covariance: Array) -> bool:
        """Whether the filter's doubt about q, as a force, is above the noise."""
        variance = np.diag(covariance) * self.force.scales.stiffness**2
        return bool(np.max(variance) > self.config.noise**2)

    def deviations(self, state: LearnerState) -> Array:
        """Return the deviation (size,) of each learned value by the noise that the learner assumes."""
        try:
            variance = np.diag(np.linalg.inv(state.information))
        except np.linalg.LinAlgError:
            variance = np.full(self.force.size, math.nan)
        return np.sqrt(np.maximum(variance, 0.0))

    def _sides(self, sample: Sample, qdd: Array) -> tuple[Array, Array]:
        """Return r / U (n_q,) and Phi (n_q, size)."""
        arm, q, qd = self.arm, sample.q, sample.qd
        motion = arm.motion_forces(q, qd, qdd)
        made = motion.actuation @ arm.acting_pressure(sample.pressure_pa)
        model = motion.own + arm.damping_force(q, qd)
        missing = made - model - arm.internal_force(q, sample.creep)
        regressor = self.force.regressor(q, motion.by_mass)
        if sample.uneven is not None:
            lacks = sample.uneven
            missing = missing - (lacks.at(q) - lacks.mass_kg * lacks.by_mass)
            regressor[:, 0] += lacks.by_mass / self.force.scales.force
        return missing / self.force.scales.force, regressor

    def _gained(
        self, state: LearnerState, residual: Array, regressor: Array, covariance: Array, dt: float
    ) -> tuple[Array, Array]:
        """Return information and moment after a sample; the arrays are those of the low-pass."""
        config = self.config
        noise = self.noise + self.slope @ covariance @ self.slope.T
        missed = residual - regressor @ state.learned.theta
        solved = np.linalg.solve(noise, np.column_stack([regressor, missed]))
        # Samples of a low-pass repeat each other for 2 / its rate.
        weighed = 0.5 * config.low_pass_per_s * solved[:, :-1].T
        # Against the noise and the doubt about q: what no position shows is no reason to forget.
        large = float(missed @ solved[:, -1]) / len(residual)
        large = min(large, config.forget_factor)
        forget = (1.0 + large) / config.forget_s
        # What fits the model so badly says little about W: an arm that swings after its load has changed.
        weighed /= max(1.0, large)
        information = state.information + dt * (
            weighed @ regressor - forget * (state.information - self.prior)
        )
        moment = state.moment + dt * (weighed @ residual - forget * state.moment)
        # A load that comes or falls off changes the mass alone.
        walk = dt * max(large - 1.0, 0.0) * config.mass_walk_per_s * config.mass_std_kg**2
        return _walked(information, moment, walk) if walk > 0.0 else (information, moment)

    def _projected(self, state: LearnerState, theta: Array, dt: float) -> LearnerState:
        """Return the state with admissible estimates; the prior after too long at a bound."""
        outside = bool(((theta < self.lower) | (theta > self.upper)).any())
        at_bound_s = state.at_bound_s + dt if outside else 0.0
        if at_bound_s > self.config.bound_s:
            return self._restored(state, f"at its bound for {self.config.bound_s:g} s: prior restored")
        within = np.minimum(np.maximum(theta, self.lower), self.upper)
        return replace(state, learned=Learned(within), at_bound_s=at_bound_s)

    def _restored(self, state: LearnerState, note: str) -> LearnerState:
        fresh = self.initial_state()
        return replace(fresh, refused=state.refused, restored=state.restored + 1, note=note)


def _walked(information: Array, moment: Array, variance: float) -> tuple[Array, Array]:
    """Return information and moment after the mass may have moved by a variance [kg^2]; theta stays."""
    column = information[0]
    part = variance / (1.0 + variance * column[0])
    return information - part * np.outer(column, column), moment - part * column * moment[0]


def _solved(information: Array, moment: Array) -> Array | None:
    """Return theta, or None where the information does not determine it."""
    # Scaled to a diagonal of 1: masses and weights have other units.
    diagonal = np.diag(information)
    if not (np.isfinite(information).all() and np.isfinite(moment).all() and (diagonal > 0.0).all()):
        return None
    root = 1.0 / np.sqrt(diagonal)
    factor, failed = dpotrf(information * np.outer(root, root), lower=True)
    if failed or np.diag(factor).min() ** 2 * _SINGULAR < 1.0:
        return None
    theta: Array = root * dpotrs(factor, root * moment, lower=True)[0]
    return theta
