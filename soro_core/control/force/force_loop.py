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

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from soro_core.adaptation.external_force import ExternalForce
from soro_core.arrays import Array
from soro_core.control.force.press import Press, likely_force
from soro_core.control.force.tip_stiffness import StiffnessAtTip
from soro_core.control.motion_config import ForceControlConfig
from soro_core.control.reference.trajectory import Point, Reference
from soro_core.frozen import replaced
from soro_core.model import SoftArm
from soro_core.robot.coordinates import StrainFields

# Part of the goal from which on the tip touches something, at most so much [N]; and the part of this force
# below which it has left.
_TOUCH, _MOST_TOUCH_N, _LEAVES = 0.3, 0.015, 0.3
# How far the reference of an approach may be ahead of the tip [m]: out of reach the tip does not follow.
_MOST_AHEAD_M = 0.006
# Part of the cap from which on the force is bounded, and the most by which the loop stays below it.
_NEAR, _MOST_BELOW = 0.5, 0.2
# Deviations of an estimated force from which on it is one.
_SURE = 3.0
# Time constants [s]: of the tracked tip; of the push towards its goal; of the answer of arm and estimate.
_TRACK_S, _PUSH_S, _ANSWER_S = 0.5, 0.12, 0.2
# Rate at which a pressure beyond its range moves the tip so that it is not [1/s].
_RELIEF_PER_S = 3.0
# Largest part of the goal that the integral adds.
_MOST_ADDED = 0.5
Phase = Literal["", "approach", "contact", "stopped"]


@dataclass(frozen=True)
class ForceLoopState:
    """State of the loop of the force.

    Attributes
    ----------
    press : Press or None
        The press under way.
    phase : str
        Of the press; "stopped" for one that has met nothing. Without a press "contact" while the cap acts.
    approach_s : float
        Time of the approach [s].
    is_beyond, is_unfelt : bool
        Whether a press has stopped because the tip could not follow; whether a press or a cap is without an
        estimate of the force.
    refusal : str
        Why the configured press is refused; empty if it is not.
    tip, speed : ndarray (3,)
        Tracked position and velocity of the tip [m, m/s].
    moved, rate : ndarray (3,)
        How far the reference of the tip is moved [m], and its velocity [m/s], in the world.
    shift, shift_rate : ndarray (n_q,)
        The same in coordinates.
    toward : ndarray (3,)
        Direction of the push.
    by_common : ndarray (3, n_links)
        How far a common pressure of each link moves the tip [m/Pa].
    scale : float
        What makes of a push at the tip of uniform links the same of ones that it bends non-uniformly.
    wanted_n, answer_n, added_n : float
        f, f as the estimate is to show it, and z [N].
    felt : ExternalForce or None
        Estimated force on the arm; None where it is not estimated.
    """

    press: Press | None
    phase: Phase
    approach_s: float
    tip: Array | None
    speed: Array
    moved: Array
    rate: Array
    shift: Array
    shift_rate: Array
    toward: Array
    by_common: Array
    scale: float = 1.0
    wanted_n: float = 0.0
    answer_n: float = 0.0
    added_n: float = 0.0
    felt: ExternalForce | None = None
    is_beyond: bool = False
    is_unfelt: bool = False
    refusal: str = ""

    @property
    def push_n(self) -> Array:
        """Force that is added at the tip of uniform links, (3,) [N]."""
        return np.asarray(self.scale * (self.wanted_n + self.added_n) * self.toward)

    @property
    def note(self) -> str:
        """What the user must know."""
        if self.is_unfelt:
            what = "the tip is stopped" if self.phase == "stopped" else "nothing keeps it below the cap"
            return f"no estimate of the force: {what}"
        if self.phase != "stopped":
            return self.refusal
        where = "where the tip follows" if self.is_beyond else f"within {self.approach_s:.1f} s"
        return f"no contact {where}: the tip is stopped"


