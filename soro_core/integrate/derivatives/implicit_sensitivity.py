"""Sensitivities of an implicit step: the implicit function theorem in each stage, docs/model.md (48)."""

from __future__ import annotations

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.integrate.derivatives.sensitivity import (
    A_START,
    LAST,
    STAGE,
    START,
    V_LAST,
    A,
    Q,
    StepDerivation,
    StepRule,
    V,
    follow,
    solve_stage,
)
from soro_core.integrate.step_work import EARLIER, StepInput, Stepping
from soro_core.integrate.steppers.scheme import stage_of
from soro_core.model.derivative.equation import equation_derivatives
from soro_core.model.forces.internal import internal_slopes
from soro_core.model.links.linear import assign, assign_matrix, clear
from soro_core.model.records import ArmState, Motion
from soro_core.model.tables import Tables


@inner
def _implicit_stage(t: Tables, room: StepDerivation, stages: Array, stage: int, h: float) -> bool:
    """Add a stage of a `Scheme`, or for `stage` = -1 the acceleration at the start; False if it is singular.

    The slopes of the internal states over the stage are known.
    """
    d, s = room.equation, room.sensitivity
    c = stage_of(stages, max(stage, 0))
    c_q, c_v = h * h * c.c_q, h * c.c_v
    if stage < 0:
        c_q = c_v = 0.0
        assign_matrix(s.q[START], s.q[STAGE])
        assign_matrix(s.v[START], s.v[STAGE])
    else:
        for w in range(s.q.shape[1]):
            for b in range(s.q.shape[2]):
                v0, a0, a = s.v[START, w, b], s.a[START, w, b], s.a[LAST, w, b]
                s.v[STAGE, w, b] = v0 + h * (c.v_a0 * a0 + c.v_a * a)
                moved = c.q_v0 * v0 + c.q_v * s.v[LAST, w, b] + h * (c.q_a0 * a0 + c.q_a * a)
                s.q[STAGE, w, b] = s.q[START, w, b] + h * moved
    follow(t, s, LAST)
    good = solve_stage(t, d, s, c_q, c_v)
    if stage < 0:
        assign_matrix(s.a[STAGE], s.a[START])
    else:
        assign_matrix(s.v[STAGE], s.v[LAST])
        assign_matrix(s.a[STAGE], s.a[LAST])
        assign_matrix(s.z[STAGE], s.z[LAST])
    return bool(good)


@inner
def follow_implicit(
    room: StepDerivation, run: Stepping, rule: StepRule, start: ArmState, held: StepInput
) -> bool:
    """Follow the stages of a `Scheme`; leave q and v of its new state in `point`. False if it is singular."""
    t, work, d, s = run.tables, run.work, room.equation, room.sensitivity
    stages, own, h = rule.coefficients, rule.own, rule.h
    q0, v0, z0 = start
    q, v, a, v_last, a0 = s.point[Q], s.point[V], s.point[A], s.point[V_LAST], s.point[A_START]
    clear(a0)
    clear(a)
    assign(v0, v_last)
    z_last = z0
    good = True
    if rule.at_start:
        assign(work.memory[EARLIER], a0)
        equation_derivatives(t, d, held.pressure, held.wrench, Motion(q0, v0, v0, a0))
        internal_slopes(t, z0, v0, v0, 0.0, s.slope)
        good = _implicit_stage(t, room, stages, -1, h)
    for k in range(own):
        c = stage_of(stages, k)
        for b in range(q.shape[0]):
            v_base = v0[b] + h * (c.v_a0 * a0[b] + c.v_a * a[b])
            q_base = q0[b] + h * (c.q_v0 * v0[b] + c.q_v * v_last[b] + h * (c.q_a0 * a0[b] + c.q_a * a[b]))
            # The acceleration of a stage before the last is known by its velocity.
            last = k == own - 1
            a[b] = work.acceleration[b] if last else (work.v_stage[b] - v_base) / (h * c.c_v)
            q[b] = q_base + h * h * c.c_q * a[b]
            v[b] = v_base + h * c.c_v * a[b]
        equation_derivatives(t, d, held.pressure, held.wrench, Motion(q, v, v, a))
        internal_slopes(t, z_last, v_last, v, h * c.span, s.slope)
        good = good and _implicit_stage(t, room, stages, k, h)
        assign(v, v_last)
        z_last = work.z_stage
    place = stage_of(stages, own - 1).place
    if place < 1.0:
        for b in range(q.shape[0]):
            q[b] = q0[b] + (q[b] - q0[b]) / place
            v[b] = v0[b] + (v[b] - v0[b]) / place
            for w in range(s.q.shape[1]):
                s.q[STAGE, w, b] = s.q[START, w, b] + (s.q[STAGE, w, b] - s.q[START, w, b]) / place
                s.v[STAGE, w, b] = s.v[START, w, b] + (s.v[STAGE, w, b] - s.v[START, w, b]) / place
        internal_slopes(t, z0, v0, v, h, s.slope)
        follow(t, s, START)
    return good
