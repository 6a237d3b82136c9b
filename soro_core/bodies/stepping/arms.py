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
from soro_core.bodies.stepping.impulses import push, set_blocks, solve_impulses
from soro_core.bodies.stepping.records import ArmTables, NoArms, WorldTables
from soro_core.integrate.air import NO_AIR
from soro_core.integrate.base_motion import WIDTH, move_base
from soro_core.integrate.newton import MAX_ITERATIONS, ROUND_OFF, SLOW
from soro_core.integrate.step_work import Stepping
from soro_core.integrate.system import StageEquation, factor, force_residual, interpolate
from soro_core.model.dynamics import GOOD, NOT_CONVERGED, NOT_FINITE, SINGULAR, check, finite
from soro_core.model.forces.internal import advance_internal
from soro_core.model.links.linear import assign, clear
from soro_core.model.links.sweep import NO, YES
from soro_core.model.method import kinematics, solve_system
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
def _nothing(
    arms: NoArms,
    like: Stepping,
    w: WorldTables,
    rows: tuple[Array, Array, Array],
    pressure: Array,
    fraction: tuple[float, float],
) -> int:
    return GOOD


@inner
def _locate(
    arms: ArmTables,
    like: Stepping,
    w: WorldTables,
    rows: tuple[Array, Array, Array],
    pressure: Array,
    fraction: tuple[float, float],
) -> int:
    q, v, _ = rows
    done, part = fraction
    start = w.movers.start
    for i in range(arms.address.shape[0]):
        run = view_at(like, arms.address[i])
        first, behind = arms.first_q[i], arms.first_q[i + 1]
        at = q[first:behind]
        code = check(run.tables, at, v[first:behind])
        if code != GOOD:
            return code
        own = pressure[:, arms.first_u[i] : arms.first_u[i + 1]]
        interpolate(own, done + part, run.work.stage_pressure)
        base_twist(run.tables.base, run.work.stage_pressure, arms.base_twist[i])
        interpolate(own, done, run.work.stage_pressure)
        move_base(run.tables.base, run.tables, run.work.stage_pressure)
        for r in range(3):
            arms.base_place[i, r] = run.tables.base_position[r]
        for b in range(start.shape[1]):
            start[i, b] = w.movers.free[i, b] = v[first + b] if first + b < behind else 0.0
        for s in range(arms.first_site[i], arms.first_site[i + 1]):
            site = Site(arms.link[s], arms.place[s], arms.whole[s], arms.step[s], arms.shape[s], arms.rest[s])
            section = CrossSection(arms.R[s], arms.p[s], arms.columns[s, : behind - first])
            kinematics(run.tables, run.work.model, site, at, section)
    return GOOD


locate_arms = select_by_type(NoArms, _nothing, _locate)
"""locate_arms(arms, like, w, (q, v, z), pressure, (done, part)): sections, and velocities in w.movers.

It also finds the motion of the bases at the end of a part of a step, a fraction of which is done; gives a
code."""


@inner
def _start_none(arms: NoArms, like: Stepping) -> None:
    return


@inner
def _start(arms: ArmTables, like: Stepping) -> None:
    for i in range(arms.address.shape[0]):
        clear(view_at(like, arms.address[i]).work.acceleration)


start_arms = select_by_type(NoArms, _start_none, _start)
"""start_arms(arms, like): no acceleration as first guess of a run."""


@inner
def _no_speed(arms: NoArms, w: WorldTables) -> float:
    return 0.0


@inner
def _speed(arms: ArmTables, w: WorldTables) -> float:
    largest = 0.0
    for i in range(arms.address.shape[0]):
        n = arms.first_q[i + 1] - arms.first_q[i]
        for s in range(arms.first_site[i], arms.first_site[i + 1]):
            square = 0.0
            for r in range(3, 6):
                total = 0.0
                for b in range(n):
                    total += arms.columns[s, b, r] * w.movers.start[i, b]
                square += total * total
            largest = max(largest, square)
    return math.sqrt(largest)


arm_speed = select_by_type(NoArms, _no_speed, _speed)
"""arm_speed(arms, w): largest speed of a section [m/s]."""


@inner
def _bodies_alone(arms: NoArms, like: Stepping, w: WorldTables, h: float) -> int:
    k, v = w.contacts, w.movers.end
    for m in range(v.shape[0]):
        assign(w.movers.free[m], v[m])
    set_blocks(k, w.movers.stiffness, h)
    for c in range(k.counts[0]):
        push(k, c, k.impulse[c], v)
    return GOOD if solve_impulses(w) else SLIDING


@inner
def _begin_arm(arms: ArmTables, i: int, run: Stepping, w: WorldTables, h: float) -> None:
    """Bases of the stage of arm i; its first guess is the acceleration of the last step."""
    q0, v0, theta = run.work.q_start, w.movers.start[i], w.movers.theta[i]
    for b in range(q0.shape[0]):
        run.work.v_base[b] = v0[b]
        run.work.q_base[b] = q0[b] + theta * h * v0[b]
    arms.change[i] = math.inf


