"""The law `counterbalance`: bears the weight of a hinged limb, and answers nothing that its wearer does.

The angle of the limb comes from an encoder (`controller.joint`), because a filter knows a free arm and not
the limb. The reference is not followed: who wears the limb says where it goes. ADR 0094.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from soro_core.arrays import Array
from soro_core.bodies.body import HingeAxis
from soro_core.bodies.counterbalance import (
    Counterbalance,
    CounterbalanceSettings,
    CounterbalanceState,
    limb_moments,
)
from soro_core.control.laws.protocol import (
    ArmBelief,
    Law,
    LawOptions,
    MeasuredJoint,
    Preview,
    Setting,
    Terms,
)
from soro_core.errors import ConfigError, ModelError

# Angles of the table of moments where the hinge has no limits [rad], and their number.
_ANGLES_RAD, _ANGLES = (-0.8, 0.8), 33
# Time constant of the rate of the limb: a difference of angles has the noise of the encoder [s].
_RATE_S = 0.01


class CounterbalanceOptions(LawOptions):
    """Keys of the law."""

    hinge: HingeAxis | None = Field(
        None,
        description="of the limb; needed. The arm is straight at angle 0, and holds the limb at its tip; "
        "limits_rad: the angles that the law is for, -0.8 to 0.8 where it states none",
    )
    level_rad: float = Field(0.0, description="angle at which the limb is level")
    weighing: CounterbalanceSettings = Field(
        CounterbalanceSettings(), description="how the limb is held while its weight is learned"
    )


@dataclass(frozen=True)
class LimbState:
    """What the law knows of the limb.

    Attributes
    ----------
    limb : CounterbalanceState
    joint : MeasuredJoint or None
        The last one; None before the first.
    rate_rad_s : float
        Rate of the limb [rad/s].
    at_bound : bool
        Whether the last set point was at a bound.
    refusal : str
        Why there are no more commands; empty while there are.
    """

    limb: CounterbalanceState
    joint: MeasuredJoint | None = None
    rate_rad_s: float = 0.0
    at_bound: bool = False
    refusal: str = ""


class CounterbalanceLaw(Law[LimbState]):
    """Weighs a limb, and bears it then; without feedback."""

    Options = CounterbalanceOptions

    def __init__(self, setting: Setting, options: LawOptions) -> None:
        assert isinstance(options, CounterbalanceOptions)
        if (hinge := options.hinge) is None:
            allowed = "point and axis of the joint of the limb"
            raise ConfigError("controller", "law_options.hinge", "nothing", allowed)
        if not setting.config.joint:
            allowed = "the topic of the angle of the limb: law counterbalance needs it"
            raise ConfigError("controller", "joint", "nothing", allowed)
        self.setting, self.weighing = setting, options.weighing
        known = setting.pressures
        try:
            moments = limb_moments(
                setting.arm, hinge, np.linspace(*(hinge.limits_rad or _ANGLES_RAD), _ANGLES)
            )
            self.limb = Counterbalance(
                moments, (known.minimum_pa, known.maximum_pa), options.level_rad, options.weighing
            )
        except ModelError as error:
            allowed = "an arm that law counterbalance can use: the one chamber of a muscle on a limb"
            raise ConfigError("controller", "law_options.hinge", str(error), allowed) from None

    def initial_state(self) -> LimbState:
        """Return the state before the first tick."""
        return LimbState(CounterbalanceState())

    def step(
        self, state: LimbState, belief: ArmBelief, reference: Preview, dt: float
    ) -> tuple[LimbState, Array, Terms]:
        """Return state, force and terms; parameters as in `Law.step`.

        Once the law has refused, it asks for the least pressure, and then for nothing until it begins anew.
        """
        if state.refusal:
            raise ModelError(state.refusal, "limb")
        if (joint := belief.joint) is None:  # of a trial before anything moves; nodes have one at each tick
            return state, np.zeros_like(belief.q), {}
        is_weighed = state.limb.t_s >= self.weighing.weigh_s
        if not (belief.is_measured or is_weighed):
            raise ModelError("counterbalance: the pressure is not measured while the limb is weighed", "limb")
        rate, last = state.rate_rad_s, state.joint
        if last is not None and (passed_s := joint.t_s - last.t_s) > 0.0:
            rate += ((joint.angle_rad - last.angle_rad) / passed_s - rate) * passed_s / (_RATE_S + passed_s)
        ahead_s = joint.age_s + reference.ahead_s
        known, (low, high) = (joint.angle_rad, rate, float(belief.pressure_pa[0])), self.limb.range_pa
        try:
            limb, setpoint = self.limb.step(state.limb, *known, dt, ahead_s)
            state = LimbState(limb, joint, rate, setpoint in (low, high))
        except ModelError as error:
            state, setpoint = replace(state, refusal=str(error)), low
        # H at the same place as the allocation has it, which gives the set point back.
        actuation = self.setting.arm.actuation_matrix(self.place(belief, reference))
        force = actuation[:, 0] * setpoint
        return state, force, {"model": force}

    def estimates(self, state: LimbState) -> dict[str, float]:
        """Return the learned moment of the limb's weight where it is level [N m]."""
        return {"limb_moment": state.limb.weight}

    def note(self, state: LimbState) -> str:
        """Return that the limb is being weighed, or takes more than the pressures bear."""
        if state.refusal:
            return state.refusal
        if state.limb.t_s < self.weighing.weigh_s:
            return "weighing the limb: relax"
        return "the limb is not borne whole: the set point is at a bound" if state.at_bound else ""
