"""The law `energy_shaping`: a set point as the minimum of a shaped energy, in port-Hamiltonian form.

With the momenta m = M(q) qd and the energy E = qd' M qd / 2 + U(q), the arm is the port-Hamiltonian system

    qd = dE/dm,   md = -dE/dq - R dE/dm + H(q) p,   y = H(q)' qd = dV/dt,

V the volumes of the chambers: H is their gradient. The port is pressure and rate of volume. The law adds an
energy of the volumes alone, and damping at the port,

    p = p_d - K (V - V_d) - D dV/dt,

so that the loop is the same system with E_d = E - p_d' V + (V - V_d)' K (V - V_d) / 2 and R + H D H'. All of
its forces are H times pressures, whatever the number of coordinates: no matching equation is left over, and
no pseudo-inverse of H drops a part. q_d is a rest of E_d where dU/dq(q_d) = H p_d. Where chambers do not move
all coordinates, the controller therefore gives a reference that can rest, as to all laws that learn. It is a
minimum where the Hessian of E_d is positive definite, which is checked at each new set point.

Nothing of U is cancelled, as feedback of dU/dq at the measured state would: the energy argument knows neither
lag nor dead time, and the arm's own stiffness and damping keep their margin. U has the load as `composite`
learns it, and the filter is told; that estimates move is beside the argument, too. On a slow reference p_d
has what its motion takes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from soro_core.arrays import Array
from soro_core.control.laws import ArmBelief, Composite, Preview, Setting, Terms
from soro_core.control.laws.composite import CompositeOptions, CompositeState

# Parts of the limits: largest rate of a reference that rests [1/s], and least change to another set point.
_RATE, _OTHER = 1e-6, 1e-3
# Step of difference quotients, part of the limit.
_STEP = 1e-6


class EnergyShapingOptions(CompositeOptions):
    """Keys of the law: those of the learner of `composite`, K and D."""

    stiffness: float = Field(0.1, ge=0, le=100, description="K, part of the stiffness that the chambers feel")
    damping_s: float = Field(0.003, ge=0, le=10, description="D, the same stiffness times a time [s]")


@dataclass(frozen=True)
class ShapedState(CompositeState):
    """State of the law: what is learned, the set point (n_q,) that was checked, and what was found there."""

    set_point: Array | None = None
    finding: str = ""


class EnergyShaping(Composite):
    """Set points and slow references by a shaped energy and injected damping."""

    Options = EnergyShapingOptions

    def __init__(self, setting: Setting, options: EnergyShapingOptions) -> None:
        super().__init__(setting, options)
        self.options = options

    def initial_state(self) -> ShapedState:
        """Return the state with nothing learned."""
        return ShapedState(**vars(super().initial_state()))

    def step(
        self, state: ShapedState, belief: ArmBelief, reference: Preview, dt: float
    ) -> tuple[ShapedState, Array, Terms]:
        """Return state, force and terms; parameters as in `Law.step`."""
        found, _, known = super().step(state, belief, reference, dt)
        arm, wanted = self.setting.arm, reference.ahead
        q, qd = self.setting.moved(belief, reference)
        H = arm.actuation_matrix(wanted.q)
        # As large as the arm's own, as the chambers feel it: (H' U''^-1 H)^-1 [Pa/m^3].
        soft = H.T @ np.linalg.solve(arm.stiffness_matrix(wanted.q), H)
        own = H @ np.linalg.pinv(soft, rcond=1e-9, hermitian=True)
        volume = arm.displaced_volume(q) - arm.displaced_volume(wanted.q)
        rate = arm.actuation_matrix(q).T @ qd - H.T @ wanted.qd
        terms = {
            "potential": known["model"] + known["internal"] + known["learnt"] + known["uneven"],
            "shaping": -self.options.stiffness * (own @ volume),
            "damping": -self.options.damping_s * (own @ rate),
        }
        seen = self._checked(state, found, wanted.q, wanted.qd, terms["potential"], own @ H.T)
        return ShapedState(**vars(found), **seen), sum(terms.values()), terms

    def note(self, state: ShapedState) -> str:
        """Return that the set point is no minimum, or what the learner says."""
        return state.finding or super().note(state)

    def _checked(
        self, state: ShapedState, found: CompositeState, q: Array, qd: Array, force: Array, own: Array
    ) -> dict[str, object]:
        """Return the set point checked last and the finding there, anew for one that rests elsewhere."""
        arm, limit, mass_kg = self.setting.arm, self.setting.limit, found.learner.learned.mass_kg
        if (np.abs(qd) > _RATE * limit).any():
            return {"set_point": None, "finding": ""}
        if state.set_point is not None and (np.abs(q - state.set_point) < _OTHER * limit).all():
            return {"set_point": state.set_point, "finding": state.finding}
        pressure, rest = np.linalg.lstsq(arm.actuation_matrix(q), force, rcond=1e-9)[0], np.zeros_like(q)

        def slope(at: Array) -> Array:
            """Return dE_d/dq without K, whose part of the Hessian is known."""
            weight = arm.gravity_force(at) + mass_kg * arm.tip_mass_force(at, rest, rest)
            return np.asarray(weight + arm.elastic_force(at) - arm.actuation_matrix(at) @ pressure)

        steps = _STEP * limit
        hessian = np.array([(slope(q + h) - slope(q - h)) / (2.0 * h.sum()) for h in np.diag(steps)])
        hessian += self.options.stiffness * own
        least = np.linalg.eigvalsh(0.5 * (hessian + hessian.T) * np.outer(limit, limit)).min()
        text = "the set point is no minimum of the shaped energy; allowed: a larger law_options.stiffness"
        return {"set_point": q, "finding": "" if least > 0.0 else text}
