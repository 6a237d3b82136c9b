"""A learner driven by the prediction error: recursive least squares on what the measured pressures make.

r = H(q) p - [M qdd + C qd + G + f_e + R qd + creep] = Y_m m + U W phi(q) + R_t qd + d(q, m)

Measured pressures say what force acts, so the lag of the regulators does not enter. Both sides pass one
low-pass. The information about theta grows with each sample, weighed by its noise S = sigma^2 I + B P B', B
the slope of elastic force and weight, P the covariance of q, and is forgotten towards the prior. What samples
do not determine stays at the prior.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from soro_core.adaptation.chamber_gains import NAMED_DEVIATIONS, NAMED_PART, chamber_model
from soro_core.adaptation.config import LearnerConfig, complete_learner, follow_rate
from soro_core.adaptation.damping import MOST_S
from soro_core.adaptation.force import LearnedForce
from soro_core.adaptation.kept import KeptNumbers
from soro_core.adaptation.kernel.information import LearningRule, RuleFields, gain
from soro_core.adaptation.kernel.sample import show
from soro_core.adaptation.learned import Learned
from soro_core.adaptation.learning.bounds import bounded_minimum
from soro_core.adaptation.learning.outside_force import KEPT, PAST_S, held
from soro_core.adaptation.learning.slope_evidence import SlopeEvidence, compared, rivals
from soro_core.adaptation.learning.state import LearnerSample, LearnerState
from soro_core.adaptation.nonuniform_force import NonuniformForce
from soro_core.arrays import Array, Integers
from soro_core.frozen import replaced
from soro_core.linear import inverse
from soro_core.model.checks import fault
from soro_core.model.dynamics import GOOD, NOT_FINITE
from soro_core.model.entries import make_box

if TYPE_CHECKING:
    from soro_core.model import SoftArm


# Part of a unit of q for the difference quotient of the force.
_STEP = 1e-6
# The filter first moves from its start to the arm, and the low-pass would keep that: it begins when the
# filter is sure, or after this time [s].
_WAIT_S = 0.5
# The chambers are judged after each such time [s].
_JUDGED_S = 0.5


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
    kept : KeptNumbers, optional
        What an earlier run has learned of the arm: the prior's means. Default: 0.
    """

    def __init__(
        self, arm: SoftArm, config: LearnerConfig, pieces: int = 1, kept: KeptNumbers | None = None
    ) -> None:
        self.arm, self.force = arm, LearnedForce(arm, pieces)
        self.config = config = complete_learner(config, arm, self.force.scales.force)
        damping = self.force.damping
        weights = self.force.size - 1 - damping.size
        deviation = np.concatenate([[config.mass_std_kg], np.full(weights, config.weight_std)])
        self.chambers = chamber_model(arm, config.gain_std, config.slope_std, self.force.scales.q)
        self.size = self.force.size + self.chambers.size
        self.slope = self._slope()
        self.load_prior, self.damping_std = np.diag(deviation**-2), config.damping_std * damping.critical_s
        self.mass_rate = follow_rate(config.mass_std_kg, arm, self.force.scales)
        bound = np.full(weights, config.weight_bound)
        self.lower = np.concatenate([[config.mass_lower_kg], -bound, damping.lower, self.chambers.lower])
        most = np.full(damping.size, MOST_S)
        self.upper = np.concatenate([[config.mass_upper_kg], bound, most, self.chambers.upper])
        self.names = ("tip_mass", *self.force.names, *self.chambers.names)
        self.start = np.zeros(self.size)
        if kept is not None:
            self.start = kept.start(arm.robot, self.names, self.lower, self.upper)
        self.prior = self._prior(self.start, self.start)
        self.first_slope = self.force.size + self.chambers.link.size
        order, lasting = self._order()
        self._rule = LearningRule(
            config.low_pass_per_s,
            config.forget_s,
            config.damping_forget_s,
            config.forget_factor,
            config.mass_walk_per_s * config.mass_std_kg**2,
            self.prior,
            config.noise**2 * np.eye(arm.n_q),
            self.slope,
            order,
            *((bound - self.start)[lasting] for bound in (self.lower, self.upper)),
        )
        self._lasting = lasting
        self._box = make_box(arm.tables)
        zero = np.zeros(arm.n_q)
        self._nothing = NonuniformForce(zero, 0.0, zero, zero, np.zeros((arm.n_q, arm.n_q)))

    def initial_state(self, start: Array | None = None) -> LearnerState:
        """Return the prior.

        Parameters
        ----------
        start : ndarray (size,), optional
            Mean of the prior. Default: the numbers that an earlier run kept, or 0.
        """
        start = self.start if start is None else start
        prior = self._prior(start, start)
        return LearnerState(
            **self._parts(start),
            information=prior.copy(),
            moment=np.zeros(self.size),
            start=start,
            prior=prior,
        )

    def state_with_gains(self, gain: Array, deviation: Array) -> LearnerState:
        """Return the prior with measured gains of each link in which one differs so much that it is named.

        Parameters
        ----------
        gain, deviation : ndarray (n_u,)
            Gains relative to the mean of their link, and their deviations.
        """
        if not (np.isfinite(gain).all() and np.isfinite(deviation).all()):
            return self.initial_state()
        start, link, size = self.start.copy(), self.chambers.link, self.force.size
        own = slice(size, size + link.size)
        away = np.abs(gain - start[own])
        is_other = away > np.maximum(NAMED_PART, NAMED_DEVIATIONS * deviation)
        within = np.clip(gain, self.lower[own], self.upper[own])
        start[own] = np.where(np.isin(link, link[is_other]), within, start[own])
        return self.initial_state(start)

    def _prior(self, start: Array, theta: Array) -> Array:
        """Return A_0 (size, size) for a start and such values of damping and chambers.

        Values that were kept or measured are in doubt by their own size, as at the end of a run that learned
        them: a file of another day is overcome as fast as the first one was. Damping has long tails as the
        chambers have: who has guessed one of them has guessed all.
        """
        load, size = len(self.load_prior), self.force.size
        far = np.maximum(np.abs(start[load:]), np.abs(theta[load:] - start[load:]))
        prior = np.zeros((self.size, self.size))
        prior[:load, :load] = self.load_prior
        prior[load:size, load:size] = self.force.damping.prior(self.damping_std, far[: size - load])
        prior[size:, size:] = self.chambers.prior(far[size - load :])
        return prior

    def _order(self) -> tuple[Integers, Integers]:
        """Return the order of the values for the learning rule; and what lasts, its end: damping, slopes."""
        values = np.arange(self.size)
        lasts = (values >= len(self.load_prior)) & (values < self.force.size) | (values >= self.first_slope)
        lasting = np.flatnonzero(lasts)
        return np.concatenate([np.flatnonzero(~lasts), lasting]), lasting

    def _room(self, start: Array, has_slopes: bool) -> tuple[Array, Array]:
        """Return the bounds (size,) of what is learned beyond the start: slopes stay there or are free."""
        lower, upper = self.lower - start, self.upper - start
        if not has_slopes:
            lower[self.first_slope :] = upper[self.first_slope :] = 0.0
        return lower, upper

    def _parts(self, theta: Array) -> dict[str, Any]:
        """Return all learned values as the fields of a state."""
        return {"learned": Learned(theta[: self.force.size]), "chambers": theta[self.force.size :]}

    def step(self, state: LearnerState, sample: LearnerSample, dt: float) -> LearnerState:
        """Return the state after one sample.

        Parameters
        ----------
        state : LearnerState
            After the last sample.
        sample : LearnerSample
        dt : float
            Time since the last sample [s].
        """
        # Differences of the rates are noise, of which the low-pass leaves what the rates alone have; the mean
        # of the first samples would keep what the filter does until it is sure.
        config, n, is_first = self.config, self.arm.n_q, state.residual is None
        qdd = np.zeros(n)
        if state.rate is not None and config.low_pass_per_s * state.passed_s > 1.0:
            qdd = (sample.qd - state.rate) / dt
        # At first a mean: the first sample alone would count for the time of the low-pass.
        part = max(-math.expm1(-config.low_pass_per_s * dt), dt / (state.passed_s + dt))
        if state.residual is None or state.regressor is None:
            part, residual, regressor = 1.0, np.zeros(n), np.zeros((n, self.size))
        else:
            residual, regressor = state.residual.copy(), state.regressor.copy()
        covariance = np.array(sample.covariance, order="C")
        of_force, size = np.ascontiguousarray(regressor[:, : self.force.size]), self.force.size
        scales, unmodelled = self.force.scales, sample.unmodelled or self._nothing
        code = show(
            self._box,
            (
                np.array(sample.q),
                np.array(sample.qd),
                qdd,
                np.array(sample.pressure_pa),
                np.array(sample.creep),
                covariance,
            ),
            (unmodelled.q, unmodelled.mass_kg, unmodelled.force, unmodelled.by_mass, unmodelled.by_q),
            (scales.force, scales.q, self.force.damping.number, self.force.damping.matrix),
            part,
            (residual, of_force),
        )
        if code == NOT_FINITE:
            note = "a sample, or its force, that is not finite: not learned"
            return replace(state, refused=state.refused + 1, note=note)
        if code != GOOD:
            raise fault(code, sample.q, sample.qd)
        if is_first and state.waited_s < _WAIT_S and self._doubtful(covariance):
            return replace(state, rate=sample.qd, waited_s=state.waited_s + dt, note="")
        acting_pa = self.arm.acting_pressure(sample.pressure_pa)
        beyond, of_chambers = self.chambers.tangent(state.chambers, sample.q, acting_pa)
        residual -= part * beyond / scales.force
        regressor[:, :size] = of_force
        regressor[:, size:] += part * (of_chambers / scales.force[:, None] - regressor[:, size:])
        if sample.stage != "free":
            noise = self._rule.noise + self.slope @ covariance @ self.slope.T
            seen, bounds = (residual, regressor, noise), self._mass_bounds(state)
            under = held(state, sample.stage, seen, self._rule, bounds, dt)
            return replaced(under, residual=residual, regressor=regressor, rate=sample.qd, note=state.named)
        start, known = state.start, np.concatenate([state.learned.theta, state.chambers])
        prior = self._prior(start, known)
        information, moment = state.information + (prior - state.prior), state.moment.copy()
        # What is learned is the difference from the start, to which it returns.
        theta = known - start
        room = self._room(start, state.slopes.adopted)
        least, most = (bound[self._lasting] for bound in room)
        rule: RuleFields = (*self._rule[:5], prior, *self._rule[6:9], least, most)
        sides = residual - regressor @ start, regressor
        after = np.empty_like(information), np.empty_like(moment)
        is_determined = gain(rule, dt, covariance, sides, (information, moment, *after), theta)
        if not is_determined:  # a covariance that cancels the noise, for one
            return self._restored(state, "the information is singular: prior restored")
        within = start + bounded_minimum(information, moment, theta, *room)
        mass_kg = within[0]
        at_bound_s = state.at_bound_s + dt if mass_kg in (self.lower[0], self.upper[0]) else 0.0
        note = ""
        if at_bound_s > config.bound_s:
            note = f"the learned mass at the tip is at its bound, {1e3 * mass_kg:.3g} g"
        parts, judged_s, slopes, named = self._parts(within), state.judged_s + dt, state.slopes, state.named
        if judged_s >= _JUDGED_S:
            noise = self._rule.noise + self.slope @ covariance @ self.slope.T
            adopted, sum_s = compared(slopes, sides, noise, judged_s)
            found = rivals(information, moment, self.first_slope, self._room(start, True))
            slopes, judged_s = SlopeEvidence(adopted, sum_s, found), 0.0
            named = self._named(parts["chambers"], information)
        past = tuple((kept[0] + dt, *kept[1:]) for kept in state.past)
        if not past or past[-1][0] >= PAST_S:
            past = (*past[-1:], (0.0, *(getattr(state, name) for name in KEPT)))
        return replaced(
            state,
            **parts,
            stage="free",
            past=past,
            information=after[0],
            moment=after[1],
            prior=prior,
            residual=residual,
            regressor=regressor,
            rate=sample.qd,
            passed_s=state.passed_s + dt,
            at_bound_s=at_bound_s,
            slopes=slopes,
            judged_s=judged_s,
            named=named,
            note="; ".join(filter(None, (named, note))),
        )

    def _mass_bounds(self, state: LearnerState) -> tuple[float, float]:
        """Return the bounds of the mass [kg] under a push.

        A push to the side is no load less than none, with which a free arm's model may be at its best.
        """
        least = max(self.lower[0], min(-self.arm.robot.tip_mass, state.learned.mass_kg))
        return float(least), float(self.upper[0])

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
        theta, start = np.concatenate([state.learned.theta, state.chambers]), state.start
        theta = start + math.exp(-dt / self.config.forget_s) * (theta - start)
        theta[0] = state.learned.mass_kg - self.mass_rate * power * dt
        within = np.minimum(np.maximum(theta, self.lower), self.upper)
        fresh = self.initial_state(start)
        return replace(
            fresh,
            **self._parts(within),
            moment=fresh.prior @ (within - start),
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
            variance = np.diag(inverse(state.information))
        except np.linalg.LinAlgError:
            variance = np.full(self.size, math.nan)
        return np.sqrt(np.maximum(variance, 0.0))

    def doubt(self, state: LearnerState) -> Array | None:
        """Return the covariance (n_q, n_q) of the learned force where the last samples are, None without.

        Under a force from outside it is that of its change since before it, where that is smaller. The
        deviations are those by the noise that the learner assumes.
        """
        if state.regressor is None:
            return None
        sides = [state.regressor]
        if state.stage != "free" and state.unpushed is not None:
            sides.append(state.regressor - state.unpushed[2])
        found = []
        for one in sides:
            try:
                found.append(np.asarray(one @ np.linalg.solve(state.information, one.T)))
            except np.linalg.LinAlgError:
                return None
        least, unit = min(found, key=np.trace), self.force.scales.force
        return unit[:, None] * least * unit if np.isfinite(least).all() else None

    def _named(self, chambers: Array, information: Array) -> str:
        """Return which chambers differ from the others of their link."""
        only = np.eye(self.size)[:, self.force.size :]
        covariance = np.asarray(np.linalg.solve(information, only)[self.force.size :])
        return self.chambers.named(chambers, covariance)

    def _restored(self, state: LearnerState, note: str) -> LearnerState:
        fresh = self.initial_state(state.start)
        return replace(fresh, refused=state.refused, restored=state.restored + 1, note=note)
