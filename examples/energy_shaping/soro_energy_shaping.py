"""The law `energy_shaping`: a set point as the minimum of a shaped energy, in port-Hamiltonian form.

With the momenta M(q) qd and the energy E = qd' M qd / 2 + U(q), the arm is the port-Hamiltonian system

    q' = dE/dmom,   mom' = -dE/dq - R dE/dmom + H(q) p,   y = H(q)' qd = V'(q),

V the volumes of the chambers, since H = (dV/dq)'. Its port is pressure and rate of volume. The law adds an
energy of the volumes alone, and damping at the port:

    p = p_d - K (V - V_d) - D V'

and the closed loop is the same system with E_d = qd' M qd / 2 + U - p_d' V + (V - V_d)' K (V - V_d) / 2 and
R + H D H'. A pressure for each of its forces exists, whatever the number of coordinates: no matching equation
is left over, and no pseudo-inverse drops a part of the force. q_d is a rest of E_d where dU/dq(q_d) = H p_d,
so that on arms with more coordinates than chambers the reference is first put where it can rest
(`balances_reference`); it is a minimum where the Hessian of E_d is positive definite, which is checked at
each new set point. Nothing of U is cancelled: the arm's own stiffness stays in the loop, and 30 ms of lag,
which this energy argument does not know, take away less of the margin than a cancelled stiffness would.

An integral of V - V_d takes out a constant load. It is beside the argument: small, and held while a chamber
is at a bound. K and D are parts of the arm's stiffness as the chambers feel it, (H' U''^-1 H)^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from soro_core.arrays import Array
from soro_core.control.laws import ArmBelief, Law, LawOptions, Preview, Setting, Terms

# A reference with rates below this part of its limits a second rests.
_AT_REST = 1e-6
# Step of the difference quotients, part of the limits.
_STEP = 1e-6


class EnergyShapingOptions(LawOptions):
    """Keys of the law."""

    k_p: float = Field(
        0.1, ge=0, le=100, description="K, part of the arm's stiffness as the chambers feel it"
    )
    k_d_s: float = Field(0.01, ge=0, le=10, description="D, the same times a time [s]")
    k_i_per_s: float = Field(1.0, ge=0, le=100, description="of the integral, the same by a time [1/s]")


@dataclass(frozen=True)
class ShapedState:
    """State of the law.

    Attributes
    ----------
    integral : ndarray (n_u,)
        Of V - V_d [m^3 s].
    set_point : ndarray (n_q,) or None
        The set point that was checked last.
    note : str
        What was found there.
    """

    integral: Array
    set_point: Array | None = None
    note: str = ""


class EnergyShaping(Law[ShapedState]):
    """Set points, and slow references, by a shaped energy and injected damping."""

    Options = EnergyShapingOptions
    balances_reference = True
    observes_regulators = True

    def __init__(self, setting: Setting, options: EnergyShapingOptions) -> None:
        self.arm, self.options = setting.arm, options

    def initial_state(self) -> ShapedState:
        """Return an empty integral."""
        return ShapedState(np.zeros(self.arm.n_u))

    def step(
        self, state: ShapedState, belief: ArmBelief, reference: Preview, dt: float
    ) -> tuple[ShapedState, Array, Terms]:
        """Return state, force and terms; parameters as in `Law.step`."""
        arm, gains, wanted = self.arm, self.options, reference.ahead
        q, qd = self.setting.moved(belief, reference)
        H = arm.actuation_matrix(wanted.q)
        stiffness = self._felt(wanted.q, H)
        volume = arm.displaced_volume(q) - arm.displaced_volume(wanted.q)
        rate = arm.actuation_matrix(q).T @ qd - H.T @ wanted.qd
        # dU/dq at the set point; on a slow reference also what its motion takes.
        model = self.setting.model_force(wanted.q, wanted.qd, wanted.qdd)
        model = model + arm.internal_force(wanted.q, belief.creep)
        terms = {
            "potential": model,
            "shaping": -gains.k_p * (H @ stiffness @ volume),
            "damping": -gains.k_d_s * (H @ stiffness @ rate),
            "integral": -gains.k_i_per_s * (H @ stiffness @ state.integral),
        }
        integral = state.integral if belief.saturated.any() else state.integral + dt * volume
        set_point, note = self._checked(state, wanted.q, wanted.qd, H, stiffness, model)
        return ShapedState(integral, set_point, note), sum(terms.values()), terms

    def note(self, state: ShapedState) -> str:
        """Return whether the set point is no minimum."""
        return state.note

    def _felt(self, q: Array, actuation: Array) -> Array:
        """Return the stiffness (n_u, n_u) [Pa/m^3] that the chambers feel of the arm at q."""
        soft = actuation.T @ np.linalg.solve(self.arm.stiffness_matrix(q), actuation)
        return np.asarray(np.linalg.pinv(soft, rcond=1e-9, hermitian=True))

    def _checked(
        self, state: ShapedState, q: Array, qd: Array, actuation: Array, stiffness: Array, force: Array
    ) -> tuple[Array | None, str]:
        """Return the set point checked last, and what was found: a new one is checked where it rests."""
        limit = self.setting.limit
        if (np.abs(qd) > _AT_REST * limit).any():
            return None, ""
        if state.set_point is not None and np.allclose(q, state.set_point, atol=1e-3 * limit.max(), rtol=0):
            return state.set_point, state.note
        arm, pressure = self.arm, np.linalg.lstsq(actuation, force, rcond=1e-9)[0]

        def slope(at: Array) -> Array:
            """dE_d/dq without K, whose part of the Hessian is known."""
            return np.asarray(
                arm.gravity_force(at) + arm.elastic_force(at) - arm.actuation_matrix(at) @ pressure
            )

        steps = _STEP * np.diag(limit)
        hessian = np.array([(slope(q + h) - slope(q - h)) / (2 * h.sum()) for h in steps])
        hessian += self.options.k_p * actuation @ stiffness @ actuation.T
        least = np.linalg.eigvalsh(0.5 * (hessian + hessian.T) * np.outer(limit, limit)).min()
        text = (
            "the set point is no minimum of the shaped energy: a larger law_options.k_p, or another set point"
        )
        return q, "" if least > 0.0 else text
