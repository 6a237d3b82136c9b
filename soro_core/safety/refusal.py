"""Why the limiter refuses a command."""

from __future__ import annotations

import math

import numpy as np

from soro_core.arrays import Array
from soro_core.safety.limits import Limits
from soro_core.safety.monitor_state import chamber
from soro_core.safety.state import SafetyState


def why_refused(
    limits: Limits, state: SafetyState, command_pa: Array, stamp_ns: int, now_ns: int, source: str
) -> str | None:
    """Return why a command is refused, or None; finiteness first: a comparison with NaN is false.

    Parameters
    ----------
    limits : Limits
    state : SafetyState
        Before the command.
    command_pa : ndarray (n,)
        Set points [Pa gauge].
    stamp_ns, now_ns : int
        Time of the command, and present time, of the same clock [ns].
    source : str
        Name of its source.
    """
    names = state.monitors.names
    command = np.asarray(command_pa, dtype=np.float64)
    if command.shape != state.command_pa.shape:
        return f"wrong length: {command.shape} for {state.command_pa.shape[0]} chambers"
    asked = command.tolist()
    if not all(map(math.isfinite, asked)):
        return f"not finite: {chamber(names, int(np.argmin(np.isfinite(command))))}"
    if any(not limits.minimum_pa <= value <= limits.maximum_pa for value in asked):
        worst = int(np.argmax(np.maximum(limits.minimum_pa - command, command - limits.maximum_pa)))
        return (
            f"out of range: {chamber(names, worst)} {command[worst]:.7g} Pa, allowed "
            f"{limits.minimum_pa:.0f} to {limits.maximum_pa:.0f} Pa"
        )
    age = (now_ns - stamp_ns) * 1e-9
    if age > limits.command_age_s:
        return f"stale: {age:.3f} s old, allowed {limits.command_age_s:g} s"
    if age < -limits.command_age_s:
        return f"from the future: stamped {-age:.3f} s ahead"
    if source == state.command_source:
        # A last stamp from the future is that of a clock that has been set back since: it orders nothing.
        is_known = (state.command_stamp_ns - now_ns) * 1e-9 <= limits.command_age_s
        late = is_known and stamp_ns <= state.command_stamp_ns
        return "out of order: not newer than the last command" if late else None
    # A silent source is not replaced by another one: the next cycle trips, and after the reset the first
    # source may command.
    in_force = state.cycle_ns is not None and not state.vented
    if state.command_ns is not None and (
        in_force or (now_ns - state.command_ns) * 1e-9 <= limits.command_age_s
    ):
        return f"second source: {source} while {state.command_source} is live"
    return None