class _Contact(NamedTuple):
    """Direction of a push, and force along it: wanted and estimated [N]."""

    toward: Array
    goal: float
    force: float


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
        self.arm, self.fields, self.k_p, self.limit, self.config = arm, fields, k_p, limit, config
        self.stiffness = StiffnessAtTip(arm)
        # A short step of strains, as inverse kinematics weighs them.
        self._inverse_weight = limit[:, None] * np.linalg.inv(fields.weight) * limit

    def initial_state(self) -> ForceLoopState:
        """Return the state before the first tick."""
        zero, none = np.zeros(3), np.zeros(self.arm.n_q)
        return ForceLoopState(None, "", 0.0, None, zero, zero, zero, none, none, zero, np.zeros((3, 0)))

    def step(
        self,
        state: ForceLoopState,
        wanted: Reference,
        point: Point,
        seen: tuple[Array, Array],
        felt: ExternalForce | None,
        dt: float,
    ) -> ForceLoopState:
        """Return the state after a tick.

        Parameters
        ----------
        state : ForceLoopState
        wanted : Reference
            The reference to follow.
        point : Point
            The reference in force, not moved.
        seen : pair of ndarray (n_q,)
            Estimated coordinates and rates.
        felt : ExternalForce or None
            Estimated force on the arm at the tip; None where it is not estimated.
        dt : float
            Time since the last tick [s].
        """
        state = replaced(state, felt=felt)
        press = wanted if isinstance(wanted, Press) else None
        if press is not state.press:
            keeps = press is not None and state.phase == "contact"
            phase: Phase = "contact" if keeps else "" if press is None else "approach"
            state = replaced(state, press=press, phase=phase, approach_s=0.0, is_unfelt=False)
        if press is None and not self.config.cap_n and not (state.moved.any() or state.wanted_n):
            return state if state.tip is None else replaced(state, tip=None)
        state = self._tracked(state, *seen, dt)
        tip, speed, _ = self._tip(point.q, point.qd)
        if press is None:
            state = self._bounded(state, point.q, tip, speed, dt)
        else:
            state = self._pressed(state, press, tip, dt)
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
        if not state.shift.any():
            return point
        shift = state.shift + time_s * state.shift_rate
        return Point(point.q + shift, point.qd + state.shift_rate, point.qdd)

    def told(self, state: ForceLoopState) -> ExternalForce | None:
        """Return the estimated force as the law is told: what the tip presses on is known to be no load."""
        if state.felt is None or state.phase != "contact":
            return state.felt
        return replaced(state.felt, stage="contact", mass_free=False)

    def push(self, state: ForceLoopState, q: Array) -> Array:
        """Return the generalised force (n_q,) of the push at coordinates (n_q,)."""
        if not state.wanted_n:
            return np.zeros_like(q)
        _, _, slope = self._tip(q, q)
        return np.asarray(slope.T @ state.push_n)

    def _pressed(self, state: ForceLoopState, press: Press, tip: Array, dt: float) -> ForceLoopState:
        """Return the state with the reference of a press moved."""
        config, direction = self.config, press.direction
        if state.felt is None and state.phase != "stopped":
            state = replaced(state, phase="stopped", is_unfelt=True)
        if state.felt is None or state.phase == "stopped":
            return self._released(replaced(state, rate=np.zeros(3)), dt)
        goal = min(press.force_n, config.cap_n or np.inf)
        pressed = press.pressed_n(state.felt)
        touch = min(_TOUCH * goal, _MOST_TOUCH_N)
        across = state.moved - (direction @ state.moved) * direction
        back = _fade(across, config.approach_speed_m_s, dt)
        if pressed > (_LEAVES * touch if state.phase == "contact" else touch):
            if state.phase != "contact":
                state = self._touched(state, press.q, direction, pressed)
            return self._in_contact(state, _Contact(direction, goal, pressed), tip, np.zeros(3), dt)
        approach_s = state.approach_s + dt if state.phase == "approach" else 0.0
        state = self._released(replaced(state, phase="approach", approach_s=approach_s), dt)
        assert state.tip is not None
        is_beyond = float(direction @ (tip + state.moved - state.tip)) > _MOST_AHEAD_M
        if is_beyond or approach_s > config.approach_s:
            return replaced(state, phase="stopped", rate=np.zeros(3), is_beyond=is_beyond)
        rate = back + config.approach_speed_m_s * direction
        return replaced(state, rate=rate, moved=state.moved + dt * rate)

    def _bounded(
        self, state: ForceLoopState, q: Array, tip: Array, speed: Array, dt: float
    ) -> ForceLoopState:
        """Return the state under the cap, for a reference with the tip there at that speed."""
        cap = self.config.cap_n
        state = replaced(state, is_unfelt=bool(cap) and state.felt is None)
        if state.is_unfelt:  # not back into what the tip may touch
            return self._released(replaced(state, phase="", rate=np.zeros(3)), dt)
        back = _fade(state.moved, self.config.follow_speed_m_s, dt)
        if cap and state.felt is not None and state.tip is not None:
            felt = state.felt
            likely = likely_force(felt.force_n, felt.covariance, cap**2 * np.eye(3))
            force = max(float(np.linalg.norm(likely)), 1e-9)
            if state.phase == "contact":  # the direction of a noisy force would turn the reference
                toward, force = state.toward, float(-state.toward @ likely)
            else:
                toward = -likely / force
            into = float(toward @ (tip - state.tip))
            is_sure = felt.stage != "free" or force**2 > _SURE**2 * float(toward @ felt.covariance @ toward)
            near = force > _NEAR * cap * (_LEAVES if state.phase == "contact" else 1.0)
            if into > 0.0 and is_sure and near:
                if state.phase != "contact":
                    state = self._touched(state, q, toward, force)
                # A cap is a bound of the true force: the estimate stays a deviation below it.
                doubt = float(np.sqrt(toward @ felt.covariance @ toward))
                most = cap - min(doubt, _MOST_BELOW * cap)
                goal = min(into / self.stiffness.compliance(q, toward, self.k_p), most)
                across = state.moved - (toward @ state.moved) * toward
                back = _fade(across, self.config.follow_speed_m_s, dt)
                return self._in_contact(state, _Contact(toward, goal, force), tip, back, dt, speed)
        state = self._released(replaced(state, phase=""), dt)
        return replaced(state, rate=back, moved=state.moved + dt * back)

    def _touched(self, state: ForceLoopState, q: Array, toward: Array, force: float) -> ForceLoopState:
        """Return the state at the begin of a contact, with the force of now."""
        return replaced(
            state,
            phase="contact",
            wanted_n=force,
            answer_n=force,
            added_n=0.0,
            speed=np.zeros(3),  # of a wall that rests
            scale=self.stiffness.nonuniformity(q, toward),
            by_common=self.stiffness.by_common_pressure(q),
        )

    def relieved(self, state: ForceLoopState, missing_pa: Array, dt: float) -> ForceLoopState:
        """Return the state with the tip moved where a push needs pressures beyond one end of their range.

        A link whose chambers all get more, or less, pressure becomes longer or shorter, and pushes as before:
        force has priority over the position across it.

        Parameters
        ----------
        state : ForceLoopState
        missing_pa : ndarray (n_u,)
            Pressure beyond its bound that the desired force needs of each chamber, negative below [Pa].
        dt : float
            Time since the last tick [s].
        """
        if state.phase != "contact" or not missing_pa.any():
            return state
        common = np.zeros(state.by_common.shape[1])
        for link, of_link in enumerate(self.stiffness.chambers):
            low, high = float(np.min(missing_pa[of_link])), float(np.max(missing_pa[of_link]))
            common[link] = -low if high <= 0.0 else -high if low >= 0.0 else 0.0
        rate = _RELIEF_PER_S * (state.by_common @ common)
        rate = rate * min(1.0, self.config.follow_speed_m_s / max(float(np.linalg.norm(rate)), 1e-9))
        return replaced(state, moved=state.moved + dt * rate)

    def _in_contact(
        self,
        state: ForceLoopState,
        contact: _Contact,
        tip: Array,
        back: Array,
        dt: float,
        speed: Array | None = None,
    ) -> ForceLoopState:
        """Return the state with the reference along `toward` at the tip; the push goes to `goal`."""
        assert state.tip is not None
        toward, goal, force = contact
        wanted = goal + (state.wanted_n - goal) * float(np.exp(-dt / _PUSH_S))
        answer = wanted + (state.answer_n - wanted) * float(np.exp(-dt / _ANSWER_S))
        added = state.added_n + dt * self.config.rate_per_s * (answer - force)
        most = _MOST_ADDED * goal
        along = float(toward @ (state.tip - tip))
        step = along - float(toward @ state.moved)
        most_step = self.config.follow_speed_m_s * dt
        own = 0.0 if speed is None else float(toward @ speed)
        rate = float(toward @ state.speed) - own
        moved = (
            state.moved
            + dt * back
            + min(max(step, -most_step - abs(own) * dt), most_step + abs(own) * dt) * toward
        )
        return replaced(
            state,
            toward=toward,
            wanted_n=wanted,
            answer_n=answer,
            added_n=min(max(added, -most), most),
            moved=moved,
            rate=back + rate * toward,
        )

    def _released(self, state: ForceLoopState, dt: float) -> ForceLoopState:
        """Return the state with less push."""
        if not state.wanted_n:
            return state
        left = float(np.exp(-dt / _PUSH_S))
        if state.wanted_n < 1e-6:
            left = 0.0
        return replaced(
            state,
            wanted_n=left * state.wanted_n,
            answer_n=left * state.answer_n,
            added_n=left * state.added_n,
        )

    def _tracked(self, state: ForceLoopState, q: Array, qd: Array, dt: float) -> ForceLoopState:
        """Return the state with the tip tracked, without lag at constant speed; a filter's are noisy."""
        tip, speed, _ = self._tip(q, qd)
        if state.tip is None:
            return replaced(state, tip=tip, speed=speed)
        part = 1.0 - float(np.exp(-dt / _TRACK_S))
        expected = state.tip + dt * state.speed
        off = tip - expected
        return replaced(
            state, tip=expected + part * (2.0 - part) * off, speed=state.speed + part**2 / dt * off
        )

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


def _fade(moved: Array, speed: float, dt: float) -> Array:
    """Return the velocity [m/s] that takes a displacement back, at most at a speed."""
    length = float(np.linalg.norm(moved))
    return np.zeros(3) if length == 0.0 else -moved * min(1.0 / dt, speed / length)
