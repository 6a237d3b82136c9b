"""The equation of motion for the steppers: residual and linear system, docs/model.md (11) and (34)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core._box import Box
from soro_core._jit import inner, kernel
from soro_core.arrays import Array, Integers
from soro_core.integrate.air import Air, add_air_stiffness
from soro_core.model.dynamics import applied_force
from soro_core.model.forces.chambers import add_pressure_stiffness
from soro_core.model.forces.elasticity import add_stiffness
from soro_core.model.method import factor_system, inverse_dynamics, make_work
from soro_core.model.tables import Tables
from soro_core.model.work import Work

# Codes of the steppers, beside those of `soro_core.model.dynamics`.
TOO_STIFF, NOT_RESOLVED, CLOSED = 20, 21, 22
# Largest number of stages of an explicit stepper.
MOST_STAGES = 8
# Rows of `StepWork.memory`.
LATEST, EARLIER = 0, 1


class StepWork(NamedTuple):
    """Scratch arrays of a run, and its state between steps."""

    model: Work
    """Workspace of the model's kernels."""
    system: Work
    """Workspace of the factored system: the factors, and the frames that they belong to."""
    tangent: Array
    """d(force)/d(velocity) of each internal state, (n_z,)."""
    residual: Array
    weight: Array
    """Weight of each coordinate in an error: 1 for a strain, L for a curvature, (n_q,)."""
    q_start: Array
    """State at the start of the step, or of the part of it in progress, (n_q,)."""
    v_start: Array
    z_start: Array
    """(n_z,)."""
    acceleration: Array
    """Acceleration of an implicit stage; after a step, that of its last stage, (n_q,)."""
    q_base: Array
    """Part of an implicit stage's state that is independent of its acceleration, (n_q,)."""
    v_base: Array
    q_stage: Array
    """State at the end of an implicit stage before the last, (n_q,)."""
    v_stage: Array
    z_stage: Array
    """(n_z,)."""
    stage_acceleration: Array
    """Accelerations of the stages of an explicit step, (MOST_STAGES, n_q)."""
    stage_velocity: Array
    stage_rate: Array
    """Rates of the internal states at these stages, (MOST_STAGES, n_z)."""
    pressure: Array
    """Pressures of a part of a step, (3, n_u)."""
    stage_pressure: Array
    """Pressures at one stage, (n_u,)."""
    command: Array
    """Given pressures of that stage or, with valves, their set points, (n_u,)."""
    pressure_slope: Array
    """d(pressure)/d(volume) of each chamber with valves, (n_u,)."""
    memory: Array
    """Accelerations of past steps, rows LATEST and EARLIER, (2, n_q)."""
    known: Integers
    """Number of valid rows of `memory`; one entry."""
    size: Array
    """Next step of an adaptive stepper [s]; one entry."""
    energy: Array
    """Bound of the energy at the start of a step [J], inf without a bound (see `balance`); one entry."""


class Stepping(NamedTuple):
    """Tables of an arm and workspace of a run."""

    tables: Tables
    work: StepWork


@kernel
def make_stepping(t: Tables, n_q: int, n_z: int, n_u: int) -> Box:
    """Return a `Stepping` in a box, for one thread."""
    weight = np.empty(n_q)
    for i in range(t.length.shape[0]):
        for b in range(t.offset[i], t.offset[i + 1]):
            angular = t.basis[b, 0] != 0.0 or t.basis[b, 1] != 0.0 or t.basis[b, 2] != 0.0
            weight[b] = t.length[i] if angular else 1.0
    work = StepWork(
        make_work(t),  # model
        make_work(t),  # system
        np.empty(n_z),  # tangent
        np.empty(n_q),  # residual
        weight,
        np.empty(n_q),  # q_start
        np.empty(n_q),  # v_start
        np.empty(n_z),  # z_start
        np.empty(n_q),  # acceleration
        np.empty(n_q),  # q_base
        np.empty(n_q),  # v_base
        np.empty(n_q),  # q_stage
        np.empty(n_q),  # v_stage
        np.empty(n_z),  # z_stage
        np.empty((MOST_STAGES, n_q)),  # stage_acceleration
        np.empty((MOST_STAGES, n_q)),  # stage_velocity
        np.empty((MOST_STAGES, n_z)),  # stage_rate
        np.empty((3, n_u)),  # pressure
        np.empty(n_u),  # stage_pressure
        np.empty(n_u),  # command
        np.empty(n_u),  # pressure_slope
        np.empty((2, n_q)),  # memory
        np.zeros(1, dtype=np.int64),  # known
        np.full(1, np.inf),  # size
        np.full(1, np.inf),  # energy
    )
    return Box(Stepping(t, work))


@inner
def force_residual(
    t: Tables,
    w: Work,
    q: Array,
    v: Array,
    a: Array,
    z: Array,
    pressure: Array,
    wrench: Array,
    bodies: float,
    r: Array,
) -> None:
    """r <- H p + J_tip' wrench - dU_e/dq - R v - internal - (M a + C v + G).

    With `bodies` = YES `factor` may follow: one pass along the links gives the forces and the inertia.
    """
    inverse_dynamics(t, w, wrench, q, v, a, bodies, r)
    force = w.applied
    applied_force(t, q, v, z, pressure, force)
    for b in range(q.shape[0]):
        r[b] = force[b] - r[b]


@inner
def factor(
    t: Tables,
    air: Air,
    w: Work,
    q: Array,
    v: Array,
    pressure: Array,
    slope: Array,
    by_v: float,
    by_q: float,
    tangent: Array,
    diagonal: float,
    secant: float,
) -> bool:
    """Factor M + by_v (R + diag(tangent)) + by_q (d2U_e/dq2 - d(H p)/dq) + the tangents of contact.

    Gives False if the sum is not positive definite. Pressures are constant without air, else they change with
    the volumes by `slope`.

    This is the approximate Hessian of docs/model.md (34), without the derivatives of M, C and G. `tangent`
    has an entry for each internal state, added at the coordinate that drives the state. `diagonal` above 0
    keeps only the non-negative diagonal of all terms but M, so that the sum is positive definite. `secant` =
    1 takes friction by its ratio to velocity, see `soro_core.model.forces.contact`. Needs `force_residual`
    with bodies at the same q, v in the same workspace; `solve_system` follows.
    """
    for b in range(q.shape[0]):
        for d in range(w.block.shape[1]):
            w.block[b, d] = by_v * t.damping[b, d]
    if by_q != 0.0:
        add_stiffness(t, q, by_q, w.block)
        add_pressure_stiffness(t, q, pressure, by_q, w.block)
        add_air_stiffness(air, t, q, slope, by_q, w.gradient, w.block)
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
    return bool(factor_system(t, w, q, v, by_q, by_v, secant))


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
