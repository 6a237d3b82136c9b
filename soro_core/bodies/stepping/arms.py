"""Arms over a step of a world: their sections, what an impulse adds, Newton's iteration around the contacts.

An arm is stepped as by the implicit steppers (`soro_core.integrate.newton`), with the part theta of the step
of `moving`. Its factored system A = M + theta h R + (theta h)^2 K gives what impulses at its contacts add to
its velocity, A^-1 G' P: the contacts see the arm as it is within the step, with stiffness and damping.
"""

from __future__ import annotations

import math

from soro_core._box import view_at
from soro_core._by_type import select_by_type
from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.bodies.stepping.impulses import set_blocks, solve_impulses
from soro_core.bodies.stepping.mounts import (
    close_carriers,
    locate_mount,
    note_tip,
    ride_on_carrier,
    solve_mover,
    weigh_mount,
)
from soro_core.bodies.stepping.records import ArmTables, NoArm, StepPart, WorldTables
from soro_core.bodies.stepping.vectors import cross, dot, subtract
from soro_core.integrate.air import NO_AIR
from soro_core.integrate.base_motion import WIDTH, move_base
from soro_core.integrate.newton import MAX_ITERATIONS, ROUND_OFF, SLOW
from soro_core.integrate.step_work import Stepping
from soro_core.integrate.system import StageEquation, factor, force_residual, interpolate
from soro_core.model.dynamics import GOOD, NOT_CONVERGED, NOT_FINITE, SINGULAR, check, finite
from soro_core.model.forces.internal import advance_internal
from soro_core.model.links.linear import assign, assign_matrix
from soro_core.model.links.sweep import NO, YES
from soro_core.model.method import kinematics
from soro_core.model.records import ArmState, CrossSection
from soro_core.model.tables import BaseMotion, FixedBase, Site

# Code of contacts whose impulses do not converge, beside those of the steppers.
SLIDING = 35
# How an arm's system is factored: as it was, with the derivative of friction, or with its secant.
KEPT, BY_TANGENT, BY_SECANT = 0, 1, 2
# Largest error of a step of q relative to its scale.
ARM_TOLERANCE = 1e-9


@inner
def _no_twist(e: BaseMotion, inputs: Array, twist: Array) -> None:
    return


@inner
def _base_twist(e: BaseMotion, inputs: Array, twist: Array) -> None:
    n = inputs.shape[0] - WIDTH
    for r in range(3):
        twist[r] = twist[3 + r] = 0.0
        for c in range(3):
            twist[r] += inputs[n + 3 * r + c] * inputs[n + 12 + c]
            twist[3 + r] += inputs[n + 3 * r + c] * inputs[n + 15 + c]


base_twist = select_by_type(FixedBase, _no_twist, _base_twist)
"""base_twist(t.base, inputs, twist): twist (6,) <- angular and linear velocity of a base in the world."""


@inner
def _locate_none(
    like: NoArm, arms: ArmTables, w: WorldTables, span: StepPart, now: tuple[Array, Array, Array]
) -> int:
    return GOOD


@inner
def _locate(
    like: Stepping, arms: ArmTables, w: WorldTables, span: StepPart, now: tuple[Array, Array, Array]
) -> int:
    q, v, _ = now
    start = w.movers.start
    for i in range(arms.address.shape[0]):
        run = view_at(like, arms.address[i])
        first, behind = arms.first_q[i], arms.first_q[i + 1]
        m, c = arms.mover[i], arms.column[i]
        at = q[first:behind]
        arms.failed[0] = i
        code = check(run.tables, at, v[first:behind])
        if code != GOOD:
            return code
        own = span.pressure[:, arms.first_u[i] : arms.first_u[i + 1]]
        interpolate(own, span.done + span.part, run.work.stage_pressure)
        base_twist(run.tables.base, run.work.stage_pressure, arms.base_twist[i])
        interpolate(own, span.done, run.work.stage_pressure)
        move_base(run.tables.base, run.tables, run.work.stage_pressure)
        for r in range(3):
            arms.base_place[i, r] = run.tables.base_position[r]
        locate_mount(run.tables.base, arms, i, run, v)
        for b in range(start.shape[1] - c):
            start[m, c + b] = w.movers.free[m, c + b] = v[first + b] if first + b < behind else 0.0
        for s in range(arms.first_site[i], arms.first_site[i + 1]):
            site = Site(arms.link[s], arms.place[s], arms.whole[s], arms.step[s], arms.shape[s], arms.rest[s])
            section = CrossSection(arms.R[s], arms.p[s], arms.columns[s, : behind - first])
            kinematics(run.tables, run.work.model, site, at, section)
    return GOOD


