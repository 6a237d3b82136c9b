"""The loop of the force at the tip, around any law: hybrid control of force and position.

A tip that presses moves along its direction d at the approach speed until it touches something. From then on
its reference along d is the tip itself, with its speed, so that the law holds it there without force, and the
push

    J' d (f + z),        dz/dt = rate_per_s (f delayed - F),

is added to the force that the law asks for: f goes from the force at the touch to the goal, and F is the
estimated force. Across d the reference stays. (Raibert and Craig, Hybrid position/force control of
manipulators, 1981; the integral as in Siciliano and Villani, Robot Force Control, 1999.)

The cap does the same to any other reference: while the force is near it, the reference along the force is the
tip, and f is what the way of the reference into the wall would make by the stiffness of the tip, or the cap.
"""

from __future__ import annotations

import copy

import numpy as np

from soro_core.adaptation.external_force import ExternalForce
from soro_core.arrays import Array
from soro_core.control.force.cap import capped
from soro_core.control.force.force_state import ForceLoopState
from soro_core.control.force.press import Press
from soro_core.control.force.pressing import asked, pressed
from soro_core.control.force.pushed_tip import PushedTip
from soro_core.control.force.tip_stiffness import StiffnessAtTip
from soro_core.control.force.tracked_tip import Track, tracked
from soro_core.control.motion_config import ForceControlConfig
from soro_core.control.reference.active_reference import ActiveReference
from soro_core.control.reference.trajectory import Point
from soro_core.frozen import replaced
from soro_core.model import SoftArm
from soro_core.robot.coordinates import StrainFields

# Longest time without an estimate for which reference and push stay as they are [s].
_GAP_S = 0.25


