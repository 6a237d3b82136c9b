"""Runs with implicit steppers: one kernel, parametrised by a `Scheme`.

The model takes long to compile, so a single function calls it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from soro_core._box import Box, view
from soro_core._jit import inner, kernel
from soro_core.arrays import Array
from soro_core.integrate.air import Air, breathe
from soro_core.integrate.balance import begin_balance, keep_balance
from soro_core.integrate.newton import Outside, solve_stage
from soro_core.integrate.step_work import EARLIER, LATEST, StepInput, Stepping, StepWork, assign_state
from soro_core.integrate.steppers.scheme import Scheme, stage_of
from soro_core.integrate.system import CLOSED, NOT_RESOLVED, StageEquation, interpolate, jumps
from soro_core.model.dynamics import BAD_INPUT, GOOD, NOT_FINITE, check, finite
from soro_core.model.forces.internal import advance_internal
from soro_core.model.links.linear import assign, clear
from soro_core.model.links.sweep import NO, YES
from soro_core.model.records import ArmState

# Smallest fraction of a step that is divided.
SMALLEST_PART = 1.0 / 65536.0


class StepSize(NamedTuple):
    """Length of a step [s], and whether it is one of the method's fallback: `damped` above 0."""

    h: float
    damped: float


class StageStart(NamedTuple):
    """Where a stage of a step of length h stands."""

    stage: int
    first: int
    """First stage of the step."""
    known: int
    """How many accelerations in `work.memory` are valid."""
    h: float


@inner
def begin_stage(m: Scheme, work: StepWork, at: StageStart, start: ArmState, last: ArmState) -> None:
    """work.q_base, .v_base <- bases of the stage, docs/model.md (32), (33); .acceleration <- first guess.

    `start` is the state at the start of the step, `last` that of the last stage.
    """
    stage, first, known, h = at
    x, q_base, v_base, weight, memory = work.acceleration, work.q_base, work.v_base, work.weight, work.memory
    q0, v0, q_last, v_last = start.q, start.v, last.q, last.v
    c = stage_of(m.stages, stage)
    started = stage > first
    part = c.place / stage_of(m.stages, first).place if started else (c.place if m.start else 1.0)
    move = 0.0
    for b in range(x.shape[0]):
        a0 = memory[LATEST, b] if known > 0 else 0.0
        before = memory[EARLIER, b] if known > 1 else a0
        a_last = x[b] if started else 0.0
        v_base[b] = v0[b] + h * (c.v_a0 * a0 + c.v_a * a_last)
        q_base[b] = q0[b] + h * (c.q_v0 * v0[b] + c.q_v * v_last[b] + h * (c.q_a0 * a0 + c.q_a * a_last))
        # Linear extrapolation of the two latest accelerations.
        x[b] = a0 + part * ((a_last - a0) if started else (a0 - before))
        move += ((q_base[b] + c.c_q * h * h * x[b] - q_last[b]) * weight[b]) ** 2
    if not move < m.far * m.far:
        # In a stiff arm, velocity and acceleration do not predict the state a step later.
        for b in range(x.shape[0]):
            x[b] = (q_last[b] - q_base[b]) / (c.c_q * h * h)


@inner
def extrapolate(
    outside: Outside, run: Stepping, h: float, place: float, start: ArmState, end: ArmState
) -> int:
    """Extrapolate `end` linearly from the fraction `place` of a step to its end; internal states follow."""
    q0, v0, z0 = start
    q1, v1, z1 = end
    for b in range(q0.shape[0]):
        q1[b] = q0[b] + (q1[b] - q0[b]) / place
        v1[b] = v0[b] + (v1[b] - v0[b]) / place
    code = check(run.tables, q1, v1)
    if code != GOOD:
        return code
    advance_internal(run.tables, z0, (v0, v1), h, z1, run.work.tangent)
    if not breathe(outside.air, run, q1, z0, h, z1):
        return CLOSED
    return GOOD if finite(z1) else NOT_FINITE