locate_arms = select_by_type(NoArm, _locate_none, _locate)
"""locate_arms(like, arms, w, span, (q, v, z)): sections, and velocities in w.movers.

It also finds the motion of the bases at the end of the span; gives a code."""


@inner
def arm_speed(arms: ArmTables, w: WorldTables) -> float:
    """Largest speed of a section [m/s], at most: that of the base and that seen from there."""
    largest, arm, v = 0.0, w.points[0], w.points[1]
    for i in range(arms.address.shape[0]):
        base = arms.base_twist[i]
        own_start = w.movers.start[arms.mover[i], arms.column[i] :]
        n = arms.first_q[i + 1] - arms.first_q[i]
        for s in range(arms.first_site[i], arms.first_site[i + 1]):
            subtract(arms.p[s], arms.base_place[i], arm)
            cross(base, arm, v)
            own = 0.0
            for r in range(3):
                v[r] += base[3 + r]
                total = 0.0
                for b in range(n):
                    total += arms.columns[s, b, 3 + r] * own_start[b]
                own += total * total
            largest = max(largest, math.sqrt(own) + math.sqrt(dot(v, v)))
    return largest


@inner
def _bodies_alone(
    like: NoArm,
    arms: ArmTables,
    w: WorldTables,
    span: StepPart,
    now: tuple[Array, Array, Array],
    then: tuple[Array, Array, Array],
) -> int:
    assign_matrix(w.movers.free, w.movers.end)
    set_blocks(w.contacts, w.movers.stiffness, span.h)
    return GOOD if solve_impulses(w) else SLIDING


@inner
def _begin_arm(
    arms: ArmTables, i: int, run: Stepping, w: WorldTables, span: StepPart, now: tuple[Array, Array, Array]
) -> None:
    """Start and bases of the stage of arm i, and its pressures where the equation holds."""
    q, _, z = now
    m = arms.mover[i]
    work, theta, v0 = run.work, w.movers.theta[m], w.movers.start[m, arms.column[i] :]
    assign(q[arms.first_q[i] : arms.first_q[i + 1]], work.q_start)
    assign(z[arms.first_z[i] : arms.first_z[i + 1]], work.z_start)
    own = span.pressure[:, arms.first_u[i] : arms.first_u[i + 1]]
    interpolate(own, span.done + theta * span.part, work.stage_pressure)
    for b in range(work.q_start.shape[0]):
        work.v_base[b] = v0[b]
        work.q_base[b] = work.q_start[b] + theta * span.h * v0[b]
        work.acceleration[b] = arms.acceleration[i, b]
    arms.change[i] = math.inf


@inner
def _linearise(arms: ArmTables, i: int, run: Stepping, w: WorldTables, h: float, anew: int) -> int:
    """Row of arm i in arms.residual <- the forces without contact; its system is factored, if it is anew."""
    t, work = run.tables, run.work
    m, first = arms.mover[i], arms.column[i]
    theta = w.movers.theta[m]
    n, c_v = work.q_start.shape[0], theta * h
    c_q = c_v * c_v
    q, v, z, x = work.q_stage, work.v_stage, work.z_stage, work.acceleration
    for b in range(n):
        q[b] = work.q_base[b] + c_q * x[b]
        v[b] = work.v_base[b] + c_v * x[b]
    at = ArmState(q, v, z)
    code = check(t, q, v)
    if code != GOOD:
        return code
    advance_internal(t, work.z_start, (w.movers.start[m, first : first + n], v), c_v, z, work.tangent)
    ride_on_carrier(t.base, arms, i, work.stage_pressure)
    row = arms.residual[m, first : first + n]
    if anew != KEPT:
        equation = StageEquation(c_q, c_v, c_v, ARM_TOLERANCE, 1)
        secant = 1.0 if anew == BY_SECANT else 0.0
        force_residual(run, work.system, at, arms.no_wrench, YES)
        if not factor(NO_AIR, run, equation, at, NO, secant):
            force_residual(run, work.system, at, arms.no_wrench, YES)
            if not factor(NO_AIR, run, equation, at, YES, secant):
                return SINGULAR
        assign(work.residual, row)
        note_tip(t.base, arms, i, t, work.system)
        weigh_mount(t.base, arms, i, run, q)
    else:
        force_residual(run, work.model, at, arms.no_wrench, NO)
        assign(work.residual, row)
        note_tip(t.base, arms, i, t, work.model)
    return GOOD


