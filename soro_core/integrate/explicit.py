"""Runs with explicit steppers: one kernel, parametrised by a `Tableau`."""

from __future__ import annotations

import math
from typing import NamedTuple

from soro_core._box import Box, view
from soro_core._jit import inner, kernel
from soro_core.arrays import Array
from soro_core.integrate.base_motion import move_base
from soro_core.integrate.step_work import LATEST, StepInput, Stepping, StepWork, assign_state
from soro_core.integrate.steppers.scheme import RESOLVED
from soro_core.integrate.steppers.tableau import Tableau
from soro_core.integrate.system import NOT_RESOLVED, TOO_STIFF, interpolate, jumps
from soro_core.model.dynamics import BAD_INPUT, GOOD, NOT_FINITE, check, finite, forward_dynamics
from soro_core.model.forces.internal import internal_rate
from soro_core.model.links.linear import assign
from soro_core.model.records import ArmState
from soro_core.model.tables import Tables

# Largest number of error-controlled steps within a step of the grid.
MAX_STEPS = 2000
# Allowed error at a state of 0, relative to rtol and to the scale of a coordinate (1 for strains, 1 / L for
# curvatures; for velocities the same per second).
FLOOR = 1e-2


class GridPart(NamedTuple):
    """A step of `step` seconds: the `part` of the grid's step from its fraction `begin` on."""

    begin: float
    part: float
    step: float


@inner
def explicit_step(
    m: Tableau, run: Stepping, held: StepInput, part: GridPart, start: ArmState, end: ArmState
) -> int:
    """Make a step; give a code.

    Writes the accelerations and velocities of the stages, and the rates of the internal states, to
    `work.stage_acceleration`, `work.stage_velocity` and `work.stage_rate`.
    """
    t, work = run.tables, run.work
    q1, v1, z1 = end
    n = m.nodes.shape[0]
    n_q, n_z = q1.shape[0], z1.shape[0]
    for stage in range(n + 1):
        assign_state(start, end)
        for j in range(min(stage, n)):
            weight = part.step * m.matrix[stage, j]
            if weight == 0.0:
                continue
            for b in range(n_q):
                q1[b] += weight * work.stage_velocity[j, b]
                v1[b] += weight * work.stage_acceleration[j, b]
            for b in range(n_z):
                z1[b] += weight * work.stage_rate[j, b]
        if stage == n:
            break
        assign(v1, work.stage_velocity[stage])
        internal_rate(t, v1, z1, work.stage_rate[stage])
        acceleration = work.stage_acceleration[stage]
        if stage == 0 and work.known[0] > 0:
            # Known from the last step, or from a rejected one.
            assign(work.memory[LATEST], acceleration)
            continue
        since = (part.begin / part.part + m.nodes[stage]) * part.step
        t.external.clock[0] = t.external.clock[1] + since
        interpolate(held.pressure, part.begin + part.part * m.nodes[stage], work.stage_pressure)
        move_base(t.base, t, work.stage_pressure)
        code = forward_dynamics(t, work.model, end, work.stage_pressure, held.wrench, acceleration)
        if code != GOOD:
            return code
        if stage == 0:
            assign(acceleration, work.memory[LATEST])
            work.known[0] = 1
    code = check(t, q1, v1)
    return code if code != GOOD or finite(z1) else NOT_FINITE


@inner
def error_of(m: Tableau, t: Tables, work: StepWork, q: Array, v: Array, step: float) -> float:
    """Return the error of the step relative to the allowed one, over all coordinates in their scales.

    The allowed error is a part of the state with error control, and `RESOLVED` without.
    """
    n = m.nodes.shape[0]
    error_q, error_v, scale_q, scale_v = 0.0, 0.0, 0.0, 0.0
    for b in range(q.shape[0]):
        e_q, e_v = 0.0, 0.0
        for j in range(n):
            e_q += m.error[j] * work.stage_velocity[j, b]
            e_v += m.error[j] * work.stage_acceleration[j, b]
        error_q = max(error_q, abs(step * e_q) * work.weight[b])
        error_v = max(error_v, abs(step * e_v) * work.weight[b])
        scale_q = max(scale_q, abs(q[b]) * work.weight[b])
        scale_v = max(scale_v, abs(v[b]) * work.weight[b])
    for b in range(work.stage_rate.shape[1]):
        e = 0.0
        for j in range(n):
            e += m.error[j] * work.stage_rate[j, b]
        error_q = max(error_q, abs(step * e) * work.weight[t.internal_coordinate[b]])
    if not m.adaptive:
        return max(error_q, step * error_v) / RESOLVED
    return max(error_q / (FLOOR + scale_q), error_v / (FLOOR + scale_v)) / m.rtol


@kernel
def explicit_run(
    m: Tableau, box: Box, given: tuple[Array, Array, Array], rows: tuple[Array, Array, Array]
) -> tuple[int, int]:
    """Fill the rows q, v, z (n_t, ...) from their first ones; gives (last good row, code).

    `given` has times (n_t,), pressures (n_t, 3, n_u) and wrenches.
    """
    run = view(box)
    t, work = run.tables, run.work
    times, pressure, wrench = given
    q, v, z = rows
    work.known[0], work.size[0] = 0, math.inf
    n = m.nodes.shape[0]
    start = ArmState(work.q_start, work.v_start, work.z_start)
    code = check(t, q[0], v[0])
    if code != GOOD or not finite(z[0]):
        return 0, code if code != GOOD else NOT_FINITE
    before = 1.0
    for k in range(times.shape[0] - 1):
        p = pressure[k]
        if not (finite(p[0]) and finite(p[1]) and finite(p[2]) and finite(wrench)):
            return k, BAD_INPUT
        if k > 0 and jumps(pressure[k - 1], p):
            work.known[0] = 0
        h = times[k + 1] - times[k]
        held, end = StepInput(p, wrench), ArmState(q[k + 1], v[k + 1], z[k + 1])
        assign_state(ArmState(q[k], v[k], z[k]), start)
        t.external.clock[1] = times[k] - times[0]
        done, tries = 0.0, 0
        while done < h:
            left = h - done
            size = work.size[0]
            # Two halves are better than a whole step and a tiny rest.
            step = left if size >= left else min(size, 0.5 * left)
            code = explicit_step(m, run, held, GridPart(done / h, step / h, step), start, end)
            error = error_of(m, t, work, start.q, start.v, step) if code == GOOD else math.inf
            if not m.adaptive:
                if not error <= 1.0:
                    return k, code if code != GOOD else NOT_RESOLVED
            else:
                tries += 1
                if not error <= 1.0:
                    if tries >= MAX_STEPS or step < 1e-9 * h:
                        return k, code if code != GOOD else TOO_STIFF
                    work.size[0] = step * (max(0.2, 0.9 * error**-0.2) if error < math.inf else 0.2)
                    continue
                if tries >= MAX_STEPS:
                    return k, TOO_STIFF
                # Proportional and integral control [HW96, IV.2].
                error = max(error, 1e-4)
                grown = step * min(5.0, max(0.2, 0.9 * error**-0.17 * before**0.04))
                # A step that the grid has shortened does not shorten the next ones.
                work.size[0] = grown if step == size else max(grown, size)
                before = error
            if m.same:
                assign(work.stage_acceleration[n - 1], work.memory[LATEST])
            else:
                work.known[0] = 0
            done = h if step == left else done + step
            assign_state(end, start)
    return times.shape[0] - 1, GOOD
