"""The law `computed_torque`: the model's forces at the measured state, and a linear error beside them.

f = M (qdd_d - 2 zeta w e' - w^2 e) + C qd + G + f_e + R qd + (creep), with e = q - q_d. It cancels the
stiffness of the arm and puts w^2 in its place, so it needs pressures that act at once or an arm that hangs
and moves slowly; where the lag of the regulators loses the arm, it is refused.
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from soro_core.arrays import Array
from soro_core.control.laws.protocol import ArmBelief, Law, LawOptions, Preview, Setting, Terms


class ComputedTorqueOptions(LawOptions):
    """Keys of the law."""

    frequency_hz: float = Field(6.0, gt=0, le=100, description="natural frequency of the error")
    damping_ratio: float = Field(1.0, gt=0, le=10, description="damping ratio of the error")
    load_kg: float = Field(0.02, ge=0, le=10, description="largest load with which the arm must be kept")


class ComputedTorque(Law[Array]):
    """Linearising feedback; its state is the creep along the reference."""

    Options = ComputedTorqueOptions

    def __init__(self, setting: Setting, options: LawOptions) -> None:
        assert isinstance(options, ComputedTorqueOptions)
        self.setting = setting
        w = 2.0 * math.pi * options.frequency_hz
        self.stiffness, self.damping = w * w, 2.0 * options.damping_ratio * w
        self.load_kg = options.load_kg

    def heaviest_kg(self) -> float:
        """Return the load of the options [kg]."""
        return self.load_kg

    def trial_loads_kg(self) -> tuple[float, ...]:
        """Return the loads with which the arm must be kept [kg]."""
        return tuple(sorted({0.0, self.load_kg}))

    def initial_state(self) -> Array:
        """Return the states of creep at rest."""
        return np.zeros(self.setting.arm.n_internal)

    def step(
        self, state: Array, belief: ArmBelief, reference: Preview, dt: float
    ) -> tuple[Array, Array, Terms]:
        """Return state, force and terms; parameters as in `Law.step`."""
        arm, wanted = self.setting.arm, reference.ahead
        q, qd = self.setting.moved(belief, reference)
        error, rate = q - wanted.q, qd - wanted.qd
        linear = -self.stiffness * error - self.damping * rate
        feedback = arm.inertia_matrix(q) @ linear
        model = self.setting.model_force(q, qd, wanted.qdd) + arm.internal_force(q, state)
        after = arm.internal_midpoint(wanted.q, wanted.qd, state, dt)
        return after, model + feedback, {"error": error, "model": model, "feedback": feedback}

    def place(self, belief: ArmBelief, reference: Preview) -> Array:
        """Return the measured state: what is cancelled there is made there."""
        return self.setting.moved(belief, reference)[0]
