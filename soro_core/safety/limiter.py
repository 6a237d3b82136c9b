"""The limiter, the watchdogs and the latch: frozen state in, frozen state out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.safety.emptying import Emptying, not_begun, watch_vent
from soro_core.safety.limits import Limits
from soro_core.safety.monitors import broken_wire, watch
from soro_core.safety.remembered import Array, Flags, MonitorState, Times, chamber, initial_monitors

# Regulators of which nothing else is said.
TYPICAL = RegulatorModel()


@dataclass(frozen=True)
class SafetyState:
    """State of the limiter for `n` chambers; times are nanoseconds of one clock.

    `command_ns` is when the last good command was made, for its age, `command_stamp_ns` when it says that it
    was, for its order. `cause` is None while nothing tripped; a latched state names what did, and `emptying`
    tells whether the arm has become empty since.
    """

    setpoint_pa: Array
    command_pa: Array
    monitors: MonitorState
    emptying: Emptying
    command_ns: int | None = None
    command_stamp_ns: int = 0
    command_source: str = ""
    reading_ns: Times | None = None
    over_ns: int | None = None
    cycle_ns: int | None = None
    cause: str | None = None
    rejected: dict[str, int] = field(default_factory=dict)

    @property
    def vented(self) -> bool:
        """Whether the limiter is latched, so that the regulators must vent."""
        return self.cause is not None

    @property
    def not_vented(self) -> str | None:
        """Which chambers have kept their pressure since the vent, or None."""
        return self.emptying.not_vented

    @property
    def kept(self) -> str | None:
        """Pressure that is there although the arm is vented, for which the latch stays, or None."""
        over = "a measured pressure is still above the limit"
        return self.not_vented or (over if self.over_ns is not None else None)

    @property
    def complaint(self) -> str | None:
        """All that a latched state has to say: its cause, and which chambers have not become empty."""
        return "; ".join(filter(None, (self.cause, self.not_vented))) or None


def initial_state(n: int, names: Sequence[str] = ()) -> SafetyState:
    """Return the state of `n` chambers that no command has reached; causes call them by `names` if given."""
    monitors = initial_monitors(n, names)
    return SafetyState(np.zeros(n), np.zeros(n), monitors, not_begun(n))


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
    made_ns = min(stamp_ns, now_ns)
    state = replace(state, command_pa=taken, command_ns=made_ns, command_stamp_ns=stamp_ns)
    return replace(state, command_source=source), None


def cycle(
    limits: Limits,
    state: SafetyState,
    reading_pa: Array,
    fresh: bool | Flags,
    now_ns: int,
    fault: str | None = None,
    supply_pa: Array | None = None,
    response: RegulatorModel = TYPICAL,
) -> SafetyState:
    """Judge the last readings and the age of the command, and set the next set points.

    Parameters
    ----------
    reading_pa : ndarray (n,)
        Measured pressures [Pa gauge] of the last exchange.
    fresh : bool or ndarray (n,) of bool
        Which chambers answered in it.
    fault : str or None
        What the regulators reported of themselves; any fault trips.
    supply_pa : ndarray (n,) or None
        Supply pressures [Pa gauge] where a device reports them, NaN elsewhere.
    response : RegulatorModel
        How the platform's regulators follow their set points: what the monitors expect of the readings.
    """
    fresh = np.broadcast_to(fresh, state.setpoint_pa.shape)
    known = np.full(fresh.shape, now_ns) if state.reading_ns is None else state.reading_ns
    dt = 0.0 if state.cycle_ns is None else max(now_ns - state.cycle_ns, 0) * 1e-9
    state = replace(
        state,
        reading_ns=np.where(fresh, now_ns, known),
        cycle_ns=now_ns,
        over_ns=_over_since(limits, state, reading_pa, now_ns),
    )
    if state.vented:
        names = state.monitors.names
        return replace(state, emptying=watch_vent(limits, state.emptying, names, reading_pa, fresh, now_ns))
    cause = fault or _trip_cause(limits, state, reading_pa, now_ns)
    if cause is None:
        monitors, cause = watch(
            limits.monitors, response, state.monitors, state.setpoint_pa, reading_pa, fresh, supply_pa, now_ns
        )
        state = replace(state, monitors=monitors)
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


def interpolated(state: SafetyState, reading_pa: Array, fresh: bool | Flags) -> Array:
    """Pressures (n,) [Pa gauge] after `cycle`: where no reading is fresh, the last one carried on.

    It is carried on by what the set points since have changed in the model of the regulators, at most for the
    age at which readings count as lost. A latched state carries nothing on.
    """
    monitors = state.monitors
    carried = monitors.seen & ~np.broadcast_to(fresh, monitors.seen.shape) & (not state.vented)
    return np.where(carried, monitors.expected.pressure_pa + monitors.residual_pa, reading_pa)


def request_vent(state: SafetyState, cause: str) -> SafetyState:
    """Latch with zero set points; the first cause stays, and the last command, which `reset` looks at."""
    return replace(state, setpoint_pa=np.zeros_like(state.setpoint_pa), cause=state.cause or cause)


def reset(limits: Limits, state: SafetyState, now_ns: int) -> tuple[SafetyState, str | None]:
    """Leave the latch, if the last command, however old, was zero; its source and stamp stay those to beat.

    An arm that is still on its way to 0 Pa is no reason to keep it latched. One that was found not to get
    there is: somebody has to look at it, and it has to be seen empty.

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
        return state, f"{state.command_source} {asks} for pressure: the command must be zero"
    if state.kept is not None:
        return state, state.kept
    return (
        replace(
            initial_state(state.setpoint_pa.shape[0], state.monitors.names),
            # A source that was silent for long is not lost now, but what it sent before stays sent before.
            command_ns=state.command_ns if live else None,
            command_stamp_ns=state.command_stamp_ns,
            command_source=state.command_source,
            cycle_ns=state.cycle_ns,
            rejected=state.rejected,
        ),
        None,
    )


