"""Plausibility of valves and sensors: readings against what the set points must have led to.

What a valve must have done is predicted by the model of the platform's regulators (dead time, play, lag of
first order), driven by the set points alone: a wrong reading cannot change the prediction.
Thresholds and times are those of `Monitors`; every function is pure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from soro_core.arrays import Array, Flags, Integers
from soro_core.pneumatics.lag import follow
from soro_core.pneumatics.regulator import RegulatorModel, step
from soro_core.safety.limits import Monitors
from soro_core.safety.monitor_state import NEVER, MonitorSample, MonitorState, chamber

# A set point counts as settled after this time and this number of lags (e^-8 of full scale is 30 Pa).
SETTLED_S, SETTLED_LAGS = 0.5, 8.0
# Filter of the readings of which the drift is taken: noise of 0.1 kPa becomes 0.02 kPa.
DRIFT_FILTER_S = 0.1
# The filter smears a step over two of them at most.
DRIFT_WINDOWS = 3

_Found: TypeAlias = tuple[dict[str, Array | Integers], str | None]


def broken_wire(monitors: Monitors, names: Sequence[str], reading_pa: Array) -> str | None:
    """Return the cause of a trip if the wire of a sensor is open or shorted, else None.

    Parameters
    ----------
    monitors : Monitors
        Thresholds.
    names : sequence of str
        Names of the chambers.
    reading_pa : ndarray (n,)
        Measured pressures [Pa gauge].
    """
    for n, reading in enumerate(reading_pa.tolist()):
        if reading < monitors.open_circuit_pa or reading > monitors.short_circuit_pa:
            which = "open circuit" if reading < 0 else "short circuit"
            return f"{which}: {chamber(names, n)} reads {reading / 1e3:.1f} kPa"
    return None


def watch(
    monitors: Monitors,
    response: RegulatorModel,
    state: MonitorState,
    setpoint_pa: Array,
    reading_pa: Array,
    fresh: Flags,
    supply_pa: Array | None,
    now_ns: int,
) -> tuple[MonitorState, str | None]:
    """Judge the readings of one exchange.

    Parameters
    ----------
    monitors : Monitors
        Thresholds and times.
    response : RegulatorModel
        Response of the platform's regulators.
    state : MonitorState
        State before the exchange.
    setpoint_pa : ndarray (n,)
        Set points that this exchange sent [Pa gauge]; its readings respond to the earlier ones.
    reading_pa : ndarray (n,)
        Measured pressures [Pa gauge], finite.
    fresh : ndarray (n,) of bool
        Whether each reading was sampled in this exchange; the others are not judged.
    supply_pa : ndarray (n,) or None
        Reported supply pressures [Pa gauge], NaN for devices that report none.
    now_ns : int
        Time of the limiter's clock [ns].

    Returns
    -------
    state : MonitorState
    cause : str or None
        What is wrong, in one line that names the chamber.
    """
    dt = max(now_ns - state.now_ns, 0) * 1e-9 if state.now_ns != NEVER else 0.0
    first = fresh & ~state.seen
    expected = step(response, state.expected, state.setpoint_pa, dt)
    if not _all(state.seen):  # nothing is known of a chamber before its first reading, and then that
        expected = replace(
            expected,
            pressure_pa=np.where(state.seen, expected.pressure_pa, reading_pa),
            target_pa=np.where(state.seen, expected.target_pa, reading_pa),
        )
    model = expected.pressure_pa
    off = reading_pa - model
    sample = MonitorSample(setpoint_pa, reading_pa, fresh, first, model, off, supply_pa, dt, now_ns)
    changes: dict[str, Array | Integers] = {}
    causes = []
    for monitor in (_spike, _stuck, _frozen, _deviation, _drift, _supply):
        changed, cause = monitor(monitors, response, state, sample)
        changes |= changed
        causes += [cause] if cause else []
    state = state._replace(
        expected=expected,
        setpoint_pa=setpoint_pa,
        reading_pa=np.where(fresh, reading_pa, state.reading_pa),
        residual_pa=np.where(fresh, off, state.residual_pa),
        seen=state.seen | fresh,
        now_ns=now_ns,
        **changes,  # type: ignore[arg-type]
    )
    return state, causes[0] if causes else None


def _spike(m: Monitors, _: RegulatorModel, s: MonitorState, now: MonitorSample) -> _Found:
    """A change since the last fresh reading beyond what the prediction changed."""
    jump = np.abs(now.off_pa - s.residual_pa)
    bad = now.fresh & ~now.first & (jump > m.spike_pa)
    if not _any(bad):
        return {}, None
    n = int(np.argmax(bad))
    jumped = f"from {s.reading_pa[n] / 1e3:.1f} to {now.reading_pa[n] / 1e3:.1f} kPa in one sample"
    return {}, f"spike: {chamber(s.names, n)} {jumped}"


def _stuck(m: Monitors, _: RegulatorModel, s: MonitorState, now: MonitorSample) -> _Found:
    """The set point has gone somewhere else, the reading stays where it was."""
    far = now.fresh & (np.abs(now.reading_pa - s.moved_pa) > m.stuck_motion_pa)
    moved = now.first | far
    moved_pa = np.where(moved, now.reading_pa, s.moved_pa)
    asked_pa = np.where(moved, now.setpoint_pa, s.asked_pa)
    asked = np.abs(now.setpoint_pa - asked_pa) > m.stuck_pa
    since = _since(s.unmoved_ns, asked, s.seen & ~moved, now.now_ns)
    n = _longest(since, now.now_ns, m.stuck_s)
    changes = {"moved_pa": moved_pa, "asked_pa": asked_pa, "unmoved_ns": since}
    if n is None:
        return changes, None
    change = f"set point {asked_pa[n] / 1e3:.1f} to {now.setpoint_pa[n] / 1e3:.1f} kPa"
    return changes, f"stuck valve: {chamber(s.names, n)} stays at {now.reading_pa[n] / 1e3:.1f} kPa, {change}"


def _frozen(m: Monitors, _: RegulatorModel, s: MonitorState, now: MonitorSample) -> _Found:
    """Readings that are equal to the last digit while the pressure must have changed."""
    other = now.first | (now.fresh & (now.reading_pa != s.reading_pa))
    since = np.where(other, now.now_ns, s.same_ns)
    low = np.where(other, now.model_pa, np.minimum(s.lowest_pa, now.model_pa))
    high = np.where(other, now.model_pa, np.maximum(s.highest_pa, now.model_pa))
    n = _longest(np.where(high - low > m.frozen_pa, since, NEVER), now.now_ns, m.frozen_s)
    changes = {"same_ns": since, "lowest_pa": low, "highest_pa": high}
    if n is None:
        return changes, None
    found = f"{now.reading_pa[n] / 1e3:.2f} kPa for {(now.now_ns - since[n]) * 1e-6:.0f} ms"
    return changes, f"frozen sensor: {chamber(s.names, n)} reads exactly {found}"


def _deviation(m: Monitors, _: RegulatorModel, s: MonitorState, now: MonitorSample) -> _Found:
    """A reading that the set points do not explain."""
    off = np.abs(now.off_pa) > m.model_pa
    since = _since(s.deviates_ns, off, now.fresh, now.now_ns)
    n = _longest(since, now.now_ns, m.model_s)
    if n is None:
        return {"deviates_ns": since}, None
    found = f"{now.reading_pa[n] / 1e3:.1f} kPa, expected {now.model_pa[n] / 1e3:.1f} kPa"
    if s.seen[n] and s.same_ns[n] <= s.deviates_ns[n] and now.reading_pa[n] == s.reading_pa[n]:
        return {"deviates_ns": since}, f"frozen sensor: {chamber(s.names, n)} reads exactly {found}"
    return {"deviates_ns": since}, f"implausible: {chamber(s.names, n)} reads {found}"


def _drift(m: Monitors, response: RegulatorModel, s: MonitorState, now: MonitorSample) -> _Found:
    """A reading that runs away at a constant set point: in three windows in a row, as no single step does."""
    since = np.where((now.setpoint_pa != s.setpoint_pa) | now.first, now.now_ns, s.still_ns)
    settled_s = max(SETTLED_S, response.delay_s + SETTLED_LAGS * max(response.tau_s, response.vent_tau_s))
    settled = now.fresh & (now.now_ns - since >= settled_s * 1e9)
    if not _any(settled) and _none_since(s.drift_ns):
        return {"still_ns": since}, None  # as always under closed-loop control
    running = settled & (s.drift_ns != NEVER)
    mean = np.where(running, follow(s.mean_pa, now.reading_pa, now.dt, DRIFT_FILTER_S), now.reading_pa)
    elapsed_ns = now.now_ns - s.drift_ns
    over = running & (elapsed_ns >= m.leak_s / DRIFT_WINDOWS * 1e9)
    begins = over | (settled & ~running)
    rate = np.where(over, (mean - s.drift_pa) / np.maximum(elapsed_ns * 1e-9, 1e-9), 0.0)
    sign = np.where(np.abs(rate) > m.leak_pa_s, np.sign(rate), 0.0)
    counted = np.where(sign * s.drifts > 0, s.drifts + sign, sign)
    drifts = np.where(over, counted, np.where(running | ~now.fresh, s.drifts, 0.0))
    changes = {
        "still_ns": since,
        "mean_pa": np.where(now.fresh, mean, s.mean_pa),
        "drift_pa": np.where(begins, mean, s.drift_pa),
        "drift_ns": np.where(begins, now.now_ns, np.where(settled | ~now.fresh, s.drift_ns, NEVER)),
        "drifts": drifts,
    }
    n = int(np.argmax(np.abs(drifts))) if drifts.size else 0
    if not drifts.size or abs(drifts[n]) < DRIFT_WINDOWS:
        return changes, None
    which = "falls" if rate[n] < 0 else "rises"
    at = f"{now.reading_pa[n] / 1e3:.1f} kPa, set point constant"
    return changes, f"leak: {chamber(s.names, n)} {which} by {abs(rate[n]) / 1e3:.1f} kPa/s at {at}"


def _supply(m: Monitors, _: RegulatorModel, s: MonitorState, now: MonitorSample) -> _Found:
    """Supply that cannot carry the set point, or is higher than the parts bear, where a device reports it."""
    if now.supply_pa is None:
        return {}, None
    # A comparison with NaN is false: a chamber without this sensor is never judged.
    low = now.supply_pa < now.setpoint_pa + m.supply_margin_pa
    high = now.supply_pa > m.supply_most_pa
    since = _since(s.supply_ns, low | high, now.fresh, now.now_ns)
    n = _longest(since, now.now_ns, m.supply_s)
    if n is None:
        return {"supply_ns": since}, None
    if high[n]:
        found = f"{now.supply_pa[n] / 1e3:.1f} kPa, allowed {m.supply_most_pa / 1e3:.1f} kPa"
        return {"supply_ns": since}, f"supply high: {chamber(s.names, n)} has {found}"
    needed = (now.setpoint_pa[n] + m.supply_margin_pa) / 1e3
    text = f"supply low: {chamber(s.names, n)} has {now.supply_pa[n] / 1e3:.1f} kPa, needs {needed:.1f} kPa"
    return {"supply_ns": since}, text


def _since(since_ns: Integers, holds: Flags, judged: Flags, now_ns: int) -> Integers:
    """Return the time since which a condition holds; unchanged where it is not judged now."""
    if not _any(holds) and _none_since(since_ns):  # as nearly always
        return since_ns
    held = np.where(since_ns == NEVER, now_ns, since_ns)
    return np.where(judged, np.where(holds, held, NEVER), since_ns)


def _longest(since_ns: Integers, now_ns: int, limit_s: float) -> int | None:
    """Chamber whose condition has held longest, if that is too long."""
    if _none_since(since_ns):
        return None
    held = np.where(since_ns == NEVER, -1, now_ns - since_ns)
    n = int(held.argmax())
    return n if held[n] >= limit_s * 1e9 else None


# numpy takes longer for the few numbers of an arm than Python for their list.
def _any(flags: Flags) -> bool:
    return True in flags.tolist()


def _all(flags: Flags) -> bool:
    return False not in flags.tolist()


def _none_since(since_ns: Integers) -> bool:
    """Whether no chamber's condition holds."""
    return max(since_ns.tolist(), default=NEVER) == NEVER