class ForceLoop:
    """Moves references of one arm, and pushes.

    Parameters
    ----------
    arm : SoftArm
        Discretised model.
    fields : StrainFields
        Its strains.
    k_p : ndarray (n_q, n_q)
        Feedback of the law.
    limit : ndarray (n_q,)
        Largest absolute strain of a reference.
    config : ForceControlConfig
    """

    def __init__(
        self, arm: SoftArm, fields: StrainFields, k_p: Array, limit: Array, config: ForceControlConfig
    ) -> None:
        self.arm, self.fields, self.limit, self.config = arm, fields, limit, config
        self.stiffness = StiffnessAtTip(arm)
        self._push = PushedTip(self.stiffness, config, k_p)
        # A short step of strains, as inverse kinematics weighs them.
        self._inverse_weight = limit[:, None] * np.linalg.inv(fields.weight) * limit

    def retuned(self, k_p: Array, config: ForceControlConfig) -> ForceLoop:
        """Return the loop of the same arm with other keys."""
        other = copy.copy(self)
        other.config, other._push = config, PushedTip(self.stiffness, config, k_p)
        return other

    def initial_state(self) -> ForceLoopState:
        """Return the state before the first tick."""
        none = np.zeros(self.arm.n_q)
        return ForceLoopState(none, none)

    def step(
        self,
        state: ForceLoopState,
        following: ActiveReference,
        point: Point,
        seen: tuple[Array, Array, Array],
        felt: ExternalForce | None,
        dt: float,
    ) -> ForceLoopState:
        """Return the state after a tick.

        Parameters
        ----------
        state : ForceLoopState
        following : ActiveReference
            The reference to follow.
        point : Point
            The reference in force, not moved.
        seen : ndarray (n_q,), (n_q,) and (n_u,)
            Estimated coordinates and rates, and measured pressures [Pa gauge].
        felt : ExternalForce or None
            Estimated force on the arm at the tip; None where it is not estimated.
        dt : float
            Time since the last tick [s].
        """
        if felt is None and state.felt is not None and state.gap_s < _GAP_S:
            still = np.zeros_like(point.q)
            return replaced(state, gap_s=state.gap_s + dt, rate=np.zeros(3), shift_rate=still)
        state = replaced(state, felt=felt, gap_s=0.0, pressure_pa=seen[2])
        is_asked = state.press or self.config.cap_n or self.config.stiffness_factor
        moves = is_asked or any(state.moved.tolist()) or state.wanted_n
        if not moves and not isinstance(following.wanted, Press):
            return state if state.tracked is None else replaced(state, tracked=None)
        state = asked(state, following.wanted, following.given, dt)
        press = state.press
        measured = None if state.felt is None else state.felt.tip
        believed, touches = Track(*self._tip(*seen[:2])[:2]), state.phase == "contact"
        state = replaced(state, tracked=tracked(state.tracked, believed, measured, touches, dt))
        tip, speed, _ = self._tip(point.q, point.qd)
        if press is None:
            state = capped(self._push, state, point, tip, speed, dt)
        else:
            state = pressed(self._push, state, press, tip, dt)
        return self._shifted(state, point.q, tip)

    def moved_point(self, state: ForceLoopState, point: Point, time_s: float) -> Point:
        """Return a reference with the tip moved.

        Parameters
        ----------
        state : ForceLoopState
        point : Point
            The reference in force at that time.
        time_s : float
            Time after now [s].
        """
        if not any(state.shift.tolist()):
            return point
        shift = state.shift + time_s * state.shift_rate
        return Point(point.q + shift, point.qd + state.shift_rate, point.qdd)

    @staticmethod
    def note(state: ForceLoopState) -> str:
        """Return what the user must know."""
        if state.is_unfelt:
            what = "the tip is stopped" if state.phase == "stopped" else "nothing keeps it below the cap"
            return f"no estimate of the force: {what}"
        if state.phase == "stopped":
            where = state.beyond or f"within {state.approach_s:.1f} s"
            return f"no contact {where}: the tip is stopped"
        if state.yields is not None and not state.yields[0].any():
            return "stiffness_factor does nothing: without feedback the arm falls, and has no stiffness"
        return state.refusal

    def told(self, state: ForceLoopState) -> ExternalForce | None:
        """Return the estimated force as the law is told: what a tip presses on, or approaches, is no load."""
        if state.felt is None or state.phase not in ("approach", "contact"):
            return state.felt
        return replaced(state.felt, stage="contact", mass_free=False)

    def push(self, state: ForceLoopState, q: Array) -> Array:
        """Return the generalised force (n_q,) of the push at coordinates (n_q,)."""
        if not state.wanted_n:
            return np.zeros(q.shape)
        _, _, slope = self._tip(q, q)
        return np.asarray(slope.T @ state.push_n)

    def relieved(self, state: ForceLoopState, missing_pa: Array, dt: float) -> ForceLoopState:
        """Return the state after the pressures are known; parameters as in `PushedTip.relieved`."""
        if state.phase == "approach":
            return replaced(state, missing_pa=missing_pa if missing_pa.any() else None)
        if state.phase != "contact" or not missing_pa.any():
            return state
        return self._push.relieved(state, missing_pa, dt)

    def _tip(self, q: Array, qd: Array) -> tuple[Array, Array, Array]:
        """Return position and velocity of the tip (3,), and the slope (3, n_q), in the world."""
        pose, jacobian = self.arm.pose_and_jacobian(q, self.arm.length)
        slope = pose[:3, :3] @ jacobian[3:]
        return pose[:3, 3], slope @ qd, slope

    def _shifted(self, state: ForceLoopState, q: Array, tip: Array) -> ForceLoopState:
        """Return the state with coordinates that move the tip of a reference: one step of Newton."""
        if not state.moved.any():
            none = np.zeros_like(q)
            return replaced(state, shift=none, shift_rate=none)
        there, _, slope = self._tip(q + state.shift, q)
        weighted = self._inverse_weight @ slope.T
        square = slope @ weighted
        square = square + 1e-9 * np.trace(square) * np.eye(3)
        inverse = weighted @ np.linalg.inv(square)
        shift = inverse @ (tip + state.moved - there + slope @ state.shift)
        inside = self.fields.within(q + shift, self.limit) - q
        if not np.array_equal(inside, shift):  # what strains cannot follow must not grow
            state = replaced(state, moved=self._tip(q + inside, q)[0] - tip)
        return replaced(state, shift=inside, shift_rate=inverse @ state.rate)