def _refuse(
    limits: Limits, state: SafetyState, command_pa: Array, stamp_ns: int, now_ns: int, source: str
) -> str | None:
    """Why a command cannot be taken, or None. Finiteness comes before every comparison: NaN fails none."""
    names = state.monitors.names
    command = np.asarray(command_pa, dtype=np.float64)
    if command.shape != state.command_pa.shape:
        return f"wrong length: {command.shape} for {state.command_pa.shape[0]} chambers"
    if not np.all(np.isfinite(command)):
        return f"not finite: {chamber(names, int(np.argmin(np.isfinite(command))))}"
    if np.any(command < limits.minimum_pa) or np.any(command > limits.maximum_pa):
        worst = int(np.argmax(np.maximum(limits.minimum_pa - command, command - limits.maximum_pa)))
        return (
            f"out of range: {chamber(names, worst)} {command[worst]:.0f} Pa, allowed "
            f"{limits.minimum_pa:.0f} to {limits.maximum_pa:.0f} Pa"
        )
    age = (now_ns - stamp_ns) * 1e-9
    if age > limits.command_age_s:
        return f"stale: {age:.3f} s old, allowed {limits.command_age_s:g} s"
    if age < -limits.command_age_s:
        return f"from the future: stamped {-age:.3f} s ahead"
    if source == state.command_source:
        return "out of order: not newer than the last command" if stamp_ns <= state.command_stamp_ns else None
    # One that has fallen silent is not followed by another: the next cycle trips, and who is first after the
    # reset may command.
    in_force = state.cycle_ns is not None and not state.vented
    if state.command_ns is not None and (
        in_force or (now_ns - state.command_ns) * 1e-9 <= limits.command_age_s
    ):
        return f"second source: {source} while {state.command_source} is live"
    return None


def _over_since(limits: Limits, state: SafetyState, reading_pa: Array, now_ns: int) -> int | None:
    if not np.any(reading_pa > limits.over_pressure_pa):
        return None
    return now_ns if state.over_ns is None else state.over_ns


def _trip_cause(limits: Limits, state: SafetyState, reading_pa: Array, now_ns: int) -> str | None:
    names = state.monitors.names
    if not np.all(np.isfinite(reading_pa)):
        return f"reading not finite: {chamber(names, int(np.argmin(np.isfinite(reading_pa))))}"
    if wire := broken_wire(limits.monitors, names, reading_pa):
        return wire
    highest = int(np.argmax(reading_pa)) if reading_pa.size else 0
    over_for = -1.0 if state.over_ns is None else (now_ns - state.over_ns) * 1e-9
    if np.any(reading_pa > limits.burst_pressure_pa) or over_for > limits.over_pressure_s:
        return f"over-pressure: {chamber(names, highest)} at {reading_pa[highest] / 1e3:.1f} kPa"
    if state.reading_ns is not None and state.reading_ns.size:
        oldest = int(np.argmin(state.reading_ns))
        silent = float(now_ns - state.reading_ns[oldest]) * 1e-9
        if silent > limits.reading_age_s:
            return f"readings lost: {chamber(names, oldest)} not fresh for {silent * 1e3:.0f} ms"
    if state.command_ns is not None:
        age = (now_ns - state.command_ns) * 1e-9
        if age > limits.command_age_s:
            return f"command lost: last one {age * 1e3:.0f} ms old"
    return None
