"""The limiter, the watchdogs and the latch: the one place that every command passes on its way to a valve.

Everything is a pure function of a frozen state: `offer` takes a command in, `cycle` gives the set points of
the next exchange with the regulators, `request_vent` and `reset` are what a person asks for. Once tripped the
state is latched: it answers zero set points and `vented` until `reset` is called with a zero command.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from soro_core.config import Strict

Array: TypeAlias = NDArray[np.float64]

# Rating of the platform: below 0.1 MPa gauge. No parameter raises it.
HARD_LIMIT_PA = 100e3


class Limits(Strict):
    """What a command and a reading may be; defaults for the three-bellow platform."""

    minimum_pa: float = Field(0.0, ge=-HARD_LIMIT_PA, le=0.0, description="lowest set point")
    maximum_pa: float = Field(90e3, gt=0, lt=HARD_LIMIT_PA, description="highest set point")
    rise_pa_s: float = Field(200e3, gt=0, le=2e6, description="fastest rise of a set point")
    fall_pa_s: float = Field(
        400e3, gt=0, le=2e6, description="fastest fall of a set point; a vent is not limited"
    )
    command_age_s: float = Field(0.1, gt=0, le=0.5, description="age of the last good command that vents")
    reading_age_s: float = Field(0.05, gt=0, le=0.5, description="age of the last fresh reading that vents")
    over_pressure_pa: float = Field(100e3, gt=0, le=105e3, description="measured pressure that vents")
    over_pressure_s: float = Field(0.02, ge=0, le=0.1, description="time that it may be exceeded")
    burst_pressure_pa: float = Field(
        110e3, gt=0, le=120e3, description="measured pressure that vents at once"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Limits:
        if self.over_pressure_pa <= self.maximum_pa:
            raise ValueError("over_pressure_pa must be above maximum_pa")
        if self.burst_pressure_pa < self.over_pressure_pa:
            raise ValueError("burst_pressure_pa must not be below over_pressure_pa")
        return self


@dataclass(frozen=True)
class SafetyState:
    """State of the limiter for `n` chambers; times are nanoseconds of one clock.

    `cause` is None while nothing tripped; a latched state names what did.
    """

    setpoint_pa: Array
    command_pa: Array
    command_ns: int | None = None
    command_source: str = ""
    reading_ns: int | None = None
    over_ns: int | None = None
    cycle_ns: int | None = None
    cause: str | None = None
    rejected: dict[str, int] = field(default_factory=dict)

    @property
    def vented(self) -> bool:
        """Whether the limiter is latched, so that the regulators must vent."""
        return self.cause is not None


def initial_state(n: int) -> SafetyState:
    """Return the state of `n` chambers that no command has reached."""
    return SafetyState(setpoint_pa=np.zeros(n), command_pa=np.zeros(n))


def offer(
    limits: Limits, state: SafetyState, command_pa: Array, stamp_ns: int, now_ns: int, source: str = "command"
) -> tuple[SafetyState, str | None]:
    """Take a command in, or refuse it.

    A refused command changes nothing but its count: the last good one goes on to age, so that a stream of bad
    commands ends in a vent by the watchdog.

    Parameters
    ----------
    command_pa : ndarray (n,)
        Set points [Pa gauge].
    stamp_ns, now_ns : int
        When the command was made, and the time now, of the same clock.
    source : str
        Where it came from; while one source is live a second one is refused.

    Returns
    -------
    state : SafetyState
    refusal : str or None
        Why the command was refused.
    """
    refusal = _refuse(limits, state, command_pa, stamp_ns, now_ns, source)
    if refusal is not None:
        kind = refusal.split(":", 1)[0]
        counts = {**state.rejected, kind: state.rejected.get(kind, 0) + 1}
        return replace(state, rejected=counts), refusal
    taken = np.array(command_pa, dtype=np.float64)
    # A clock that runs ahead must not lengthen the watchdog: a command is never younger than now.
    return replace(state, command_pa=taken, command_ns=min(stamp_ns, now_ns), command_source=source), None


def cycle(
    limits: Limits, state: SafetyState, reading_pa: Array, fresh: bool, now_ns: int, fault: str | None = None
) -> SafetyState:
    """Judge the last readings and the age of the command, and set the next set points.

    Parameters
    ----------
    reading_pa : ndarray (n,)
        Measured pressures [Pa gauge] of the last exchange.
    fresh : bool
        Whether every chamber answered in it.
    fault : str or None
        What the regulators reported of themselves; any fault trips.
    """
    if state.reading_ns is None or fresh:
        state = replace(state, reading_ns=now_ns)
    dt = 0.0 if state.cycle_ns is None else max(now_ns - state.cycle_ns, 0) * 1e-9
    state = replace(state, cycle_ns=now_ns, over_ns=_over_since(limits, state, reading_pa, now_ns))
    if state.vented:
        return state
    cause = fault or _trip_cause(limits, state, reading_pa, now_ns)
    if cause is not None:
        return request_vent(state, cause)
    if state.command_ns is None:
        return state
    # An interval longer than the watchdog is a stall, not a licence to jump.
    dt = min(dt, limits.command_age_s)
    lowest = state.setpoint_pa - limits.fall_pa_s * dt
    highest = state.setpoint_pa + limits.rise_pa_s * dt
    slewed = np.minimum(np.maximum(state.command_pa, lowest), highest)
    return replace(state, setpoint_pa=np.minimum(np.maximum(slewed, limits.minimum_pa), limits.maximum_pa))


def request_vent(state: SafetyState, cause: str) -> SafetyState:
    """Latch with zero set points; the first cause stays, and the last command, which `reset` looks at."""
    return replace(state, setpoint_pa=np.zeros_like(state.setpoint_pa), cause=state.cause or cause)


def reset(limits: Limits, state: SafetyState, now_ns: int) -> tuple[SafetyState, str | None]:
    """Leave the latch, if no live source asks for pressure.

    Returns
    -------
    state : SafetyState
    refusal : str or None
        Why the latch stays.
    """
    if not state.vented:
        return state, None
    live = state.command_ns is not None and (now_ns - state.command_ns) * 1e-9 <= limits.command_age_s
    if live and np.any(state.command_pa != 0.0):
        return state, f"{state.command_source} still asks for pressure: the command must be zero"
    if state.over_ns is not None:
        return state, "a measured pressure is still above the limit"
    fresh = initial_state(state.setpoint_pa.shape[0])
    return replace(fresh, cycle_ns=state.cycle_ns, rejected=state.rejected), None


def _refuse(
    limits: Limits, state: SafetyState, command_pa: Array, stamp_ns: int, now_ns: int, source: str
) -> str | None:
    """Why a command cannot be taken, or None. Finiteness comes before every comparison: NaN fails none."""
    command = np.asarray(command_pa, dtype=np.float64)
    if command.shape != state.command_pa.shape:
        return f"wrong length: {command.shape} for {state.command_pa.shape[0]} chambers"
    if not np.all(np.isfinite(command)):
        return f"not finite: chamber {int(np.argmin(np.isfinite(command)))}"
    if np.any(command < limits.minimum_pa) or np.any(command > limits.maximum_pa):
        worst = int(np.argmax(np.maximum(limits.minimum_pa - command, command - limits.maximum_pa)))
        return (
            f"out of range: chamber {worst} {command[worst]:.0f} Pa, allowed "
            f"{limits.minimum_pa:.0f} to {limits.maximum_pa:.0f} Pa"
        )
    age = (now_ns - stamp_ns) * 1e-9
    if age > limits.command_age_s:
        return f"stale: {age:.3f} s old, allowed {limits.command_age_s:g} s"
    if age < -limits.command_age_s:
        return f"from the future: stamped {-age:.3f} s ahead"
    if state.command_ns is not None:
        if source != state.command_source and (now_ns - state.command_ns) * 1e-9 <= limits.command_age_s:
            return f"second source: {source} while {state.command_source} is live"
        if source == state.command_source and stamp_ns <= state.command_ns:
            return "out of order: not newer than the last command"
    return None


def _over_since(limits: Limits, state: SafetyState, reading_pa: Array, now_ns: int) -> int | None:
    if not np.any(reading_pa > limits.over_pressure_pa):
        return None
    return now_ns if state.over_ns is None else state.over_ns


def _trip_cause(limits: Limits, state: SafetyState, reading_pa: Array, now_ns: int) -> str | None:
    if not np.all(np.isfinite(reading_pa)):
        return f"reading not finite: chamber {int(np.argmin(np.isfinite(reading_pa)))}"
    highest = int(np.argmax(reading_pa)) if reading_pa.size else 0
    over_for = -1.0 if state.over_ns is None else (now_ns - state.over_ns) * 1e-9
    if np.any(reading_pa > limits.burst_pressure_pa) or over_for > limits.over_pressure_s:
        return f"over-pressure: chamber {highest} at {reading_pa[highest] / 1e3:.1f} kPa"
    silent = 0.0 if state.reading_ns is None else (now_ns - state.reading_ns) * 1e-9
    if silent > limits.reading_age_s:
        return f"readings lost: none fresh for {silent * 1e3:.0f} ms"
    if state.command_ns is not None:
        age = (now_ns - state.command_ns) * 1e-9
        if age > limits.command_age_s:
            return f"command lost: last one {age * 1e3:.0f} ms old"
    return None
