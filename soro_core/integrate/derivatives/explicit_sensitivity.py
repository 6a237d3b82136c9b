"""Sensitivities of an explicit step: the chain rule through its stages, docs/model.md (49)."""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.integrate.derivatives.sensitivity import (
    STAGE,
    START,
    Q,
    Sensitivity,
    StepDerivation,
    V,
    solve_stage,
)
from soro_core.integrate.step_work import StepInput, Stepping, StepWork
from soro_core.model.derivative.equation import equation_derivatives
from soro_core.model.forces.internal import BY_SECOND
from soro_core.model.links.linear import assign, assign_matrix, clear
from soro_core.model.records import ArmState, Motion
from soro_core.model.tables import CREEP


@inner
def _explicit_stage(s: Sensitivity, work: StepWork, weights: Array, stage: int, h: float) -> None:
    """STAGE and `point` <- an explicit stage, or the new state, from the stages before it."""
    for w in range(s.q.shape[1]):
        q, v, z = s.q[STAGE, w], s.v[STAGE, w], s.z[STAGE, w]
        assign(s.q[START, w], q)
        assign(s.v[START, w], v)
        assign(s.z[START, w], z)
        for j in range(stage):
            weight = h * weights[j]
            for b in range(q.shape[0]):
                q[b] += weight * s.stage_v[j, w, b]
                v[b] += weight * s.stage_a[j, w, b]
            for b in range(z.shape[0]):
                z[b] += weight * s.stage_z[j, w, b]
    for j in range(stage):
        weight = h * weights[j]
        for b in range(s.q.shape[2]):
            s.point[Q, b] += weight * work.stage_velocity[j, b]
            s.point[V, b] += weight * work.stage_acceleration[j, b]
        for b in range(s.z.shape[2]):
            s.internal[b] += weight * work.stage_rate[j, b]


@inner
def follow_explicit(
    room: StepDerivation, run: Stepping, matrix: Array, h: float, start: ArmState, held: StepInput
) -> bool:
    """Follow the stages of a `Tableau`; leave q and v of its new state in `point`. False if singular."""
    t, work, d, s = run.tables, run.work, room.equation, room.sensitivity
    n = matrix.shape[1]
    clear(s.slope[BY_SECOND])
    good = True
    for stage in range(n + 1):
        assign(start.q, s.point[Q])
        assign(start.v, s.point[V])
        assign(start.z, s.internal)
        _explicit_stage(s, work, matrix[stage], stage, h)
        if stage == n:
            break
        v, a = s.point[V], work.stage_acceleration[stage]
        equation_derivatives(t, d, held.pressure, held.wrench, Motion(s.point[Q], v, v, a))
        good = good and solve_stage(t, d, s, 0.0, 0.0)
        assign_matrix(s.v[STAGE], s.stage_v[stage])
        assign_matrix(s.a[STAGE], s.stage_a[stage])
        for j in range(start.z.shape[0]):
            c, scale = t.internal_coordinate[j], t.internal_scale[j]
            is_creep = t.internal_kind[j] == CREEP
            by_z = -1.0 / scale if is_creep else -abs(v[c]) / scale
            by_v = -1.0 if is_creep else 1.0 - math.copysign(1.0, v[c]) * s.internal[j] / scale
            for w in range(s.q.shape[1]):
                s.stage_z[stage, w, j] = by_z * s.z[STAGE, w, j] + by_v * s.v[STAGE, w, c]
    return good
