"""The cap from tick to tick: the tip gives way to a force beyond it, whatever the reference asks.

A load that comes is no such force: giving way to it would fell the arm.
"""

from __future__ import annotations

import numpy as np

from soro_core.adaptation.external_force import ExternalForce
from soro_core.arrays import Array
from soro_core.control.force.force_state import ForceLoopState
from soro_core.control.force.impedance import yielding
from soro_core.control.force.press import likely_force
from soro_core.control.force.pushed_tip import PushedTip, across, fade
from soro_core.control.reference.trajectory import Point
from soro_core.frozen import replaced

# Part of the cap from which on the force is bounded, of that below which it no longer is, and the most by
# which the loop stays below the cap.
_NEAR, _LEAVES, _MOST_BELOW = 0.5, 0.3, 0.2
# Deviations of an estimated force from which on it is one.
_SURE = 3.0
# Time in which the direction of the push follows that of the force [s].
_TURN_S = 0.5
# How many times better a load must explain a force for it to be one: at the begin, and once the cap acts.
_LOAD, _LATE_LOAD = 1.0, 4.0


def capped(
    push: PushedTip, state: ForceLoopState, point: Point, tip: Array, speed: Array, dt: float
) -> ForceLoopState:
    """Return the state under the cap.

    Parameters
    ----------
    push : PushedTip
    state : ForceLoopState
    point : Point
        The reference in force, not moved.
    tip, speed : ndarray (3,)
        Position and velocity of its tip [m, m/s].
    dt : float
        Time since the last tick [s].
    """
    cap, felt = push.config.cap_n, state.felt
    state = replaced(state, is_unfelt=bool(cap) and felt is None)
    if state.is_unfelt:  # not back into what the tip may touch
        return replaced(state, phase="", rate=np.zeros(3)).released(dt)
    follow, was_contact = push.config.follow_speed_m_s, state.phase == "contact"
    state, back = yielding(push, state, point.q, dt)
    if cap and felt is not None and state.tracked is not None:
        likely = likely_force(felt.force_n, felt.covariance, cap**2 * np.eye(3))
        force = max(float(np.linalg.norm(likely)), 1e-9)
        toward = -likely / force
        if was_contact:  # the direction of a noisy force would turn the reference
            toward = state.toward + min(dt / _TURN_S, 1.0) * (toward - state.toward)
            toward = toward / max(float(np.linalg.norm(toward)), 1e-9)
            force = float(-toward @ likely)
        doubt = float(np.sqrt(toward @ felt.covariance @ toward))
        into = float(toward @ (tip - state.tracked.tip))
        is_sure = felt.stage != "free" or force > _SURE * doubt
        near = force > _NEAR * cap * (_LEAVES if was_contact else 1.0)
        better = _LATE_LOAD if was_contact else _LOAD
        if into > 0.0 and is_sure and near and not _is_load(felt, push.stiffness.arm.tables.gravity, better):
            if not was_contact:
                state = push.touched(state, point.q, toward, force)
            state = replaced(state, toward=toward)
            # A cap is a bound of the true force: the estimate stays a deviation below it.
            most = cap - min(doubt, _MOST_BELOW * cap)
            goal = min(into / push.stiffness.compliance(point.q, toward, push.k_p), most)
            back = fade(across(state.moved, toward), follow, dt)
            return push.pushed(state, (goal, force), (tip, speed), back, dt)
    return replaced(state, phase="", rate=back, moved=state.moved + dt * back).released(dt)


def _is_load(felt: ExternalForce, gravity: Array, better: float) -> bool:
    """Whether a load explains a force better than one across gravity, so many times in squared deviations."""
    force, inverse = felt.force_n, np.linalg.inv(felt.covariance)
    pulls = float(gravity @ force)
    if pulls <= 0.0:
        return False
    mass = max(float(gravity @ inverse @ force), 0.0) / float(gravity @ inverse @ gravity)
    rest = force - mass * gravity
    return better * float(rest @ inverse @ rest) < pulls**2 / float(gravity @ felt.covariance @ gravity)
