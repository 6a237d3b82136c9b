"""Acceleration of the arm with the learned force, its derivatives, and one step of the mean.

The learned force is part of the model: its mass is at the tip, with inertia, Coriolis force and weight, its
damping is the arm's, and -U W phi(q) is a generalised force affine in q. So mean and covariance move by one
and the same model, and the step below is implicit in damping that is far beyond the file's.

The step is the trapezoidal rule, linearly implicit: with a and its derivatives A21, A22 by q and qd at the
start, (1 - h A22 / 2 - h^2 A21 / 4) dv = h (a + h A21 v / 2), dq = h (v + dv / 2). It is second order, and
bounded for modes faster than the step. Corrections with the same factors make it the trapezoidal rule itself:
of a running filter the first is within round-off of the estimate, far from it they keep the step from running
away. Creep and hysteresis move along, and what they add in the step by its last velocity counts as damping:
taken from the first velocity alone, they would drive modes faster than the step apart.
"""

from __future__ import annotations

import math

from soro_core._by_type import select_by_type
from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.estimation.kernel.belief import Belief
from soro_core.estimation.kernel.parts import FilterArm, NoRoom
from soro_core.model.derivative import equation
from soro_core.model.derivative.work import BY_Q, BY_V, DerivativeWork
from soro_core.model.dynamics import GOOD, NOT_CONVERGED, NOT_FINITE, SINGULAR, applied_force, check, finite
from soro_core.model.forces.internal import advance_internal
from soro_core.model.links.linear import assign, clear, lu_factor, lu_solve
from soro_core.model.method import acceleration, kinematics
from soro_core.model.records import CrossSection, Motion
from soro_core.model.tables import CREEP

# Corrections of a step, of which a running filter needs one; and the change of q in the last, as a strain.
_CORRECTIONS, _SAME = 6, 3e-5
# Increment of a pressure where differences replace derivatives [Pa]; forces are linear in it.
_MOVED_PA = 1e3


@inner
def load(arm: FilterArm, theta: Array, share: float) -> None:
    """Put `share` of the learned model theta into the arm.

    A mass below that of the robot file's tip has weight, but no inertia: the inertia matrix stays positive
    definite, and the arm at rest is where the learner has it. What lasts is the learner's, and a disturbance
    beside it fades sooner.
    """
    t, s, w = arm.tables, arm.settings, arm.scratch
    n = s.limit.shape[0]
    w.share[0] = share
    w.fading[0] = 1.0 / ((1.0 - share) / s.time + share / s.learned_time)
    total = s.tip_mass + share * theta[0]
    t.tip_mass[0] = max(total, 0.0)
    w.lost[0] = min(total, 0.0)
    clear(w.wrench)
    for i in range(n):
        row = 1 + i * (n + 1)
        w.constant[i] = -share * s.force_unit[i] * theta[row]
        for j in range(n):
            w.slope[i, j] = -share * s.force_unit[i] * theta[row + 1 + j] / s.q_unit[j]
    for k in range(t.length.shape[0]):
        first = t.offset[k]
        for i in range(first, t.offset[k + 1]):
            time = share * theta[1 + n * (n + 1) + s.damping_number[i]]
            for j in range(t.offset[k + 1] - first):
                t.damping[i, j] = s.damping[i, j] + time * s.damping_matrix[i, first + j]


@inner
def loaded_acceleration(arm: FilterArm, q: Array, v: Array, z: Array, pressure: Array, a: Array) -> int:
    """a <- acceleration with the learned force of `load`; gives a code of `soro_core.model.dynamics`."""
    t, s, w = arm.tables, arm.settings, arm.scratch
    code = check(t, q, v)
    if code != GOOD:
        return code
    n, force = q.shape[0], arm.work.applied
    applied_force(t, q, v, z, pressure, force)
    for i in range(n):
        force[i] += w.constant[i]
        for j in range(n):
            force[i] += w.slope[i, j] * q[j]
    if w.lost[0] < 0.0:
        kinematics(t, arm.work, s.tip, q, CrossSection(w.rotation, w.position, w.columns))
        for r in range(3):
            w.wrench[3 + r] = 0.0
            for k in range(3):
                w.wrench[3 + r] += w.lost[0] * w.rotation[k, r] * t.gravity[k]
    if not acceleration(t, arm.work, w.wrench, q, v, a):
        return SINGULAR
    return GOOD if finite(a) else NOT_FINITE


