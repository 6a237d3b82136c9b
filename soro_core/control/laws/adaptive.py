"""The law `adaptive`: passivity-based, driven by the tracking error (`soro_core.control.passivity`)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from soro_core.arrays import Array
from soro_core.control.laws.protocol import ArmBelief, Law, LawOptions, Made, Preview, Setting, Terms
from soro_core.control.passivity.adaptive import Terms as LawTerms
from soro_core.control.passivity.adaptive import adapt, law
from soro_core.control.passivity.parameters import ParameterSet


@dataclass(frozen=True)
class AdaptiveState:
    """Estimates (m,) of the adapted parameters, creep along the reference, and the terms of the tick."""

    estimate: Array
    creep: Array
    terms: LawTerms | None = None


class Adaptive(Law[AdaptiveState]):
    """Desired compensation with parameters that follow the tracking error; its keys stand beside `law`."""

    can_adapt = True

    def __init__(self, setting: Setting, options: LawOptions) -> None:
        self.setting, self.config = setting, setting.config
        self.parameters = ParameterSet(setting.arm, self.config.adaptation, pieces=setting.pieces)
        self._desired = self.config.compensation == "reference"
        adaptation, fields = self.config.adaptation, setting.fields
        # For a strain with several coefficients, the dead zone is that of the root mean square along the
        # link.
        self.dead_zone = np.where(
            fields.stretch, adaptation.dead_zone_stretch_per_s, adaptation.dead_zone_curvature_per_m_s
        ) / np.sqrt(np.diag(fields.weight))

    def initial_state(self) -> AdaptiveState:
        """Return the state with the values of the robot file."""
        return AdaptiveState(self.parameters.nominal.copy(), np.zeros(self.setting.arm.n_internal))

    def step(
        self, state: AdaptiveState, belief: ArmBelief, reference: Preview, dt: float
    ) -> tuple[AdaptiveState, Array, Terms]:
        """Return state, force and terms; parameters as in `Law.step`."""
        arm, future = self.setting.arm, reference.ahead
        moved, rate = self.setting.moved(belief, reference)
        internal = np.asarray(arm.internal_force(moved, state.creep))
        terms = law(
            self.parameters,
            self.setting.gains,
            state.estimate,
            internal,
            moved,
            rate,
            future,
            self._desired,
        )
        creep = arm.internal_midpoint(future.q, future.qd, state.creep, dt)
        named = {
            name: getattr(terms, name)
            for name in ("error", "s", "model", "learnt", "internal", "proportional", "derivative")
        }
        return replace(state, creep=creep, terms=terms), terms.desired, named

    def heaviest_kg(self) -> float:
        """Return the upper bound of the adapted mass [kg], less that of the robot file."""
        parameters, mass = self.parameters, self.setting.arm.robot.tip_mass
        upper = dict(zip(parameters.names, parameters.polytope.upper.tolist(), strict=True))
        return float(max(upper.get("tip_mass", mass) - mass, 0.0))

    def reference_force(self, state: AdaptiveState, q: Array, qd: Array, qdd: Array) -> Array:
        """Return the force of the model with the estimates; parameters as in `Law.reference_force`."""
        model, regressor = self.parameters.model_force(q, qd, qd, qdd)
        return np.asarray(model + regressor @ (state.estimate - self.parameters.nominal))

    def actuation(self, state: AdaptiveState, actuation: Array, q: Array) -> Array:
        """Return H with the adapted gains of the chambers; parameters as in `Law.actuation`."""
        return actuation * self.parameters.gains(state.estimate)

    def place(self, belief: ArmBelief, reference: Preview) -> Array:
        """Return the reference, or the measured state where compensation takes place there."""
        return reference.ahead.q if self._desired else self.setting.moved(belief, reference)[0]

    def allocated(self, state: AdaptiveState, made: Made, dt: float) -> AdaptiveState:
        """Return the state with the estimates after the tick; parameters as in `Law.allocated`."""
        terms = state.terms
        if not self.config.adapt or terms is None:
            return state
        # Errors of the chamber gains multiply the measured pressures, not the commanded ones.
        regressor = terms.regressor + self.parameters.gain_regressor(made.actuation, made.acting_pa)
        shortfall = made.desired - made.force if made.saturated else None
        adaptation = self.config.adaptation
        estimate = adapt(
            self.parameters,
            state.estimate,
            regressor,
            terms.s,
            dt,
            self.dead_zone,
            adaptation.leakage_per_s,
            shortfall if adaptation.hold_saturated else None,
        )
        return replace(state, estimate=estimate)

    def estimates(self, state: AdaptiveState) -> dict[str, float]:
        """Return the adapted parameters by name."""
        return self.parameters.named(state.estimate)
