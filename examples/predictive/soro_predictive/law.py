"""The law `predictive`: the pressures whose predicted tip stays nearest to the reference.

Each tick predicts the arm along the last plan, takes the derivatives of the steps, and solves one quadratic
program: a real-time iteration of sequential quadratic programming. The first pressures of the plan, as a
force, are what soro allocates; it inverts the lag of the regulators, and the horizon knows what it leaves.

What the model lacks is learned as `composite` learns it, and the filter is told. The prediction has it, so no
offset is left. Where there is no plan, the force is that of `composite`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from pydantic import Field

from soro_core.adaptation.learned import Learned
from soro_core.arrays import Array
from soro_core.control.laws import ArmBelief, Composite, Preview, Setting, Terms
from soro_core.control.laws.composite import CompositeOptions, CompositeState
from soro_core.control.pressures.actuation import pressure_bounds
from soro_core.errors import ModelError
from soro_core.integrate import State
from soro_core.model import SoftArm
from soro_predictive.horizon import Horizon
from soro_predictive.program import Supply, best_wish

# Unit of the learned mass in the model of the prediction [kg]; the rest is a force.
_UNIT_KG = 2e-3


class PredictiveOptions(CompositeOptions):
    """Keys of the law: those of `composite`, and the horizon."""

    steps: int = Field(10, ge=2, le=40, description="steps of the horizon; the first is one tick")
    step_s: float = Field(0.025, gt=0, le=0.5, description="length of each other step [s]")
    change_mm: float = Field(2.0, gt=0, le=1e3, description="tip error as bad as 10 kPa from step to step")
    coordinate_mm: float = Field(0.1, gt=0, le=1e3, description="tip error as bad as a coordinate's unit")


@dataclass(frozen=True)
class PlanState(CompositeState):
    """State of the law: what is learned, the plan (N, n_u) [Pa gauge] or why there is none."""

    plan_pa: Array | None = None
    no_plan: str = ""


class Predictive(Composite):
    """Model predictive control of the tip, with the learner of `composite`."""

    Options = PredictiveOptions

    def __init__(self, setting: Setting, options: PredictiveOptions) -> None:
        super().__init__(setting, options)
        self.options, pressures, robot = options, setting.pressures, setting.arm.robot
        lag_s = pressures.lag_filter_s if pressures.lag_s > 0.0 else 1e-4
        lead = max(pressures.lag_s / pressures.lag_filter_s, 1.0)
        bounds = pressure_bounds(pressures, robot)
        self.supply = Supply(*bounds, pressures.rise_pa_s, pressures.fall_pa_s, lead)

        @lru_cache(maxsize=2)
        def horizon(units: int) -> Horizon:
            return Horizon(SoftArm(robot.replace(tip_mass=robot.tip_mass + units * _UNIT_KG)), lag_s)

        self.horizon = horizon
        horizon(0)

    def initial_state(self) -> PlanState:
        """Return the state with nothing learned and no plan."""
        return PlanState(**vars(super().initial_state()))

    def step(
        self, state: PlanState, belief: ArmBelief, reference: Preview, dt: float
    ) -> tuple[PlanState, Array, Terms]:
        """Return state, force and terms; parameters as in `Law.step`."""
        learned, force, terms = super().step(state, belief, reference, dt)
        try:
            plan = self._plan(state.plan_pa, learned, terms["uneven"], belief, reference, dt)
        except ModelError as error:
            return PlanState(**vars(learned), no_plan=f"no plan: {error}"), force, terms
        q = self.place(belief, reference)
        force = self.actuation(learned, self.setting.arm.actuation_matrix(q), q) @ plan[0]
        return PlanState(**vars(learned), plan_pa=plan), force, {"planned": force, "learnt": terms["learnt"]}

    def place(self, belief: ArmBelief, reference: Preview) -> Array:
        """Return where the arm is when the pressures act."""
        return self.setting.moved(belief, reference)[0]

    def note(self, state: PlanState) -> str:
        """Return why there is no plan, or what the learner says."""
        return state.no_plan or super().note(state)

    def _plan(
        self,
        last: Array | None,
        found: CompositeState,
        uneven: Array,
        belief: ArmBelief,
        reference: Preview,
        dt: float,
    ) -> Array:
        """Return wished pressures (N, n_u) [Pa gauge]; ModelError where the model has no motion."""
        options, supply, arm = self.options, self.supply, self.setting.arm
        start = np.clip(belief.pressure_pa, supply.low_pa, supply.high_pa)
        before = start if last is None else last[0]
        # Until set points of this tick act, the wish of the last one does: a step before those of the plan.
        late_s = max(self.setting.pressures.dead_time_s, 1e-4)
        steps_s = np.array([late_s, dt, *(options.steps - 1) * [options.step_s]])
        plan = np.tile(start, (options.steps, 1)) if last is None else _later(last, steps_s[1:])
        points = [reference.at(t) for t in np.cumsum(steps_s).tolist()]
        # What is learned: whole units of mass in the model, the rest as a wrench.
        learned, force, now = found.learner.learned, self.learner.force, points[0]
        units = round(max(learned.mass_kg, 0.0) / _UNIT_KG)
        beside = Learned(np.array([learned.mass_kg - units * _UNIT_KG, *learned.theta[1:]]))
        by_mass = arm.tip_mass_force(now.q, now.qd, now.qdd)
        lacking = np.array([force.with_mass(beside, point.q, point.qd, by_mass) for point in points]) + uneven
        horizon, gain = self.horizon(units), self.learner.chambers.factor(found.learner.chambers, belief.q)
        wish = np.vstack([before, plan])
        state_now = State(belief.q, belief.qd, belief.creep)
        course = horizon.course(state_now, belief.pressure_pa, wish, steps_s, gain, -lacking)
        wanted = [[*arm.pose(point.q, arm.length)[:3, 3], *point.q] for point in points]
        of_place = np.concatenate([np.full(3, 1e3), options.coordinate_mm / force.scales.q])
        weight = np.sqrt(steps_s / options.step_s)[:, None] * of_place
        plan, flag = best_wish(
            course, course.place - wanted, weight, options.change_mm, wish, steps_s, supply
        )
        if flag < 1:
            raise ModelError(f"the quadratic program ends with {flag} of daqp")
        return plan


def _later(plan: Array, steps_s: Array) -> Array:
    """Return a plan as it is a tick, its first step, later."""
    part = (steps_s[0] / steps_s[1:])[:, None]
    return np.vstack([plan[1:2], (1.0 - part) * plan[1:] + part * np.vstack([plan[2:], plan[-1:]])])