@inner
def implicit_step(
    m: Scheme, outside: Outside, run: Stepping, size: StepSize, start: ArmState, end: ArmState
) -> int:
    """Make a step with the pressures in `work.pressure`; give a code.

    Writes the acceleration of the last stage to `work.acceleration`.
    """
    work, clock = run.work, run.tables.external.clock
    h, damped = size
    x = work.acceleration
    first, behind = (m.own, m.stages.shape[0]) if damped > 0.0 else (0, m.own)
    # Stored accelerations are that at the start of the step, or only a guess of it.
    at_start = m.start or damped > 0.0
    known = work.known[0] if m.start or not at_start else 0
    guessed = known < 2
    last = start
    for stage in range(first - 1 if at_start and known == 0 else first, behind):
        new = end
        if stage < first:
            # The acceleration at the start: M x = forces, linear in x.
            equation = StageEquation(0.0, 0.0, 0.0, math.inf, 1)
            clock[0] = clock[1]
            assign(work.pressure[0], work.command)
            assign(start.q, work.q_base)
            assign(start.v, work.v_base)
            clear(x)
        else:
            c = stage_of(m.stages, stage)
            clock[0] = clock[1] + c.place * h
            sweeps = 2 if m.linear and guessed and stage == first else 1
            equation = StageEquation(c.c_q * h * h, c.c_v * h, c.span * h, m.tolerance, sweeps)
            interpolate(work.pressure, c.place, work.command)
            begin_stage(m, work, StageStart(stage, first, known, h), start, last)
            if stage + 1 < behind:
                new = ArmState(work.q_stage, work.v_stage, work.z_stage)
        code = solve_stage(outside, run, equation, last, new)
        if code != GOOD:
            return code
        if stage < first:
            assign(x, work.memory[LATEST])
            work.known[0] = known = 1
        else:
            last = new
    code = GOOD
    place = stage_of(m.stages, behind - 1).place
    if place < 1.0:
        code = extrapolate(outside, run, h, place, start, end)
    moved, swing = 0.0, 0.0
    for b in range(x.shape[0]):
        moved += ((end.q[b] - start.q[b]) * work.weight[b]) ** 2
        swing = max(swing, abs(x[b]) * work.weight[b])
    if code == GOOD and (moved > m.far * m.far or (damped == 0.0 and 0.25 * h * h * swing > m.resolved)):
        return NOT_RESOLVED
    return code


@kernel
def implicit_run(
    m: Scheme,
    air: Air,
    box: Box,
    given: tuple[Array, Array, Array],
    rows: tuple[Array, Array, Array],
) -> tuple[int, int]:
    """Fill the rows q, v, z (n_t, ...) from their first ones; gives (last good row, code).

    `given` has times (n_t,), pressures of the chambers or, with valves, their set points (n_t, 3, n_u), and
    wrenches.
    """
    run = view(box)
    work = run.work
    times, pressure, wrench = given
    q, v, z = rows
    outside = Outside(air, wrench)
    start = ArmState(work.q_start, work.v_start, work.z_start)
    work.known[0], work.energy[0] = 0, math.inf
    damped = NO
    code = check(run.tables, q[0], v[0])
    if code != GOOD or not finite(z[0]):
        return 0, code if code != GOOD else NOT_FINITE
    for k in range(times.shape[0] - 1):
        row, end = pressure[k], ArmState(q[k + 1], v[k + 1], z[k + 1])
        held = StepInput(row, wrench)
        if not (finite(row[0]) and finite(row[1]) and finite(row[2]) and finite(wrench)):
            return k, BAD_INPUT
        if k > 0 and m.start and jumps(pressure[k - 1], row):
            # The stored acceleration belongs to other pressures.
            work.known[0] = 0
        assign_state(ArmState(q[k], v[k], z[k]), start)
        begin_balance(m, run, held, start)
        # Fractions of the step are powers of 2, so their sums are exact.
        done, part, damped = 0.0, 1.0, NO
        while done < 1.0:
            h = part * (times[k + 1] - times[k])
            run.tables.external.clock[1] = times[k] - times[0] + done * (times[k + 1] - times[k])
            for i in range(3):
                interpolate(row, done + 0.5 * i * part, work.pressure[i])
            code = implicit_step(m, outside, run, StepSize(h, damped), start, end)
            if code == GOOD:
                code = keep_balance(m, run, held, start, end)
            if code == GOOD:
                done += part
                assign_state(end, start)
                assign(work.memory[LATEST], work.memory[EARLIER])
                assign(work.acceleration, work.memory[LATEST])
                work.known[0] = 1 if damped > 0.0 else min(work.known[0] + 1, 2)
                # To the end of a divided step, motion faster than its parts stays damped.
                damped = YES if part < 1.0 and m.own < m.stages.shape[0] else NO
                if part < 1.0 and done % (2.0 * part) == 0.0:
                    part *= 2.0
                    work.known[0] = min(work.known[0], 1)
            elif damped == 0.0 and m.own < m.stages.shape[0]:
                damped = YES
            else:
                part *= 0.5
                work.known[0] = min(work.known[0], 1)
                if part < SMALLEST_PART:
                    return k, code
    return times.shape[0] - 1, GOOD