@inner
def _linearise(arms: ArmTables, i: int, run: Stepping, w: WorldTables, h: float, anew: int) -> int:
    """arms.residual[i] <- A^-1 of the forces without contact; where factored anew, w.contacts.Y of it."""
    t, work = run.tables, run.work
    theta = w.movers.theta[i]
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
    advance_internal(t, work.z_start, (w.movers.start[i, :n], v), c_v, z, work.tangent)
    if anew != KEPT:
        equation = StageEquation(c_q, c_v, c_v, ARM_TOLERANCE, 1)
        secant = 1.0 if anew == BY_SECANT else 0.0
        force_residual(run, work.system, at, arms.no_wrench, YES)
        if not factor(NO_AIR, run, equation, at, NO, secant):
            force_residual(run, work.system, at, arms.no_wrench, YES)
            if not factor(NO_AIR, run, equation, at, YES, secant):
                return SINGULAR
        k = w.contacts
        for c in range(k.counts[0]):
            if k.mover[c, 0] == i:
                for r in range(3):
                    assign(k.G[c, 0, r], k.Y[c, 0, r])
                    solve_system(t, work.system, k.Y[c, 0, r, :n])
    else:
        force_residual(run, work.model, at, arms.no_wrench, NO)
    assign(work.residual, arms.residual[i, :n])
    solve_system(t, work.system, arms.residual[i, :n])
    return GOOD if finite(arms.residual[i, :n]) else NOT_FINITE


@inner
def _arms_and_bodies(arms: ArmTables, like: Stepping, w: WorldTables, h: float) -> int:
    k, end, start = w.contacts, w.movers.end, w.movers.start
    n_a = arms.address.shape[0]
    anew = BY_SECANT
    for i in range(n_a):
        _begin_arm(arms, i, view_at(like, arms.address[i]), w, h)
    for sweep in range(MAX_ITERATIONS):
        for i in range(n_a):
            run = view_at(like, arms.address[i])
            arms.failed[0] = i
            code = _linearise(arms, i, run, w, h, anew)
            if code != GOOD:
                return code
            for b in range(run.work.q_start.shape[0]):
                end[i, b] = start[i, b] + h * (run.work.acceleration[b] + arms.residual[i, b])
        for m in range(n_a, end.shape[0]):
            assign(w.movers.free[m], end[m])
        if anew != KEPT:
            set_blocks(k, w.movers.stiffness, h)
        for c in range(k.counts[0]):
            push(k, c, k.impulse[c], end)
        if not solve_impulses(w):
            return SLIDING
        done, rate = True, 0.0
        for i in range(n_a):
            work = view_at(like, arms.address[i]).work
            c_q, change = (w.movers.theta[i] * h) ** 2, 0.0
            for b in range(work.q_start.shape[0]):
                x = (end[i, b] - start[i, b]) / h
                change = max(change, abs(c_q * (x - work.acceleration[b])) * work.weight[b])
                work.acceleration[b] = x
            own = change / arms.change[i]
            left = change * own / (1.0 - own) if 0.0 < own < 1.0 else change
            done = done and (left < ARM_TOLERANCE or (change < ROUND_OFF and own > 0.5))
            rate = max(rate, own if change > ARM_TOLERANCE else 0.0)
            arms.change[i] = change
        if done:
            return GOOD
        anew = KEPT
        if sweep > 0 and rate > SLOW:
            anew = BY_SECANT if rate >= 1.0 else BY_TANGENT
    return NOT_CONVERGED


solve_movers = select_by_type(NoArms, _bodies_alone, _arms_and_bodies)
"""solve_movers(arms, like, w, h): w.movers.end and impulses, of arms and bodies together; gives a code."""


@inner
def _keep_inputs(
    arms: NoArms,
    like: Stepping,
    w: WorldTables,
    rows: tuple[Array, Array, Array],
    pressure: Array,
    fraction: tuple[float, float],
) -> None:
    return


@inner
def _set_inputs(
    arms: ArmTables,
    like: Stepping,
    w: WorldTables,
    rows: tuple[Array, Array, Array],
    pressure: Array,
    fraction: tuple[float, float],
) -> None:
    done, part = fraction
    q, _, z = rows
    for i in range(arms.address.shape[0]):
        run = view_at(like, arms.address[i])
        assign(q[arms.first_q[i] : arms.first_q[i + 1]], run.work.q_start)
        assign(z[arms.first_z[i] : arms.first_z[i + 1]], run.work.z_start)
        own = pressure[:, arms.first_u[i] : arms.first_u[i + 1]]
        interpolate(own, done + w.movers.theta[i] * part, run.work.stage_pressure)


set_inputs = select_by_type(NoArms, _keep_inputs, _set_inputs)
"""set_inputs(arms, like, w, (q, v, z), pressure, (done, part)): each arm's state at the start, and its
pressures where its equation holds, in a part of a step of which a fraction is done."""


@inner
def _moved(
    arms: ArmTables,
    like: Stepping,
    w: WorldTables,
    h: float,
    now: tuple[Array, Array, Array],
    then: tuple[Array, Array, Array],
) -> int:
    q0, v0, z0 = now
    q1, v1, z1 = then
    for i in range(arms.address.shape[0]):
        run = view_at(like, arms.address[i])
        first, behind = arms.first_q[i], arms.first_q[i + 1]
        theta = w.movers.theta[i]
        arms.failed[0] = i
        for b in range(behind - first):
            before, after = w.movers.start[i, b], w.movers.end[i, b]
            q1[first + b] = q0[first + b] + h * (before + theta * (after - before))
            v1[first + b] = after
        speeds = (v0[first:behind], v1[first:behind])
        z = z1[arms.first_z[i] : arms.first_z[i + 1]]
        advance_internal(
            run.tables, z0[arms.first_z[i] : arms.first_z[i + 1]], speeds, h, z, run.work.tangent
        )
        code = check(run.tables, q1[first:behind], v1[first:behind])
        if code != GOOD:
            return code
        if not finite(z):
            return NOT_FINITE
    return GOOD


@inner
def _none_moved(
    arms: NoArms,
    like: Stepping,
    w: WorldTables,
    h: float,
    now: tuple[Array, Array, Array],
    then: tuple[Array, Array, Array],
) -> int:
    return GOOD


move_arms = select_by_type(NoArms, _none_moved, _moved)
"""move_arms(arms, like, w, h, (q0, v0, z0), (q1, v1, z1)): states at the end of the step.

It gives a code."""