@inner
def _exact(room: DerivativeWork, arm: FilterArm, q: Array, v: Array, z: Array, pressure: Array) -> int:
    t, w = arm.tables, arm.scratch
    n = q.shape[0]
    equation.equation_derivatives(t, room, pressure, w.wrench, Motion(q, v, v, w.acceleration))
    left = room.equation[BY_Q]
    for i in range(n):
        for j in range(n):
            left[i, j] -= w.slope[i, j]
    for j in range(z.shape[0]):
        c = t.internal_coordinate[j]
        room.equation[BY_V, c, c] += w.tangent[j]
    if w.lost[0] < 0.0:
        # The weight keeps its direction in the world: J' [w]x J_angular dq beside what a held wrench does.
        x, y, f = w.wrench[3], w.wrench[4], w.wrench[5]
        for i in range(n):
            a, b, c = w.columns[i, 3], w.columns[i, 4], w.columns[i, 5]
            r0, r1, r2 = b * f - c * y, c * x - a * f, a * y - b * x
            for j in range(n):
                left[i, j] -= r0 * w.columns[j, 0] + r1 * w.columns[j, 1] + r2 * w.columns[j, 2]
    code: int = equation.acceleration_derivatives(room, w.by_q, w.by_v, w.by_p)
    return code


@inner
def _differences(room: NoRoom, arm: FilterArm, q: Array, v: Array, z: Array, pressure: Array) -> int:
    s, w = arm.settings, arm.scratch
    n, x, a = q.shape[0], w.moved, w.moved_acceleration
    for i in range(n):
        h = s.increment[i]
        for j in range(n):
            x[j] = q[j]
        x[i] += h
        code = loaded_acceleration(arm, x, v, z, pressure, a)
        if code != GOOD:
            return code
        for j in range(n):
            w.by_q[j, i] = (a[j] - w.acceleration[j]) / h
            x[j] = v[j]
        x[i] += h
        for j in range(z.shape[0]):
            stiffness = arm.tables.internal_stiffness[j]
            w.internal[j] = z[j]
            if arm.tables.internal_coordinate[j] == i and stiffness > 0.0:
                change = w.tangent[j] * h / stiffness
                w.internal[j] += -change if arm.tables.internal_kind[j] == CREEP else change
        code = loaded_acceleration(arm, q, x, w.internal, pressure, a)
        if code != GOOD:
            return code
        for j in range(n):
            w.by_v[j, i] = (a[j] - w.acceleration[j]) / h
    for i in range(pressure.shape[0]):
        assign(pressure, w.pressure)
        w.pressure[i] += _MOVED_PA
        code = loaded_acceleration(arm, q, v, z, w.pressure, a)
        if code != GOOD:
            return code
        for j in range(n):
            w.by_p[j, i] = (a[j] - w.acceleration[j]) / _MOVED_PA
    return GOOD


slopes = select_by_type(DerivativeWork, _exact, _differences)
"""slopes(room, arm, q, v, z, pressure), after `loaded_acceleration` into scratch.acceleration and
`advance_internal`: scratch.by_q, .by_v and .by_p <- its derivatives, exact where the arm has them; gives
a code."""


@inner
def step_system(arm: FilterArm, h: float) -> bool:
    """scratch.system <- factors of 1 - h A22 - h^2 A21; False if it is singular."""
    w = arm.scratch
    S = w.system
    for i in range(S.shape[0]):
        for j in range(S.shape[0]):
            S[i, j] = -h * (w.by_v[i, j] + h * w.by_q[i, j])
        S[i, i] += 1.0
    return lu_factor(S, w.pivots)


