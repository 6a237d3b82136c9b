"""The limiter, the watchdogs and the latch: pure functions of a frozen state."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.safety import shares
from soro_core.safety.limits import Limits
from soro_core.safety.monitor_state import chamber
from soro_core.safety.monitors import broken_wire, watch
from soro_core.safety.refusal import why_refused
from soro_core.safety.state import MUST_BE_ZERO, SafetyState, count_refusal, initial_state
from soro_core.safety.vent_check import watch_vent

# Response of regulators whose platform states none.
TYPICAL = RegulatorModel()


def offer(
    limits: Limits, state: SafetyState, command_pa: Array, stamp_ns: int, now_ns: int, source: str = "command"
) -> tuple[SafetyState, str | None]:
    """Accept a command, or refuse it.

    A refused command only increments its count: the last accepted command continues to age, so that a stream
    of bad commands ends in a vent by the watchdog.

    Parameters
    ----------
    limits : Limits
        Limits of commands and readings.
    state : SafetyState
        State before the call.
    command_pa : ndarray (n,)
        Set points [Pa gauge].
    stamp_ns, now_ns : int
        Time of the command, and present time, of the same clock [ns].
    source : str
        Name of the source; while one source is live, a second one is refused.

    Returns
    -------
    state : SafetyState
    refusal : str or None
        Why the command was refused.
    """
    refusal = why_refused(limits, state, command_pa, stamp_ns, now_ns, source)
    if refusal is not None:
        return count_refusal(state, refusal), refusal
    taken = np.array(command_pa, dtype=np.float64)
    # A clock that runs ahead must not lengthen the watchdog: a command is never younger than now.
    made_ns = min(stamp_ns, now_ns)
    made: dict[str, Any] = {
        "command_ns": made_ns,
        "command_stamp_ns": stamp_ns,
        "command_source": source,
    }
    each = tuple(one._replace(**made) for one in state.shares)  # of all chambers, it is one of each arm
    return state._replace(command_pa=taken, shares=each, **made), None


def doubt(state: SafetyState, reason: str, source: str) -> SafetyState:
    """Refuse a command whose source name two publishers may use, and hold the set points of its last command.

    The last command continues to age.

    Parameters
    ----------
    state : SafetyState
        State before the call.
    reason : str
        Why the command is refused; the text before the colon is its kind.
    source : str
    """
    state = count_refusal(state, reason)
    in_force = source == state.command_source and not state.vented
    return state._replace(command_pa=state.setpoint_pa) if in_force else state


def slew(limits: Limits, state: SafetyState, now_ns: int) -> SafetyState:
    """Begin a cycle: check the age of the command, then move the set points towards it.

    The exchange of this cycle sends the set points of the state. A command that is too old latches before the
    exchange. Set points beyond limits that have become narrower go there at their fastest rates.

    Parameters
    ----------
    limits : Limits
        Limits of commands and readings.
    state : SafetyState
        State before the call.
    now_ns : int
        Time of the limiter's clock [ns].
    """
    dt = 0.0 if state.cycle_ns is None else max(now_ns - state.cycle_ns, 0) * 1e-9
    if state.vented or state.command_ns is None:
        return state._replace(cycle_ns=now_ns)
    age = (now_ns - state.command_ns) * 1e-9
    if not 0.0 <= age <= limits.command_age_s:  # below 0 it would be in force until the clock is there again
        state = state._replace(cycle_ns=now_ns)
        of = "".join({f" of {one.arm}" for one in state.shares if one.command_ns == state.command_ns})
        found = f"last one{of} {age * 1e3:.0f} ms old"
        if age <= 0.0:
            found = f"the clock went back by {-age:.3f} s"
        return trip(state, f"command lost: {found}")
    # After a stall longer than the watchdog, the set points move no further than in one watchdog time.
    dt = min(dt, limits.command_age_s)
    lowest = state.setpoint_pa - limits.fall_pa_s * dt
    highest = state.setpoint_pa + limits.rise_pa_s * dt
    slewed = np.minimum(np.maximum(state.command_pa, lowest), highest)
    # The last set points are within the limits, unless these have become narrower since.
    least, most = np.minimum(limits.minimum_pa, highest), np.maximum(limits.maximum_pa, lowest)
    return state._replace(cycle_ns=now_ns, setpoint_pa=np.minimum(np.maximum(slewed, least), most))


def judge(
    limits: Limits,
    state: SafetyState,
    reading_pa: Array,
    fresh: bool | Flags,
    now_ns: int,
    fault: str | None = None,
    supply_pa: Array | None = None,
    response: RegulatorModel = TYPICAL,
) -> SafetyState:
    """End a cycle: judge the readings of its exchange.

    Regulators sample a reading at the arrival of the set points of the same exchange, or some milliseconds
    later: the reading responds to the set points of earlier cycles. The monitors rely on that.

    Parameters
    ----------
    limits : Limits
        Limits of commands and readings.
    state : SafetyState
        State after `slew`, whose set points have been sent.
    reading_pa : ndarray (n,)
        Measured pressures [Pa gauge].
    fresh : bool or ndarray (n,) of bool
        Whether each chamber answered in this exchange.
    now_ns : int
        Time of the limiter's clock [ns].
    fault : str or None
        Fault that the regulators report; any fault trips.
    supply_pa : ndarray (n,) or None
        Reported supply pressures [Pa gauge], NaN for devices that report none.
    response : RegulatorModel
        Response of the platform's regulators, with which the monitors compare the readings.
    """
    fresh = _each(fresh, state.setpoint_pa.shape)
    known = np.full(fresh.shape, now_ns) if state.reading_ns is None else state.reading_ns
    state = state._replace(
        reading_ns=np.where(fresh, now_ns, known),
        over_ns=_over_since(limits, state, reading_pa, now_ns),
    )
    if state.vented:
        names = state.monitors.names
        checked = watch_vent(limits, state.vent_check, names, reading_pa, fresh, now_ns)
        state = state._replace(vent_check=checked, standing=None)
        # Pressure, even one that only a shorted wire shows, has time to fall, and is `kept` if it does not.
        vacuum_pa = np.where(np.isfinite(reading_pa), np.minimum(reading_pa, 0.0), reading_pa)
        no_number = _no_number(limits, state, vacuum_pa)
        found = fault or no_number or _silence(limits, state, now_ns)
        return state if found is None else trip(state, found)
    cause = fault or _trip_cause(limits, state, reading_pa, now_ns)
    if cause is None:
        monitors, cause = watch(
            limits.monitors, response, state.monitors, state.setpoint_pa, reading_pa, fresh, supply_pa, now_ns
        )
        state = state._replace(monitors=monitors)
    return state if cause is None else trip(state, cause)


def interpolated(state: SafetyState, reading_pa: Array, fresh: bool | Flags) -> Array:
    """Return pressures after `judge`, with readings that are not fresh extrapolated.

    The extrapolation adds the change that the set points since the reading cause in the model of the
    regulators, until the reading counts as lost. A latched state extrapolates nothing.

    Parameters
    ----------
    state : SafetyState
        State after `judge`.
    reading_pa : ndarray (n,)
        Measured pressures [Pa gauge].
    fresh : bool or ndarray (n,) of bool
        Whether each chamber answered in this exchange.

    Returns
    -------
    ndarray (n,)
        Pressures [Pa gauge].
    """
    monitors = state.monitors
    carried = monitors.seen & ~_each(fresh, monitors.seen.shape) & (not state.vented)
    return np.where(carried, monitors.expected.pressure_pa + monitors.residual_pa, reading_pa)


def request_vent(state: SafetyState, cause: str) -> SafetyState:
    """Latch with zero set points; the first cause stays, and so does the last command, for `reset`."""
    return state._replace(setpoint_pa=np.zeros_like(state.setpoint_pa), cause=state.cause or cause)


def trip(state: SafetyState, fault: str) -> SafetyState:
    """Latch for a fault; of a state that is vented without one it is the fault, beside the cause of the vent.

    Parameters
    ----------
    state : SafetyState
        State before the call.
    fault : str
        What was found; of a state that is vented already it stands until the next `judge`.
    """
    standing = fault if state.vented else None  # one that only begins may be over with its own cycle
    return request_vent(state, fault)._replace(fault=state.fault or fault, standing=standing)


def reset(limits: Limits, state: SafetyState, now_ns: int) -> tuple[SafetyState, str | None]:
    """Open the latch if the last accepted command was zero, whatever its age.

    The source and the time stamp of that command stay, so that an older command is refused later. An arm that
    is still becoming empty does not keep the latch closed. An arm that has kept its pressure for too long
    does: a person has to examine it, and readings have to show that it is empty. So does a fault that still
    stands, which would trip again at once. Its parameters as in `slew`.

    Returns
    -------
    state : SafetyState
    refusal : str or None
        Why the latch stays.
    """
    if not state.vented:
        return state, None
    live = state.command_ns is not None and (now_ns - state.command_ns) * 1e-9 <= limits.command_age_s
    if np.any(state.command_pa != 0.0):
        asks = "still asks" if live else "asked last"
        return state, f"{shares.commands_of(state)} {asks} for pressure: {MUST_BE_ZERO}"
    if state.kept is not None:
        return state, state.kept
    if state.standing is not None:
        return state, state.standing
    return (
        initial_state(state.setpoint_pa.shape[0], state.monitors.names)._replace(
            # A source that was silent for long does not trip again; the order of its commands still holds.
            command_ns=state.command_ns if live else None,
            command_stamp_ns=state.command_stamp_ns,
            command_source=state.command_source,
            cycle_ns=state.cycle_ns,
            rejected=state.rejected,
            shares=shares.kept(state.shares, now_ns - round(1e9 * limits.command_age_s)),
        ),
        None,
    )


def _each(fresh: bool | Flags, shape: tuple[int, ...]) -> Flags:
    """Return the flag of each chamber."""
    return np.broadcast_to(fresh, shape) if isinstance(fresh, np.ndarray) else np.full(shape, fresh)


def _over_since(limits: Limits, state: SafetyState, reading_pa: Array, now_ns: int) -> int | None:
    # A few numbers are compared faster one by one than by numpy; a comparison with NaN is false.
    if not any(reading > limits.over_pressure_pa for reading in reading_pa.tolist()):
        return None
    return now_ns if state.over_ns is None else state.over_ns


def _trip_cause(limits: Limits, state: SafetyState, reading_pa: Array, now_ns: int) -> str | None:
    if (missing := _no_number(limits, state, reading_pa)) is not None:
        return missing
    names, readings = state.monitors.names, reading_pa.tolist()
    highest = max(readings, default=-math.inf)
    over_for = -1.0 if state.over_ns is None else (now_ns - state.over_ns) * 1e-9
    if highest > limits.burst_pressure_pa or over_for > limits.over_pressure_s:
        which = chamber(names, readings.index(highest))
        return f"over-pressure: {which} at {highest / 1e3:.1f} kPa"
    return _silence(limits, state, now_ns)


def _no_number(limits: Limits, state: SafetyState, reading_pa: Array) -> str | None:
    names = state.monitors.names
    if not all(map(math.isfinite, reading_pa.tolist())):
        return f"reading not finite: {chamber(names, int(np.argmin(np.isfinite(reading_pa))))}"
    return broken_wire(limits.monitors, names, reading_pa) or None


def _silence(limits: Limits, state: SafetyState, now_ns: int) -> str | None:
    if state.reading_ns is not None and state.reading_ns.size:
        times = state.reading_ns.tolist()
        silent = (now_ns - min(times)) * 1e-9
        if silent > limits.reading_age_s:
            oldest = chamber(state.monitors.names, times.index(min(times)))
            return f"readings lost: {oldest} not fresh for {silent * 1e3:.0f} ms"
    return None
