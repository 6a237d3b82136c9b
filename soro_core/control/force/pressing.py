"""A press from tick to tick: approach, contact, and the end of one that meets nothing."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.control.control_monitor import deficit_text
from soro_core.control.force.force_state import ForceLoopState, Phase
from soro_core.control.force.press import Press
from soro_core.control.force.pushed_tip import PushedTip, across, fade
from soro_core.control.reference.active_reference import STREAM_S
from soro_core.control.reference.trajectory import Reference
from soro_core.frozen import replaced

# Part of the goal from which on the tip touches something, at most so much [N]. In free air the estimate is a
# few mN off, and a tip that presses on nothing is fast when it hits: a measured tip touches with the most, or
# with so much [N] where something stops it. The part of the first force below which it has left.
_TOUCH, _MOST_TOUCH_N, _STOPPED_TOUCH_N, _LEAVES = 0.3, 0.015, 0.0045, 0.3
# Time of an approach after which the tip moves [s], and the part of its speed below which something stops it.
_MOVES_S, _STOPPED = 0.5, 0.5
# How far the reference of an approach may be ahead of the tip [m]: out of reach the tip does not follow.
_MOST_AHEAD_M = 0.006


def asked(state: ForceLoopState, wanted: Reference, given: Reference | None, dt: float) -> ForceLoopState:
    """Return the state with the press that is asked for.

    Another press goes on in contact. The same one, asked for again after a pause, begins its approach anew
    where the tip has stopped; messages of one stream are one request.

    Parameters
    ----------
    state : ForceLoopState
    wanted : Reference
        The reference to follow.
    given : Reference or None
        That of the last message, which may repeat it.
    dt : float
        Time since the last tick [s].
    """
    press = wanted if isinstance(wanted, Press) else None
    quiet_s = state.quiet_s + dt
    is_asked = given is not state.asked
    state = replaced(state, asked=given, quiet_s=0.0 if is_asked else quiet_s)
    if press is not state.press:
        keeps = press is not None and state.phase == "contact"
        phase: Phase = "contact" if keeps else "" if press is None else "approach"
        state = replaced(state, press=press, phase=phase)
    elif press is not None and state.phase == "stopped" and is_asked and quiet_s > STREAM_S:
        state = replaced(state, phase="approach")
    else:
        return state
    return replaced(state, approach_s=0.0, is_unfelt=False, beyond="", missing_pa=None)


def pressed(push: PushedTip, state: ForceLoopState, press: Press, tip: Array, dt: float) -> ForceLoopState:
    """Return the state with the reference of a press moved.

    Parameters
    ----------
    push : PushedTip
    state : ForceLoopState
    press : Press
    tip : ndarray (3,)
        Tip of the reference, not moved [m].
    dt : float
        Time since the last tick [s].
    """
    config, direction, tracked = push.config, press.direction, state.tracked
    assert tracked is not None
    if state.felt is None and state.phase != "stopped":
        state = replaced(state, phase="stopped", is_unfelt=True)
    if state.felt is None or state.phase == "stopped":
        return replaced(state, rate=np.zeros(3)).released(dt)
    force = press.pressed_n(state.felt)
    goal = min(press.force_n, config.cap_n or np.inf)
    touch = min(_TOUCH * goal, _MOST_TOUCH_N)
    back = fade(across(state.moved, direction), config.approach_speed_m_s, dt)
    if state.phase == "contact":
        least = _LEAVES * touch
    else:
        # Where something stops the tip, the reference goes on into what is there.
        is_slow = float(direction @ tracked.speed) < _STOPPED * config.approach_speed_m_s
        is_stopped = is_slow and state.approach_s > _MOVES_S and state.felt.tip is not None
        first = touch if state.felt.tip is None else _MOST_TOUCH_N
        least = min(touch, _STOPPED_TOUCH_N) if is_stopped else first
    if force > least:
        if state.phase != "contact":
            state = push.touched(state, press.q, direction, force)
        state = replaced(state, pressed_n=force, toward=direction)
        return push.pushed(state, (goal, force), (tip, np.zeros(3)), np.zeros(3), dt)
    approach_s = state.approach_s + dt if state.phase == "approach" else 0.0
    state = replaced(state, phase="approach", approach_s=approach_s, pressed_n=force)
    state = state.released(dt)
    is_beyond = float(direction @ (tip + state.moved - tracked.tip)) > _MOST_AHEAD_M
    if is_beyond or approach_s > config.approach_s:
        beyond = _beyond(push, state) if is_beyond else ""
        return replaced(state, phase="stopped", rate=np.zeros(3), beyond=beyond)
    rate = back + config.approach_speed_m_s * direction
    return replaced(state, rate=rate, moved=state.moved + dt * rate)


def _beyond(push: PushedTip, state: ForceLoopState) -> str:
    """Return where a tip that does not follow is, and which chambers have no more pressure for it."""
    where, names = "where the tip follows", push.stiffness.arm.robot.chamber_names
    short = "" if state.missing_pa is None else deficit_text(names, state.missing_pa)
    return f"{where} ({short})" if short else where
