"""The equation of motion for the steppers: residual and linear system, docs/model.md (11) and (34)."""

from __future__ import annotations

from typing import NamedTuple

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.integrate.air import Air, add_air_stiffness
from soro_core.integrate.base_motion import move_base
from soro_core.integrate.step_work import Stepping
from soro_core.model.dynamics import applied_force
from soro_core.model.forces.chambers import add_pressure_stiffness
from soro_core.model.forces.elasticity import add_stiffness
from soro_core.model.method import factor_system, inverse_dynamics
from soro_core.model.records import ArmState, Motion, TangentFactors
from soro_core.model.work import Work

# Codes of the steppers, beside those of `soro_core.model.dynamics`.
TOO_STIFF, NOT_RESOLVED, CLOSED = 20, 21, 22


class StageEquation(NamedTuple):
    """The state of an implicit stage by its acceleration x: q = q_base + c_q x, v = v_base + c_v x."""

    c_q: float
    c_v: float
    span: float
    """Time over which internal states follow [s]."""
    tolerance: float
    """Largest error of q relative to its scale."""
    sweeps: int
    """Least number of iterations."""


@inner
def force_residual(run: Stepping, w: Work, at: ArmState, wrench: Array, bodies: float) -> None:
    """work.residual <- H p + J_tip' wrench - dU_e/dq - R v - internal - (M a + C v + G).

    With the acceleration and the pressures of the stage. With `bodies` = YES `factor` may follow: one pass
    along the links gives the forces and the inertia.
    """
    t, r = run.tables, run.work.residual
    move_base(t.base, t, run.work.stage_pressure)
    inverse_dynamics(t, w, wrench, Motion(at.q, at.v, at.v, run.work.acceleration), bodies, r)
    force = w.applied
    applied_force(t, at.q, at.v, at.z, run.work.stage_pressure, force)
    for b in range(r.shape[0]):
        r[b] = force[b] - r[b]


@inner
def factor(
    air: Air, run: Stepping, equation: StageEquation, at: ArmState, diagonal: float, secant: float
) -> bool:
    """Factor M + c_v (R + diag(tangent)) + c_q (d2U_e/dq2 - d(H p)/dq) + the tangents of contact.

    Gives False if the sum is not positive definite. Pressures are constant without air, else they change with
    the volumes by `work.pressure_slope`.

    This is the approximate Hessian of docs/model.md (34), without the derivatives of M, C and G.
    `work.tangent` has an entry for each internal state, added at the coordinate that drives the state.
    `diagonal` above 0 keeps only the non-negative diagonal of all terms but M, so that the sum is positive
    definite. `secant` = 1 takes friction by its ratio to velocity, see `soro_core.model.forces.contact`.
    Needs `force_residual` with bodies at the same state in `work.system`; `solve_system` follows.
    """
    t, w, tangent = run.tables, run.work.system, run.work.tangent
    q, by_v, by_q = at.q, equation.c_v, equation.c_q
    for b in range(q.shape[0]):
        for d in range(w.block.shape[1]):
            w.block[b, d] = by_v * t.damping[b, d]
    if by_q != 0.0:
        add_stiffness(t, q, by_q, w.block)
        add_pressure_stiffness(t, q, run.work.stage_pressure, by_q, w.block)
        add_air_stiffness(air, t, w, q, run.work.pressure_slope, by_q)
    for i in range(t.length.shape[0]):
        first = t.offset[i]
        for j in range(tangent.shape[0]):
            c = t.internal_coordinate[j]
            if first <= c < t.offset[i + 1]:
                w.block[c, c - first] += by_v * tangent[j]
        if diagonal > 0.0:
            for c in range(first, t.offset[i + 1]):
                for d in range(w.block.shape[1]):
                    w.block[c, d] = max(w.block[c, d], 0.0) if d == c - first else 0.0
    return bool(factor_system(t, w, q, at.v, TangentFactors(by_q, by_v, secant)))


@inner
def interpolate(pressure: Array, s: float, out: Array) -> None:
    """out <- pressures (n_u,) at fraction s of the step: the parabola through its start, middle and end."""
    first, middle, last = (1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)
    for u in range(out.shape[0]):
        out[u] = first * pressure[0, u] + middle * pressure[1, u] + last * pressure[2, u]


@inner
def jumps(before: Array, after: Array) -> bool:
    """Whether the pressures at the end of one step (3, n_u) are not those at the start of the next."""
    differs = False
    for u in range(after.shape[1]):
        differs = differs or after[0, u] != before[2, u]
    return differs
