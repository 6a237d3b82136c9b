"""The law `counterbalance`: bears the weight of a hinged limb, and answers nothing that its wearer does.

The angle of the limb comes from an encoder (`controller.joint`), because a filter knows a free arm and not
the limb. The reference is not followed: who wears the limb says where it goes. ADR 0094.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from soro_core.arrays import Array
from soro_core.bodies.body import Hinge
from soro_core.bodies.counterbalance import (
    Counterbalance,
    CounterbalanceSettings,
    CounterbalanceState,
    limb_moments,
)
from soro_core.control.laws.protocol import ArmBelief, Law, LawOptions, Preview, Setting, Terms
from soro_core.errors import ConfigError, ModelError

# Angles of the table of moments where the hinge has no limits [rad], and their number.
_ANGLES_RAD, _ANGLES = (-0.8, 0.8), 33
# Time constant of the rate of the limb: a difference of angles has the noise of the encoder [s].
_RATE_S = 0.01


class CounterbalanceOptions(LawOptions):
    """Keys of the law."""

    hinge: Hinge | None = Field(
        None, description="of the limb; needed. The arm is straight at angle 0, and holds the limb at its tip"
    )
    level_rad: float = Field(0.0, description="angle at which the limb is level")
    weighing: CounterbalanceSettings = Field(
        CounterbalanceSettings(), description="how the limb is held while its weight is learned"
    )


@dataclass(frozen=True)
class LimbState:
    """What the law knows of the limb, its last angle [rad], None before the first, and its rate [rad/s]."""

    limb: CounterbalanceState
    angle_rad: float | None = None
    rate_rad_s: float = 0.0


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
        """Return state, force and terms; parameters as in `Law.step`. Without an angle the force is zero."""
        if (angle := belief.joint_rad) is None:
            return state, np.zeros_like(belief.q), {}
        rate = state.rate_rad_s
        if state.angle_rad is not None:
            rate += ((angle - state.angle_rad) / dt - rate) * dt / (_RATE_S + dt)
        limb, setpoint = self.limb.step(
            state.limb, angle + reference.ahead_s * rate, rate, float(belief.pressure_pa[0]), dt
        )
        # H at the same place as the allocation has it, which gives the set point back.
        actuation = self.setting.arm.actuation_matrix(self.place(belief, reference))
        force = actuation[:, 0] * setpoint
        return LimbState(limb, angle, rate), force, {"model": force}

    def estimates(self, state: LimbState) -> dict[str, float]:
        """Return the learned moment of the limb's weight where it is level [N m]."""
        return {"limb_moment": state.limb.weight}

    def note(self, state: LimbState) -> str:
        """Return that the limb is being weighed."""
        return "weighing the limb: relax" if state.limb.t_s < self.weighing.weigh_s else ""
