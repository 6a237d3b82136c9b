"""The excitation as a state machine: (state, tick) -> (state, set points)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from soro_core.arrays import Array
from soro_lab.excitation.foresight import Warned
from soro_lab.excitation.motion import IN_A_ROW, AtRest, MotionCriteria, Sample, at_rest, beyond, is_still
from soro_lab.excitation.plan import ExcitationPlan

Phase: TypeAlias = Literal["running", "venting", "over"]

# Times of its hold that a level may last until the arm is still, of the time that levels before have left.
PATIENCE = 3.0
# Time counts in ticks; this covers their rounding [s].
ROUNDING_S = 5e-7
# Longest time that a sample may be ahead of its tick, by the clocks of two computers [s].
AHEAD_S = 1.0
# Time at 0 Pa after the last section or a stop, of which the recording has the samples [s].
VENT_S = 1.5


@dataclass(frozen=True)
class Excitation:
    """What an excitation follows.

    Attributes
    ----------
    plan : ExcitationPlan
        Sections.
    motion : MotionCriteria
        Limits of the motion.
    warned : Warned or None
        The section that the model warns of.
    outermost : str
        Name of the sensor whose box counts.
    """

    plan: ExcitationPlan
    motion: MotionCriteria
    warned: Warned | None
    outermost: str


@dataclass(frozen=True)
class ExcitationTick:
    """Input of one tick.

    Attributes
    ----------
    t_s : float
        Time since the first tick [s].
    samples : mapping of str to tuple of samples
        New samples by name of their sensor; stamps count as `t_s` does.
    answered : bool
        Whether a person has answered since the last tick.
    stop : str
        Why the excitation must stop; empty if it need not.
    """

    t_s: float
    samples: Mapping[str, tuple[Sample, ...]] = field(default_factory=dict)
    answered: bool = False
    stop: str = ""


@dataclass(frozen=True)
class ExcitationState:
    """State after a tick.

    Attributes
    ----------
    begin_pa, setpoint_pa : ndarray (n_u,)
        Set points at the begin of the section, and of the last tick [Pa gauge].
    phase : Phase
        ``venting`` after the last section or a stop, then ``over``.
    index : int
        Number of the present section.
    begin_s : float
        Time of its begin [s], or of that of the vent.
    reason : str
        Why the excitation stopped early; empty if it did not.
    rest : mapping of str to AtRest
        The sensors without pressure.
    recent : mapping of str to tuple of samples
        Last samples by sensor, of the longest time for which a level asks the arm to be still.
    arrived_s : mapping of str to float
        Time of the last sample of each sensor [s].
    strikes : mapping of str to int
        Samples in a row beyond a limit, by sensor.
    restless : int
        Levels that ended before the arm was still.
    saved_s : float
        Time that sections have left of their longest [s].
    """

    begin_pa: Array
    setpoint_pa: Array
    phase: Phase = "running"
    index: int = 0
    begin_s: float = 0.0
    reason: str = ""
    rest: Mapping[str, AtRest] = field(default_factory=dict)
    recent: Mapping[str, tuple[Sample, ...]] = field(default_factory=dict)
    arrived_s: Mapping[str, float] = field(default_factory=dict)
    strikes: Mapping[str, int] = field(default_factory=dict)
    restless: int = 0
    saved_s: float = 0.0


def initial_state(excitation: Excitation) -> ExcitationState:
    """Return the state before the first tick."""
    zero = np.zeros(len(excitation.plan.names))
    return ExcitationState(zero, zero)


def advance(excitation: Excitation, state: ExcitationState, tick: ExcitationTick) -> ExcitationState:
    """Return the state after one tick; its `setpoint_pa` is the command.

    Parameters
    ----------
    excitation : Excitation
        What is followed.
    state : ExcitationState
        State after the last tick.
    tick : ExcitationTick
        New samples.
    """
    state = _received(state, tick, excitation.plan.still_s)
    if state.phase == "running":
        reason = _stop_reason(excitation, state, tick)
        state = _stopped(state, tick.t_s, reason) if reason else _moved(excitation, state, tick)
    if state.phase == "running":
        section = excitation.plan.sections[state.index]
        return replace(state, setpoint_pa=section.setpoint(state.begin_pa, tick.t_s - state.begin_s))
    if state.phase == "venting" and tick.t_s - state.begin_s >= VENT_S - ROUNDING_S:
        state = replace(state, phase="over")
    return replace(state, setpoint_pa=np.zeros_like(state.setpoint_pa))


def left_s(excitation: Excitation, state: ExcitationState, t_s: float) -> float:
    """Return the longest time left at `t_s` [s], the vent at the end included.

    Parameters
    ----------
    excitation : Excitation
        What is followed.
    state : ExcitationState
        State after a tick.
    t_s : float
        Time of that tick [s].
    """
    if state.phase != "running":
        return max(0.0, VENT_S - (t_s - state.begin_s)) if state.phase == "venting" else 0.0
    return excitation.plan.left_s(state.index, t_s - state.begin_s) + state.saved_s + VENT_S


def _received(state: ExcitationState, tick: ExcitationTick, still_s: float) -> ExcitationState:
    recent, arrived = dict(state.recent), dict(state.arrived_s)
    for name, found in tick.samples.items():
        good = tuple(one for one in found if _counts(one, tick))
        if good:
            recent[name] = (*recent.get(name, ()), *good)
            arrived[name] = tick.t_s
    return replace(state, recent=_last(recent, still_s), arrived_s=arrived)


def _counts(sample: Sample, tick: ExcitationTick) -> bool:
    """Whether a sample can be one; with a stamp from the future the arm would never be still again."""
    return sample.finite() and sample.stamp_s <= tick.t_s + AHEAD_S


def _last(recent: Mapping[str, tuple[Sample, ...]], time_s: float) -> dict[str, tuple[Sample, ...]]:
    """Return the samples of the last `time_s` of each sensor."""
    return {
        name: tuple(one for one in found if one.stamp_s >= found[-1].stamp_s - time_s - 1e-9)
        for name, found in recent.items()
    }


def _stop_reason(excitation: Excitation, state: ExcitationState, tick: ExcitationTick) -> str:
    """Return why an excitation cannot go on; empty if it can."""
    if tick.stop:
        return tick.stop
    if excitation.plan.sections[state.index].asks:  # the chambers are empty, and a hand moves the arm
        return ""
    limit_s = excitation.motion.config.silence_s
    for name, when in state.arrived_s.items():
        silent_s = tick.t_s - when
        if silent_s > limit_s:
            return f"no sample of sensors/{name} for {silent_s:.2f} s, allowed {limit_s:g} s (silence_s)"
    return ""


def _stopped(state: ExcitationState, t_s: float, reason: str) -> ExcitationState:
    return replace(state, phase="venting", begin_s=t_s, reason=reason)


def _moved(excitation: Excitation, state: ExcitationState, tick: ExcitationTick) -> ExcitationState:
    """Judge the motion, and go on to the next section where the present one is over."""
    section = excitation.plan.sections[state.index]
    if not section.asks:
        state, reason = _judged(excitation, state, tick)
        if reason:
            return _stopped(state, tick.t_s, reason)
    t = tick.t_s - state.begin_s
    lasts = section.lasts
    longest_s = section.longest_s
    if not lasts:
        longest_s += min(state.saved_s, (PATIENCE - 1.0) * section.hold_s)
    over = t >= longest_s - ROUNDING_S
    if not lasts and (over or t >= section.ramp_s + section.shortest_s):
        recent = _last(state.recent, section.shortest_s)
        still = is_still(excitation.motion, state.rest, recent, 0.9 * section.shortest_s)
        state = replace(state, restless=state.restless + (over and not still))
        over = over or still
    return _next(excitation, state, tick) if over or (section.asks and tick.answered) else state


def _judged(
    excitation: Excitation, state: ExcitationState, tick: ExcitationTick
) -> tuple[ExcitationState, str]:
    """Compare new samples with the limits."""
    strikes, reason = dict(state.strikes), ""
    for name, found in tick.samples.items():
        if name not in state.rest:
            continue
        for sample in found:
            if not _counts(sample, tick):
                continue
            is_outermost = name == excitation.outermost
            said = beyond(excitation.motion, state.rest[name], sample, is_outermost)
            strikes[name] = strikes.get(name, 0) + 1 if said else 0
            if strikes[name] >= IN_A_ROW:
                reason = reason or said
    return replace(state, strikes=strikes), reason


def _next(excitation: Excitation, state: ExcitationState, tick: ExcitationTick) -> ExcitationState:
    """Begin the next section, or end."""
    if state.index == 0:
        state = replace(state, rest={name: at_rest(found) for name, found in state.recent.items()})
        if reason := _wrong_rest(excitation, state):
            return _stopped(state, tick.t_s, reason)
    index = state.index + 1
    if index == len(excitation.plan.sections):
        return replace(state, phase="venting", begin_s=tick.t_s)
    if excitation.warned is not None and excitation.warned.index == index:
        return _stopped(state, tick.t_s, excitation.warned.reason)
    saved_s = state.saved_s + excitation.plan.sections[state.index].longest_s - (tick.t_s - state.begin_s)
    return replace(
        state, index=index, begin_s=tick.t_s, begin_pa=state.setpoint_pa, saved_s=max(0.0, saved_s)
    )


def _wrong_rest(excitation: Excitation, state: ExcitationState) -> str:
    """Return why the arm at rest is not within its limits; empty if it is."""
    rest = state.rest.get(excitation.outermost)
    if rest is None:
        return f"no sample of sensors/{excitation.outermost} has come"
    sample = state.recent[excitation.outermost][-1]
    said = beyond(excitation.motion, rest, sample, outermost=True)
    return f"before any pressure {said}" if said else ""
