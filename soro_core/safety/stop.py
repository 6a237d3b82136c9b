"""An emergency stop that tells its state again and again; its silence counts as pressed."""

from __future__ import annotations

from typing import NamedTuple


class StopState(NamedTuple):
    """What was heard of a stop.

    Attributes
    ----------
    heard_ns : int or None
        When it was last heard [ns]; None for never.
    pressed_ns : int or None
        When it was last heard to be pressed [ns], of the same clock; None for never.
    """

    heard_ns: int | None = None
    pressed_ns: int | None = None


def hear(state: StopState, is_pressed: bool, now_ns: int) -> StopState:
    """Note a message of the stop.

    Parameters
    ----------
    state : StopState
        State before the message.
    is_pressed : bool
        What it says.
    now_ns : int
        Present time [ns].
    """
    return StopState(now_ns, now_ns if is_pressed else state.pressed_ns)


def why_stopped(state: StopState, name: str, timeout_s: float, now_ns: int) -> str | None:
    """Return why the arm must be vented, or None.

    Several stops may speak under one name: it is pressed as long as any message of the last `timeout_s` says
    so.

    Parameters
    ----------
    state : StopState
        What was heard.
    name : str
        Name of the stop in the reason.
    timeout_s : float
        Longest silence [s].
    now_ns : int
        Present time [ns].
    """
    limit_ns = round(timeout_s * 1e9)
    if state.pressed_ns is not None and now_ns - state.pressed_ns <= limit_ns:
        return f"stop pressed: {name} says so"
    if state.heard_ns is None:
        return f"stop silent: no message on {name} yet, which counts as pressed"
    silent_ns = now_ns - state.heard_ns
    if silent_ns > limit_ns:
        return f"stop silent: no message on {name} for {silent_ns * 1e-9:.2f} s, allowed {timeout_s:g} s"
    return None
