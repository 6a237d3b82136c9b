"""The first pressurisation: one chamber at a time, in small steps; a pure machine of (state, sample).

Rest, then for every chamber: a question to the person who watches, a moment at rest that its readings are
compared with, steps that are held and judged, a vent that is timed. A step that fails is the chamber's last
one; a trip of the limiter or a vent that fails ends it all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from soro_core.hardware.finding import Finding
from soro_core.hardware.port import Array
from soro_core.hil import measured
from soro_core.hil.judge import judge_holds, judge_rest, judge_trip, judge_vent
from soro_core.hil.paced import Sample
from soro_core.hil.plan import NOT_EXAMINED, Order, Plan, State

# What counts as empty after a vent: this, or this part of the pressure before.
EMPTY_PA, EMPTY_PART = 1e3, 0.1
# Rest before the first step of a chamber.
PAUSE_S = 0.5
YES, NO = ("y", "yes"), ("n", "no")
INTERRUPTED = "interrupted"


def advance(plan: Plan, state: State, sample: Sample, answer: str | None = None) -> tuple[State, Order]:
    """Take one sample in, and what a person may have answered.

    Parameters
    ----------
    sample : Sample
        Of the last cycle.
    answer : str or None
        A line, to the question of the last order.

    Returns
    -------
    state : State
    order : Order
        For the next cycle.
    """
    if state.phase == "done":
        return state, _zeros(plan)
    state = replace(state, samples=(*state.samples, sample))
    if sample.cause is not None and state.phase != "vent":
        return _tripped(plan, state, sample.cause)
    return _PHASES[state.phase](plan, state, answer)


def interrupted(plan: Plan, state: State, why: str = INTERRUPTED) -> State:
    """End it where it is; the loop has vented."""
    state = replace(state, findings=(*state.findings, *_of_chamber(plan, state)))
    return _over(plan, state, why, "begin again")


def _rest(plan: Plan, state: State, _: str | None) -> tuple[State, Order]:
    if _elapsed(state) < plan.config.rest_s or not _all_fresh(state):
        return state, _zeros(plan)
    at_rest = measured.rest(state.samples)
    findings = tuple(judge_rest(plan.expected.names, at_rest))
    state = replace(state, rest=at_rest, findings=findings)
    if any(finding.level == "fail" for finding in findings):
        return _over(plan, state, "readings at rest are wrong"), _zeros(plan)
    return _begin(plan, state, 0, reset=False)


def _confirm(plan: Plan, state: State, answer: str | None) -> tuple[State, Order]:
    word = (answer or "").strip().lower()
    if word in YES or not plan.confirm:
        return replace(state, phase="settle", samples=state.samples[-1:], asks=False), _zeros(plan)
    if word in NO:
        name = plan.expected.names[state.chamber]
        state = replace(state, skipped=(*state.skipped, name))
        return _next_chamber(plan, state, reset=False)
    # Only what is new counts, however long the answer takes.
    return replace(state, samples=state.samples[-1:]), _zeros(plan)


def _settle(plan: Plan, state: State, _: str | None) -> tuple[State, Order]:
    """Valves keep their play and arms creep: what a chamber changes counts from just before it."""
    if _elapsed(state) < PAUSE_S or not _all_fresh(state):
        return state, _zeros(plan)
    return _hold_next(plan, replace(state, before=measured.rest(state.samples)), 0)


def _hold(plan: Plan, state: State, _: str | None) -> tuple[State, Order]:
    setpoint = plan.config.steps_pa[state.step]
    before = plan.config.steps_pa[state.step - 1] if state.step else 0.0
    ramp_s = (setpoint - before) / plan.config.rise_pa_s
    # A line that serves its chambers in turn needs some rounds for a mean.
    if _elapsed(state) < max(plan.config.hold_s, 12 * plan.expected.update_s) + ramp_s:
        return state, _at(plan, state)
    assert state.before is not None
    done = measured.hold(state.samples, state.chamber, setpoint, state.before)
    state = replace(state, holds=(*state.holds, done))
    if any(finding.level == "fail" for finding in _of_chamber(plan, state)):
        return _vent_now(plan, state)
    if state.step + 1 < len(plan.config.steps_pa):
        return _hold_next(plan, state, state.step + 1)
    if plan.directions:
        state = replace(state, phase="direction", samples=(), asks=True)
        return state, replace(_at(plan, state), question=_which_way(plan, state))
    return _vent_now(plan, state)


def _direction(plan: Plan, state: State, answer: str | None) -> tuple[State, Order]:
    word = (answer or "").strip().lower()
    if word not in YES + NO:
        return replace(state, samples=state.samples[-1:]), _at(plan, state)
    name = f"{plan.expected.names[state.chamber]}: bends"
    wanted = plan.directions[state.chamber]
    told = Finding(name, "ok", f"towards {wanted}, says the person who watches")
    if word in NO:
        told = Finding(
            name,
            "fail",
            f"not towards {wanted}, says the person who watches",
            "lines or robot file: swapped?",
        )
    return _vent_now(plan, replace(state, answer=told))


def _vent(plan: Plan, state: State, _: str | None) -> tuple[State, Order]:
    at_rest = state.before or state.rest
    assert at_rest is not None
    first = state.samples[0].reading_pa - at_rest.mean_pa
    low_pa = max(EMPTY_PA, EMPTY_PART * float(np.nan_to_num(first).max()))
    # A moment longer than until all is low, so that a reading that comes back up is seen.
    settled = _low_for(state, at_rest.mean_pa + low_pa) > 0.1 + 2 * plan.expected.update_s
    if not settled and _elapsed(state) < plan.config.vent_s:
        return state, _zeros(plan)
    done = measured.vent(state.samples, state.chamber, low_pa, at_rest)
    found = (*_of_chamber(plan, state), judge_vent(plan.expected, done))
    state = replace(state, vents=(*state.vents, done), findings=(*state.findings, *found))
    if state.tripped:
        return _over(plan, state, "the limiter has vented"), _zeros(plan)
    if found[-1].level == "fail":
        return _over(plan, state, "a vent failed"), _zeros(plan)
    return _next_chamber(plan, state, reset=True)


_PHASES = {
    "rest": _rest,
    "confirm": _confirm,
    "settle": _settle,
    "hold": _hold,
    "direction": _direction,
    "vent": _vent,
}


def _next_chamber(plan: Plan, state: State, reset: bool) -> tuple[State, Order]:
    if state.chamber + 1 < len(plan.expected.names):
        return _begin(plan, state, state.chamber + 1, reset)
    return replace(_left_out(state), phase="done", samples=()), _zeros(plan)


def _left_out(state: State) -> State:
    """Name the chambers that the person who watches has said no to."""
    if not state.skipped:
        return state
    told = Finding(NOT_EXAMINED, "warn", f"{', '.join(state.skipped)}: left out", "examine them before use")
    return replace(state, findings=(*state.findings, told))


def _begin(plan: Plan, state: State, chamber: int, reset: bool) -> tuple[State, Order]:
    state = replace(state, phase="confirm", chamber=chamber, samples=(), before=None, answer=None)
    state = replace(state, asks=plan.confirm)
    question = f"pressurise {plan.expected.names[chamber]} up to {plan.config.steps_pa[-1] / 1e3:g} kPa"
    question += "? [y/n]" if plan.confirm else ""  # without one it says what happens now
    return state, replace(_zeros(plan), do="reset" if reset else "hold", question=question)


def _hold_next(plan: Plan, state: State, step: int) -> tuple[State, Order]:
    state = replace(state, phase="hold", step=step, samples=state.samples[-1:])
    return state, _at(plan, state)


def _vent_now(plan: Plan, state: State) -> tuple[State, Order]:
    return replace(state, phase="vent", samples=state.samples[-1:], asks=False), replace(
        _zeros(plan), do="vent"
    )


def _tripped(plan: Plan, state: State, cause: str) -> tuple[State, Order]:
    """Say what was measured so far, then watch the air go."""
    if state.rest is None:
        found = (*judge_rest(plan.expected.names, measured.rest(state.samples)), judge_trip("at rest", cause))
        state = replace(state, findings=found, tripped=True)
        return _over(plan, state, "the limiter has vented"), _zeros(plan)
    told = judge_trip(plan.expected.names[state.chamber], cause)
    return _vent_now(plan, replace(state, findings=(*state.findings, told), tripped=True))


def _over(plan: Plan, state: State, why: str, advice: str = "mend that, then begin again") -> State:
    seen = {hold.chamber for hold in state.holds} | (
        {state.chamber} if state.tripped and state.rest else set()
    )
    if why == INTERRUPTED and state.phase in ("settle", "hold", "direction", "vent"):
        seen.discard(state.chamber)  # not to its end
    left = [name for n, name in enumerate(plan.expected.names) if n not in seen and name not in state.skipped]
    if left:
        told = Finding(NOT_EXAMINED, "fail", f"{', '.join(left)}: {why}", advice)
        state = replace(state, findings=(*state.findings, told))
    return replace(_left_out(state), phase="done", samples=())


def _of_chamber(plan: Plan, state: State) -> list[Finding]:
    """What is known of the chamber in hand."""
    if state.phase == "done":
        return []
    found = judge_holds(plan.expected, [hold for hold in state.holds if hold.chamber == state.chamber])
    return [*found, *([state.answer] if state.answer else [])]


def _which_way(plan: Plan, state: State) -> str:
    return f"has the tip moved towards {plan.directions[state.chamber]}? [y/n]"


def _elapsed(state: State) -> float:
    return state.samples[-1].t_s - state.samples[0].t_s


def _low_for(state: State, low_pa: Array) -> float:
    """For how long all readings have been below (n,) [Pa]."""
    now_s = begin_s = state.samples[-1].t_s
    for sample in reversed(state.samples):
        if not bool(np.all(sample.reading_pa <= low_pa)):
            break
        begin_s = sample.t_s
    return now_s - begin_s


def _all_fresh(state: State) -> bool:
    return bool(np.any([sample.fresh for sample in state.samples], axis=0).all())


def _zeros(plan: Plan) -> Order:
    return Order(np.zeros(len(plan.expected.names)))


def _at(plan: Plan, state: State) -> Order:
    setpoint = np.zeros(len(plan.expected.names))
    setpoint[state.chamber] = plan.config.steps_pa[state.step]
    return Order(setpoint)