@inner
def step_mean(arm: FilterArm, pressure: Array, dt: float, belief: Belief) -> int:
    """Mean and internal states <- those after dt; leaves the derivatives for the covariance; gives a code."""
    t, s, w = arm.tables, arm.settings, arm.scratch
    mean, internal, mean1, internal1 = w.start, w.start_internal, belief.mean, belief.internal
    assign(mean1, mean)
    assign(internal1, internal)
    n = s.limit.shape[0]
    q, v, a, dv = mean[:n], mean[n : 2 * n], w.acceleration, w.change
    code: int = loaded_acceleration(arm, q, v, internal, pressure, a)
    if code != GOOD:
        return code
    advance_internal(t, internal, (v, v), dt, internal1, w.tangent)
    code = slopes(arm.room, arm, q, v, internal, pressure)
    if code != GOOD:
        return code
    for i in range(n):
        dv[i] = a[i]
        if s.n_d > 0:
            dv[i] += mean[2 * n + i] + 0.5 * dt * mean[3 * n + i]
        for j in range(n):
            dv[i] += 0.5 * dt * w.by_q[i, j] * v[j]
        dv[i] *= dt
    if not step_system(arm, 0.5 * dt):
        return SINGULAR
    lu_solve(w.system, w.pivots, dv)
    for _ in range(_CORRECTIONS):
        _move(mean, dv, dt, mean1)
        advance_internal(t, internal, (v, mean1[n : 2 * n]), dt, internal1, w.tangent)
        code = loaded_acceleration(
            arm, mean1[:n], mean1[n : 2 * n], internal1, pressure, w.moved_acceleration
        )
        if code != GOOD:
            return code
        size = _correct(arm, mean, dt)
        if not size < math.inf:
            return NOT_FINITE
        if size < _SAME:
            _move(mean, dv, dt, mean1)
            advance_internal(t, internal, (v, mean1[n : 2 * n]), dt, internal1, w.tangent)
            return GOOD
    return NOT_CONVERGED


@inner
def _move(mean: Array, dv: Array, dt: float, mean1: Array) -> None:
    """mean1 <- coordinates and rates after a change dv of the rates."""
    n = dv.shape[0]
    for i in range(n):
        mean1[i] = mean[i] + dt * (mean[n + i] + 0.5 * dv[i])
        mean1[n + i] = mean[n + i] + dv[i]


@inner
def _correct(arm: FilterArm, mean: Array, dt: float) -> float:
    """Bring scratch.change closer to the trapezoidal rule; gives the change of q as a strain."""
    s, w = arm.settings, arm.scratch
    n, missed = s.limit.shape[0], w.moved
    for i in range(n):
        missed[i] = 0.5 * dt * (w.acceleration[i] + w.moved_acceleration[i]) - w.change[i]
        if s.n_d > 0:
            missed[i] += dt * (mean[2 * n + i] + 0.5 * dt * mean[3 * n + i])
    lu_solve(w.system, w.pivots, missed)
    square = 0.0
    for i in range(n):
        w.change[i] += missed[i]
        for j in range(n):
            square += missed[i] * s.weight[i, j] * missed[j]
    return 0.5 * dt * math.sqrt(max(square, 0.0)) if math.isfinite(square) else math.inf


@inner
def limit(arm: FilterArm, q: Array) -> None:
    """Scale down each field of strain that is beyond its limit somewhere along the link."""
    s = arm.settings
    for f in range(s.first.shape[0] - 1):
        begin, behind = s.first[f], s.first[f + 1]
        bound = 0.0
        for c in range(begin, behind):
            q[c] = min(max(q[c], -1e100), 1e100)  # a sum must not overflow
            bound += abs(q[c]) * s.largest[c]
        most = s.limit[begin]
        if bound <= most:
            continue
        peak = 0.0
        for k in range(s.samples.shape[1]):
            value = 0.0
            for c in range(begin, behind):
                value += q[c] * s.samples[c, k]
            peak = max(peak, abs(value))
        if peak > most:
            for c in range(begin, behind):
                q[c] *= most / peak
