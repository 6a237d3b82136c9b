"""The law `tip_pid`: the model's static force at the reference, and PID on the position of the tip.

f = G(q_d) + f_e(q_d) - J' K_t (k_p e + k_i integral of e + k_d e'), e the low-passed error of the tip's
position and K_t = (J K^-1 J')^-1 the arm's own stiffness at the tip, so that k_p has no unit. It is the
baseline that a user would write. It suits slow references, hanging arms and fast regulators; where it loses
the arm, it is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from soro_core.arrays import Array
from soro_core.control.laws.protocol import ArmBelief, Law, LawOptions, Preview, Setting, Terms
from soro_core.linear import inverse


class TipPidOptions(LawOptions):
    """Keys of the law."""

    k_p: float = Field(0.5, ge=0, le=100, description="part of the arm's stiffness at the tip")
    k_i_per_s: float = Field(1.4, ge=0, le=100, description="the same of the integral [1/s]")
    k_d_s: float = Field(0.02, ge=0, le=10, description="the same of the rate [s]")
    filter_per_s: float = Field(80.0, gt=0, le=1e3, description="low-pass of the error [rad/s]")
    load_kg: float = Field(0.02, ge=0, le=10, description="largest load with which the arm must be kept")


@dataclass(frozen=True)
class TipState:
    """Integral (3,) [m s] and low-passed error (3,) [m] of the tip, in the world frame."""

    integral: Array
    error: Array


class TipPid(Law[TipState]):
    """PID on the position of the tip."""

    Options = TipPidOptions

    def __init__(self, setting: Setting, options: LawOptions) -> None:
        assert isinstance(options, TipPidOptions)
        self.setting, self.options = setting, options
        # One value a coordinate: its own stiffness where the arm is straight.
        self.compliance = inverse(setting.arm.stiffness_matrix(np.zeros(setting.arm.n_q)))

    def heaviest_kg(self) -> float:
        """Return the load of the options [kg]."""
        return self.options.load_kg

    def trial_loads_kg(self) -> tuple[float, ...]:
        """Return the loads with which the arm must be kept [kg]."""
        return tuple(sorted({0.0, self.options.load_kg}))

    def initial_state(self) -> TipState:
        """Return an empty integral."""
        return TipState(np.zeros(3), np.zeros(3))

    def step(
        self, state: TipState, belief: ArmBelief, reference: Preview, dt: float
    ) -> tuple[TipState, Array, Terms]:
        """Return state, force and terms; parameters as in `Law.step`."""
        arm, gains, wanted = self.setting.arm, self.options, reference.ahead
        model = np.asarray(arm.gravity_force(wanted.q) + arm.elastic_force(wanted.q))
        tip, jacobian = self._tip(reference.now.q)
        rate = -math.expm1(-gains.filter_per_s * dt) / dt * (self._tip(belief.q)[0] - tip - state.error)
        error = state.error + dt * rate
        push = gains.k_p * error + gains.k_i_per_s * state.integral + gains.k_d_s * rate
        feedback = -(self._stiffness(jacobian) @ push)
        # What saturated chambers cannot make would wind the integral up.
        integral = state.integral if belief.saturated.any() else state.integral + dt * error
        return TipState(integral, error), model + feedback, {"model": model, "feedback": feedback}

    def _tip(self, q: Array) -> tuple[Array, Array]:
        """Return position (3,) [m] and its derivative (3, n_q) in the world frame."""
        arm = self.setting.arm
        pose, jacobian = arm.pose_and_jacobian(q, arm.length)
        return pose[:3, 3], pose[:3, :3] @ jacobian[3:]

    def _stiffness(self, jacobian: Array) -> Array:
        """Return J' K_t (n_q, 3)."""
        soft = jacobian @ self.compliance @ jacobian.T
        # A straight arm without elongation cannot move its tip along itself.
        soft += 1e-9 * np.trace(soft) * np.eye(3)
        return np.asarray(np.linalg.solve(soft, jacobian).T)
