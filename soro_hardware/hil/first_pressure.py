"""The first pressurisation: one chamber at a time, in small steps; a pure state machine of (state, sample).

It measures the rest, then for every chamber: it asks the operator, measures the rest again, holds and judges
steps, and times a vent. A failed step is the last one of its chamber; a trip of the limiter or a failed vent
ends the procedure.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from soro_core.arrays import Array
from soro_hardware.finding import Finding
from soro_hardware.hil import measured
from soro_hardware.hil.judge import judge_holds, judge_rest, judge_trip, judge_vent
from soro_hardware.hil.paced import CycleSample
from soro_hardware.hil.plan import NOT_EXAMINED, HilPlan, Order, ProcedureState

# A chamber counts as empty below this pressure [Pa], or below this part of the pressure before the vent.
EMPTY_PA, EMPTY_PART = 1e3, 0.1
# Rest before the first step of a chamber [s].
PAUSE_S = 0.5
YES, NO = ("y", "yes"), ("n", "no")
INTERRUPTED = "interrupted"


def advance(
    plan: HilPlan, state: ProcedureState, sample: CycleSample, answer: str | None = None
) -> tuple[ProcedureState, Order]:
    """Return state and order after one sample.

    Parameters
    ----------
    plan : HilPlan
        Steps and expectations.
    state : ProcedureState
        State after the last sample.
    sample : CycleSample
        Sample of the last cycle.
    answer : str or None
        The operator's answer to the open question, if any.

    Returns
    -------
    state : ProcedureState
    order : Order
        Order for the next cycle.
    """
    if state.phase == "done":
        return state, _zeros(plan)
    state = replace(state, samples=(*state.samples, sample))
    if sample.cause is not None and state.phase != "vent":
        return _tripped(plan, state, sample.cause)
    return _PHASES[state.phase](plan, state, answer)


def interrupted(plan: HilPlan, state: ProcedureState, why: str = INTERRUPTED) -> ProcedureState:
    """Return the state after the end of a procedure that was interrupted; the caller has vented.

    Parameters
    ----------
    plan : HilPlan
        Steps and expectations.
    state : ProcedureState
        State after the last sample.
    why : str
        Reason, for the report.
    """
    state = replace(state, findings=(*state.findings, *_of_chamber(plan, state)))
    return _over(plan, state, why, "start again")


def _rest(plan: HilPlan, state: ProcedureState, _: str | None) -> tuple[ProcedureState, Order]:
    if _elapsed(state) < plan.config.rest_s or not _all_fresh(state):
        return state, _zeros(plan)
    at_rest = measured.rest(state.samples)
    findings = tuple(judge_rest(plan.expected.names, at_rest))
    state = replace(state, rest=at_rest, findings=findings)
    if any(finding.level == "fail" for finding in findings):
        return _over(plan, state, "readings at rest are wrong"), _zeros(plan)
    return _begin(plan, state, 0, reset=False)


def _confirm(plan: HilPlan, state: ProcedureState, answer: str | None) -> tuple[ProcedureState, Order]:
    word = (answer or "").strip().lower()
    if word in YES or not plan.confirm:
        return replace(state, phase="settle", samples=state.samples[-1:], asks=False), _zeros(plan)
    if word in NO:
        name = plan.expected.names[state.chamber]
        state = replace(state, skipped=(*state.skipped, name))
        return _next_chamber(plan, state, reset=False)
    # Samples during the question are dropped.
    return replace(state, samples=state.samples[-1:]), _zeros(plan)


def _settle(plan: HilPlan, state: ProcedureState, _: str | None) -> tuple[ProcedureState, Order]:
    """Measure the rest just before a chamber: valves keep their play, and arms creep."""
    if _elapsed(state) < PAUSE_S or not _all_fresh(state):
        return state, _zeros(plan)
    return _hold_next(plan, replace(state, before=measured.rest(state.samples)), 0)


def _hold(plan: HilPlan, state: ProcedureState, _: str | None) -> tuple[ProcedureState, Order]:
    setpoint = plan.config.steps_pa[state.step]
    before = plan.config.steps_pa[state.step - 1] if state.step else 0.0
    ramp_s = (setpoint - before) / plan.config.rise_pa_s
    # A line that serves its chambers in turn needs several rounds for a mean.
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
        question = f"has the tip moved towards {plan.directions[state.chamber]}? [y/n]"
        return state, replace(_at(plan, state), question=question)
    return _vent_now(plan, state)


def _direction(plan: HilPlan, state: ProcedureState, answer: str | None) -> tuple[ProcedureState, Order]:
    word = (answer or "").strip().lower()
    if word not in YES + NO:
        return replace(state, samples=state.samples[-1:]), _at(plan, state)
    name = f"{plan.expected.names[state.chamber]}: bends"
    wanted = plan.directions[state.chamber]
    finding = Finding(name, "ok", f"towards {wanted}, by the operator's answer")
    if word in NO:
        found = f"not towards {wanted}, by the operator's answer"
        finding = Finding(name, "fail", found, "lines or robot file: swapped?")
    return _vent_now(plan, replace(state, answer=finding))


def _vent(plan: HilPlan, state: ProcedureState, _: str | None) -> tuple[ProcedureState, Order]:
    at_rest = state.before or state.rest
    assert at_rest is not None
    first = state.samples[0].reading_pa - at_rest.mean_pa
    low_pa = max(EMPTY_PA, EMPTY_PART * float(np.nan_to_num(first).max()))
    # The vent continues for a moment after all readings are low, to detect a reading that rises again.
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


def _next_chamber(plan: HilPlan, state: ProcedureState, reset: bool) -> tuple[ProcedureState, Order]:
    if state.chamber + 1 < len(plan.expected.names):
        return _begin(plan, state, state.chamber + 1, reset)
    return replace(_left_out(state), phase="done", samples=()), _zeros(plan)


def _left_out(state: ProcedureState) -> ProcedureState:
    """Add the finding that names the chambers that the operator skipped."""
    if not state.skipped:
        return state
    finding = Finding(
        NOT_EXAMINED, "warn", f"{', '.join(state.skipped)}: left out", "examine them before use"
    )
    return replace(state, findings=(*state.findings, finding))


def _begin(plan: HilPlan, state: ProcedureState, chamber: int, reset: bool) -> tuple[ProcedureState, Order]:
    state = replace(state, phase="confirm", chamber=chamber, samples=(), before=None, answer=None)
    state = replace(state, asks=plan.confirm)
    question = f"pressurise {plan.expected.names[chamber]} up to {plan.config.steps_pa[-1] / 1e3:g} kPa"
    question += "? [y/n]" if plan.confirm else ""  # without confirmation the text is an announcement
    return state, replace(_zeros(plan), do="reset" if reset else "hold", question=question)


def _hold_next(plan: HilPlan, state: ProcedureState, step: int) -> tuple[ProcedureState, Order]:
    state = replace(state, phase="hold", step=step, samples=state.samples[-1:])
    return state, _at(plan, state)


def _vent_now(plan: HilPlan, state: ProcedureState) -> tuple[ProcedureState, Order]:
    return replace(state, phase="vent", samples=state.samples[-1:], asks=False), replace(
        _zeros(plan), do="vent"
    )


def _tripped(plan: HilPlan, state: ProcedureState, cause: str) -> tuple[ProcedureState, Order]:
    """Add the findings so far and the trip; then vent."""
    if state.rest is None:
        found = (*judge_rest(plan.expected.names, measured.rest(state.samples)), judge_trip("at rest", cause))
        state = replace(state, findings=found, tripped=True)
        return _over(plan, state, "the limiter has vented"), _zeros(plan)
    trip = judge_trip(plan.expected.names[state.chamber], cause)
    return _vent_now(plan, replace(state, findings=(*state.findings, trip), tripped=True))


def _over(
    plan: HilPlan, state: ProcedureState, why: str, advice: str = "repair it, then start again"
) -> ProcedureState:
    seen = {hold.chamber for hold in state.holds} | (
        {state.chamber} if state.tripped and state.rest else set()
    )
    if why == INTERRUPTED and state.phase in ("settle", "hold", "direction", "vent"):
        seen.discard(state.chamber)  # its steps are incomplete
    left = [name for n, name in enumerate(plan.expected.names) if n not in seen and name not in state.skipped]
    if left:
        finding = Finding(NOT_EXAMINED, "fail", f"{', '.join(left)}: {why}", advice)
        state = replace(state, findings=(*state.findings, finding))
    return replace(_left_out(state), phase="done", samples=())


def _of_chamber(plan: HilPlan, state: ProcedureState) -> list[Finding]:
    """Return the findings of the present chamber."""
    if state.phase == "done":
        return []
    found = judge_holds(plan.expected, [hold for hold in state.holds if hold.chamber == state.chamber])
    return [*found, *([state.answer] if state.answer else [])]


def _elapsed(state: ProcedureState) -> float:
    return state.samples[-1].t_s - state.samples[0].t_s


def _low_for(state: ProcedureState, low_pa: Array) -> float:
    """Return the time [s] for which all readings have been at most `low_pa` (n,) [Pa]."""
    now_s = begin_s = state.samples[-1].t_s
    for sample in reversed(state.samples):
        if not bool(np.all(sample.reading_pa <= low_pa)):
            break
        begin_s = sample.t_s
    return now_s - begin_s


def _all_fresh(state: ProcedureState) -> bool:
    return bool(np.any([sample.fresh for sample in state.samples], axis=0).all())


def _zeros(plan: HilPlan) -> Order:
    return Order(np.zeros(len(plan.expected.names)))


def _at(plan: HilPlan, state: ProcedureState) -> Order:
    setpoint = np.zeros(len(plan.expected.names))
    setpoint[state.chamber] = plan.config.steps_pa[state.step]
    return Order(setpoint)
