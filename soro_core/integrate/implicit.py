"""Runs with implicit steppers: one kernel, parametrised by a `Scheme`.

The model takes long to compile, so a single function calls it.
"""

from __future__ import annotations

import math

from soro_core._box import Box, view
from soro_core._jit import inner, kernel
from soro_core.arrays import Array
from soro_core.integrate.air import Air, breathe
from soro_core.integrate.balance import begin_balance, keep_balance
from soro_core.integrate.newton import solve_stage
from soro_core.integrate.steppers.scheme import Scheme, stage_of
from soro_core.integrate.system import CLOSED, EARLIER, LATEST, NOT_RESOLVED, StepWork, interpolate, jumps
from soro_core.model.dynamics import BAD_INPUT, GOOD, NOT_FINITE, check, finite
from soro_core.model.forces.internal import advance_internal
from soro_core.model.links.linear import assign, clear
from soro_core.model.links.sweep import NO, YES
from soro_core.model.tables import Tables

# Smallest fraction of a step that is divided.
SMALLEST_PART = 1.0 / 65536.0


@inner
def begin_stage(
    m: Scheme,
    stage: int,
    first: int,
    known: int,
    weight: Array,
    memory: Array,
    q0: Array,
    v0: Array,
    q_last: Array,
    v_last: Array,
    h: float,
    x: Array,
    q_base: Array,
    v_base: Array,
) -> None:
    """q_base, v_base <- bases of the stage, docs/model.md (32), (33); x <- first guess of its acceleration.

    The first `known` accelerations in `memory` are valid; `q_last`, `v_last` are those of the last stage.
    """
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
    t: Tables,
    air: Air,
    work: StepWork,
    h: float,
    place: float,
    q0: Array,
    v0: Array,
    z0: Array,
    q1: Array,
    v1: Array,
    z1: Array,
) -> int:
    """Extrapolate q1, v1 linearly from the fraction `place` of a step to its end; z1 follows them."""
    for b in range(q0.shape[0]):
        q1[b] = q0[b] + (q1[b] - q0[b]) / place
        v1[b] = v0[b] + (v1[b] - v0[b]) / place
    code = check(t, q1, v1)
    if code != GOOD:
        return code
    advance_internal(t, z0, v0, v1, h, z1, work.tangent)
    if not breathe(air, t, q1, z0, work.command, h, z1, work.stage_pressure, work.pressure_slope):
        return CLOSED
    return GOOD if finite(z1) else NOT_FINITE


@inner
def implicit_step(
    m: Scheme,
    air: Air,
    t: Tables,
    work: StepWork,
    damped: float,
    q0: Array,
    v0: Array,
    z0: Array,
    wrench: Array,
    h: float,
    q1: Array,
    v1: Array,
    z1: Array,
) -> int:
    """Make a step with the pressures in `work.pressure`; give a code.

    The step is that of the method, or of its fallback if `damped` is above 0. Writes the acceleration of the
    last stage to `work.acceleration`.
    """
    x, q_base, v_base = work.acceleration, work.q_base, work.v_base
    first, behind = (m.own, m.stages.shape[0]) if damped > 0.0 else (0, m.own)
    # Stored accelerations are that at the start of the step, or only a guess of it.
    at_start = m.start or damped > 0.0
    known = work.known[0] if m.start or not at_start else 0
    guessed = known < 2
    q_last, v_last, z_last = q0, v0, z0
    for stage in range(first - 1 if at_start and known == 0 else first, behind):
        q_new, v_new, z_new = q1, v1, z1
        if stage < first:
            # The acceleration at the start: M x = forces, linear in x.
            span, c_q, c_v, tolerance, sweeps = 0.0, 0.0, 0.0, math.inf, 1
            assign(work.pressure[0], work.command)
            assign(q0, q_base)
            assign(v0, v_base)
            clear(x)
        else:
            c = stage_of(m.stages, stage)
            span, c_q, c_v, tolerance = c.span * h, c.c_q * h * h, c.c_v * h, m.tolerance
            sweeps = 2 if m.linear and guessed and stage == first else 1
            interpolate(work.pressure, c.place, work.command)
            begin_stage(
                m, stage, first, known, work.weight, work.memory, q0, v0, q_last, v_last, h, x, q_base, v_base
            )
            if stage + 1 < behind:
                q_new, v_new, z_new = work.q_stage, work.v_stage, work.z_stage
        code = solve_stage(
            t,
            air,
            work,
            q_base,
            v_base,
            c_q,
            c_v,
            z_last,
            v_last,
            span,
            wrench,
            tolerance,
            sweeps,
            x,
            q_new,
            v_new,
            z_new,
        )
        if code != GOOD:
            return code
        if stage < first:
            assign(x, work.memory[LATEST])
            work.known[0] = known = 1
        else:
            q_last, v_last, z_last = q_new, v_new, z_new
    code = GOOD
    place = stage_of(m.stages, behind - 1).place
    if place < 1.0:
        code = extrapolate(t, air, work, h, place, q0, v0, z0, q1, v1, z1)
    moved, swing = 0.0, 0.0
    for b in range(x.shape[0]):
        moved += ((q1[b] - q0[b]) * work.weight[b]) ** 2
        swing = max(swing, abs(x[b]) * work.weight[b])
    if code == GOOD and (moved > m.far * m.far or (damped == 0.0 and 0.25 * h * h * swing > m.resolved)):
        return NOT_RESOLVED
    return code


@kernel
def implicit_run(
    m: Scheme,
    air: Air,
    box: Box,
    times: Array,
    pressure: Array,
    wrench: Array,
    q: Array,
    v: Array,
    z: Array,
) -> tuple[int, int]:
    """Fill q, v, z (n_t, ...) from their first rows; gives (last good row, code).

    `pressure` (n_t, 3, n_u) holds the pressures of the chambers or, with valves, their set points.
    """
    stepping = view(box)
    t, work = stepping.tables, stepping.work
    q0, v0, z0 = work.q_start, work.v_start, work.z_start
    work.known[0], work.energy[0] = 0, math.inf
    damped = NO
    code = check(t, q[0], v[0])
    if code != GOOD or not finite(z[0]):
        return 0, code if code != GOOD else NOT_FINITE
    for k in range(times.shape[0] - 1):
        row, q1, v1, z1 = pressure[k], q[k + 1], v[k + 1], z[k + 1]
        if not (finite(row[0]) and finite(row[1]) and finite(row[2]) and finite(wrench)):
            return k, BAD_INPUT
        if k > 0 and m.start and jumps(pressure[k - 1], row):
            # The stored acceleration belongs to other pressures.
            work.known[0] = 0
        assign(q[k], q0)
        assign(v[k], v0)
        assign(z[k], z0)
        begin_balance(m, t, work, row, wrench, q0, v0, z0)
        # Fractions of the step are powers of 2, so their sums are exact.
        done, part, damped = 0.0, 1.0, NO
        while done < 1.0:
            h = part * (times[k + 1] - times[k])
            for i in range(3):
                interpolate(row, done + 0.5 * i * part, work.pressure[i])
            code = implicit_step(m, air, t, work, damped, q0, v0, z0, wrench, h, q1, v1, z1)
            if code == GOOD:
                code = keep_balance(m, t, work, row, wrench, q0, q1, v1, z1)
            if code == GOOD:
                done += part
                assign(q1, q0)
                assign(v1, v0)
                assign(z1, z0)
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