@inner
def _answer_contacts(like: Stepping, arms: ArmTables, w: WorldTables) -> None:
    """w.contacts.Y <- A^-1 G' of the arms."""
    k = w.contacts
    for c in range(k.counts[0]):
        for side in range(2):
            m = k.mover[c, side]
            if 0 <= m < w.movers.n_arms:
                for r in range(3):
                    assign(k.G[c, side, r], k.Y[c, side, r])
                    solve_mover(like.tables.base, arms, like, m, k.Y[c, side, r], arms.mounts.no_wrench)


@inner
def _solve(
    like: Stepping,
    arms: ArmTables,
    w: WorldTables,
    span: StepPart,
    now: tuple[Array, Array, Array],
    then: tuple[Array, Array, Array],
) -> int:
    k, end, start, h = w.contacts, w.movers.end, w.movers.start, span.h
    n_a = arms.address.shape[0]
    anew = BY_SECANT
    for i in range(n_a):
        _begin_arm(arms, i, view_at(like, arms.address[i]), w, span, now)
    for sweep in range(MAX_ITERATIONS):
        assign_matrix(w.movers.free, end)
        for i in range(n_a):
            arms.failed[0] = i
            run = view_at(like, arms.address[i])
            code = _linearise(arms, i, run, w, h, anew)
            if code != GOOD:
                return code
        if anew != KEPT:
            if not close_carriers(like.tables.base, arms, like):
                return SINGULAR
            _answer_contacts(like, arms, w)
            set_blocks(k, w.movers.stiffness, h)
        for m in range(w.movers.n_arms):
            arms.failed[0] = arms.first_arm[m]
            solve_mover(like.tables.base, arms, like, m, arms.residual[m], arms.mounts.wrench)
            if not finite(arms.residual[m]):
                return NOT_FINITE
        for i in range(n_a):
            m, c = arms.mover[i], arms.column[i]
            x = view_at(like, arms.address[i]).work.acceleration
            for b in range(x.shape[0]):
                end[m, c + b] = start[m, c + b] + h * (x[b] + arms.residual[m, c + b])
        if not solve_impulses(w):
            return SLIDING
        done, rate = True, 0.0
        for i in range(n_a):
            work = view_at(like, arms.address[i]).work
            m, c = arms.mover[i], arms.column[i]
            c_q, change = (w.movers.theta[m] * h) ** 2, 0.0
            for b in range(work.acceleration.shape[0]):
                x = (end[m, c + b] - start[m, c + b]) / h
                change = max(change, abs(c_q * (x - work.acceleration[b])) * work.weight[b])
                work.acceleration[b] = x
            own = change / arms.change[i]
            left = change * own / (1.0 - own) if 0.0 < own < 1.0 else change
            done = done and (left < ARM_TOLERANCE or (change < ROUND_OFF and own > 0.5))
            rate = max(rate, own if change > ARM_TOLERANCE else 0.0)
            arms.change[i] = change
        if done:
            return _move(like, arms, w, h, now, then)
        anew = KEPT
        if sweep > 0 and rate > SLOW:
            anew = BY_SECANT if rate >= 1.0 else BY_TANGENT
    return NOT_CONVERGED


@inner
def _move(
    like: Stepping,
    arms: ArmTables,
    w: WorldTables,
    h: float,
    now: tuple[Array, Array, Array],
    then: tuple[Array, Array, Array],
) -> int:
    """Then <- states of the arms, from their velocities; gives a code."""
    for i in range(arms.address.shape[0]):
        run = view_at(like, arms.address[i])
        m, c = arms.mover[i], arms.column[i]
        qs, zs = slice(arms.first_q[i], arms.first_q[i + 1]), slice(arms.first_z[i], arms.first_z[i + 1])
        q0, v0, z0, q1, v1, z1 = now[0][qs], now[1][qs], now[2][zs], then[0][qs], then[1][qs], then[2][zs]
        arms.failed[0] = i
        for b in range(q0.shape[0]):
            before, after = w.movers.start[m, c + b], w.movers.end[m, c + b]
            q1[b] = q0[b] + h * (before + w.movers.theta[m] * (after - before))
            v1[b] = after
        advance_internal(run.tables, z0, (v0, v1), h, z1, run.work.tangent)
        code = check(run.tables, q1, v1)
        if code != GOOD:
            return code
        if not finite(z1):
            return NOT_FINITE
    # The next step begins with these: one that has failed leaves nothing behind.
    for i in range(arms.address.shape[0]):
        found = view_at(like, arms.address[i]).work.acceleration
        assign(found, arms.acceleration[i, : found.shape[0]])
    return GOOD


solve_movers = select_by_type(NoArm, _bodies_alone, _solve)
"""solve_movers(like, arms, w, span, (q0, v0, z0), (q1, v1, z1)): w.movers.end, impulses, and arms at the end.

Arms and bodies move together, by Newton's iteration around the contacts; gives a code."""
