"""The law `composite`: desired compensation with the learned force, which the prediction error drives.

f = M qdd_d + C qd_d + G + f_e + (R + R_t) qd_d + (creep) + Y_m m + U W phi - K_p e - K_d s, docs/control.md.
All forces of the model and the learned one are those at the reference. The learner is that of
`soro_core.adaptation`; the filter predicts with the same force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from soro_core.adaptation.config import LearnerConfig
from soro_core.adaptation.external_force import Stage
from soro_core.adaptation.kept import KeptNumbers
from soro_core.adaptation.learned import Learned
from soro_core.adaptation.learner import Learner
from soro_core.adaptation.learning.state import LearnerSample, LearnerState
from soro_core.adaptation.nonuniform_force import NonuniformForce
from soro_core.arrays import Array
from soro_core.config import with_renamed
from soro_core.control.laws.protocol import ArmBelief, Law, LawOptions, Preview, Setting, Terms
from soro_core.control.nonuniform_strain import NonuniformStrain, NonuniformStrainState, has_nonuniform_strain
from soro_core.control.reference.trajectory import Point
from soro_core.frozen import replaced

# Time between samples of the learner, and between steps of the non-uniform strain [s]: both change slowly. A
# loop of 250 Hz or less takes each at every tick, a faster one at ticks of their own in turns.
_SAMPLE_S = 0.004
# Time after which the doubt about the learned force is found anew [s].
_DOUBT_S = 0.02


class CompositeOptions(LearnerConfig, LawOptions):
    """Keys of the law: those of its learner, and what it knows of the bend."""

    nonuniform_strain: bool = Field(True, description="a load bends links of constant strain non-uniformly")
    learned: KeptNumbers | None = Field(
        None, description="what an earlier run has learned of the arm; soro run --learn-from states it"
    )

    @model_validator(mode="before")
    @classmethod
    def _renamed(cls, data: Any) -> Any:
        return with_renamed(data, {"uneven": "nonuniform_strain"})


@dataclass(frozen=True)
class CompositeState:
    """State of the law.

    Attributes
    ----------
    learner : LearnerState
    creep : ndarray (n_internal,)
        Creep along the reference.
    shape : NonuniformStrainState or None
        The non-uniform strain at the reference; None for an arm without one.
    unmodelled : NonuniformForce or None
        Unmodelled force of constant strains near there; None before the first tick.
    learned : Learned or None
        What the filter is told: the same object until there is something new; None before the first tick.
    sampled_s, bent_s : float
        Time since the last sample of the learner, and since the last step of the shape [s].
    doubted_s : float
        The same since the doubt about the learned force was found.
    """

    learner: LearnerState
    creep: Array
    shape: NonuniformStrainState | None = None
    unmodelled: NonuniformForce | None = None
    learned: Learned | None = None
    sampled_s: float = 0.0
    bent_s: float = math.inf
    doubted_s: float = 0.0


class Composite(Law[CompositeState]):
    """Desired compensation with one learned force for law and filter."""

    can_adapt = True
    Options = CompositeOptions
    learns = True
    observes_regulators = True
    # What drives no learning can be larger in bending. The pose is noisy along the arm.
    feedback_factors = (0.5, 2.5)

    def __init__(self, setting: Setting, options: LawOptions) -> None:
        assert isinstance(options, CompositeOptions)
        self.setting, self.adapts = setting, setting.config.adapt
        self.learner = Learner(setting.arm, options, setting.pieces, options.learned)
        # What the inverse of the regulators' lag leaves of it [s].
        self.lag_s = max(setting.pressures.preview_s - setting.pressures.dead_time_s, 0.0)
        bends = options.nonuniform_strain and has_nonuniform_strain(setting.arm)
        self.nonuniform = NonuniformStrain(setting.arm, setting.pieces) if bends else None

    def initial_state(self) -> CompositeState:
        """Return the state with nothing learned."""
        shape = None if self.nonuniform is None else self.nonuniform.initial_state()
        return CompositeState(self.learner.initial_state(), np.zeros(self.setting.arm.n_internal), shape)

    def step(
        self, state: CompositeState, belief: ArmBelief, reference: Preview, dt: float
    ) -> tuple[CompositeState, Array, Terms]:
        """Return state, force and terms; parameters as in `Law.step`."""
        arm, gains, wanted = self.setting.arm, self.setting.gains, reference.ahead
        q, qd = self.setting.moved(belief, reference)
        # Both moved on at their rates of now: moved along its curve, the reference is ahead of an arm on it.
        now = reference.now
        error = q - (now.q + reference.ahead_s * now.qd)
        s = qd - now.qd + gains.rate * error
        learner, sampled_s = state.learner, state.sampled_s + dt
        if _is_due(sampled_s, dt):
            learner, sampled_s = self._learned(state, belief, reference, s, sampled_s), 0.0
        elif learner.note:
            learner = replaced(learner, note="")
        # A lag of first order is not a delay: ahead by T, its answer misses T^2 / 2 of the second derivative.
        at = wanted.q - 0.5 * self.lag_s**2 * wanted.qdd
        motion = arm.motion_forces(at, wanted.qd, wanted.qdd)
        model = motion.own
        internal = arm.internal_force(at, state.creep)
        learned = self.learner.force.with_mass(learner.learned, at, wanted.qd, motion.by_mass)
        shape, unmodelled, bent_s = state.shape, state.unmodelled, state.bent_s + dt
        if self.nonuniform is not None and shape is not None and _is_due(bent_s, dt):
            point, bent_s = Point(at, wanted.qd, wanted.qdd), 0.0
            shape, unmodelled = self.nonuniform.step(shape, point, learner.learned.mass_kg)
        nonuniform = np.zeros_like(at) if unmodelled is None else unmodelled.at(at, learner.learned.mass_kg)
        proportional, derivative = -(gains.k_p @ error), -(gains.k_d @ s)
        terms = {
            "error": error,
            "s": s,
            "model": model,
            "learnt": learned,
            "uneven": nonuniform,
            "internal": internal,
            "proportional": proportional,
            "derivative": derivative,
        }
        creep = arm.internal_midpoint(wanted.q, wanted.qd, state.creep, dt)
        desired = model + internal + learned + nonuniform + proportional + derivative
        told, doubted_s = state.learned, state.doubted_s
        if told is None or learner.learned is not state.learner.learned or unmodelled is not state.unmodelled:
            doubt, doubted_s = None if told is None else told.doubt, doubted_s + dt
            if doubt is None or doubted_s >= _DOUBT_S:
                doubt, doubted_s = self.learner.doubt(learner), 0.0
            told = self._told(learner, unmodelled, belief, doubt)
        after = CompositeState(learner, creep, shape, unmodelled, told, sampled_s, bent_s, doubted_s)
        return after, desired, terms

    def actuation(self, state: CompositeState, actuation: Array, q: Array) -> Array:
        """Return H with the learned gains of the chambers; parameters as in `Law.actuation`."""
        return np.asarray(actuation * self.learner.chambers.factor(state.learner.chambers, q))

    def with_gains(self, state: CompositeState, gain: Array, deviation: Array) -> CompositeState:
        """Return the state with a learner that starts from these gains; parameters as in `Law.with_gains`."""
        if not self.adapts:
            return state
        return replaced(state, learner=self.learner.state_with_gains(gain, deviation))

    def heaviest_kg(self) -> float:
        """Return the upper bound of the learned mass [kg]."""
        return self.learner.config.mass_upper_kg if self.adapts else 0.0

    def reference_force(self, state: CompositeState, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the force of model and learned load; parameters as in `Law.reference_force`."""
        learned = self.learner.force.force(state.learner.learned, q, qd, qdd)
        if self.nonuniform is not None:
            learned = learned + self.nonuniform.away(Point(q, qd, qdd), state.learner.learned.mass_kg)
        return self.setting.model_force(q, qd, qdd) + learned

    def estimates(self, state: CompositeState) -> dict[str, float]:
        """Return mass at the tip [kg], W, damping [s], relative gains and area slopes by name."""
        theta = np.concatenate([state.learner.learned.theta, state.learner.chambers])
        theta[0] += self.setting.arm.robot.tip_mass
        return dict(zip(self.learner.names, theta.tolist(), strict=True))

    def deviations(self, state: CompositeState) -> dict[str, float]:
        """Return the deviations of the estimates by name."""
        return dict(zip(self.learner.names, self.learner.deviations(state.learner).tolist(), strict=True))

    def learned(self, state: CompositeState) -> Learned:
        """Return the learned model for the filter; W has the tangents of what it is not learned for."""
        return state.learned or self._told(state.learner, state.unmodelled)

    def _told(
        self,
        learner: LearnerState,
        unmodelled: NonuniformForce | None,
        belief: ArmBelief | None = None,
        doubt: Array | None = None,
    ) -> Learned:
        """Return mass and W with the tangents of all else that is learned or known beside the model."""
        found, scales = learner.learned, self.learner.force.scales
        if unmodelled is not None:
            found = unmodelled.added_to(found, scales)
        own = learner.learned
        if belief is not None and any(learner.chambers.tolist()):
            acting = self.setting.arm.acting_pressure(belief.pressure_pa)
            force, by_q = self.learner.chambers.force(learner.chambers, belief.q, acting)
            found, own = (one.with_force(belief.q, force, by_q, scales) for one in (found, own))
        if found is own and doubt is None:  # the same object, until there is something new
            return found
        return replaced(found, own=own.theta, doubt=doubt)

    def counts(self, state: CompositeState) -> dict[str, int]:
        """Return samples refused and priors restored."""
        return {"samples_refused": state.learner.refused, "priors_restored": state.learner.restored}

    def differing(self, state: CompositeState) -> str:
        """Return the chambers that the learner names; parameters as in `Law.differing`."""
        return state.learner.named

    def note(self, state: CompositeState) -> str:
        """Return what the learner has to say."""
        return state.learner.note

    def _learned(
        self, state: CompositeState, belief: ArmBelief, reference: Preview, s: Array, dt: float
    ) -> LearnerState:
        learner = state.learner
        if not self.adapts or belief.covariance is None:
            return replaced(learner, note="")
        if not belief.positions:
            if belief.saturated.any():  # more force would not come
                return replaced(learner, note="")
            wanted = reference.ahead
            by_mass = self.setting.arm.tip_mass_force(wanted.q, wanted.qd, wanted.qdd)
            return self.learner.follow(learner, float(by_mass @ s), dt)
        n = belief.q.size
        stage: Stage = "free" if belief.external is None else belief.external.stage
        if belief.external is not None and not belief.external.mass_free:
            stage = "contact"  # or a push that has just gone: the mass of before it
        sample = LearnerSample(
            q=belief.q,
            qd=belief.qd,
            pressure_pa=belief.pressure_pa,
            creep=belief.creep,
            covariance=belief.covariance[:n, :n],
            unmodelled=state.unmodelled,
            stage=stage,
        )
        return self.learner.step(learner, sample, dt)


def _is_due(since_s: float, dt: float) -> bool:
    """Whether what is done every `_SAMPLE_S` falls to this tick, after a time [s]; `dt` [s] of the loop."""
    return since_s + 0.5 * dt >= _SAMPLE_S
