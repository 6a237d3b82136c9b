"""The equation of motion as the steppers see it: its residual, its linear system, its acceleration.

Every stepper goes through the functions of this file, so that how the system is solved can be changed in one
place.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core._box import Box
from soro_core._jit import inner, kernel
from soro_core.integrate.air import Air, add_air_stiffness
from soro_core.model.chambers import add_pressure_stiffness
from soro_core.model.dynamics import applied_force
from soro_core.model.elasticity import add_stiffness
from soro_core.model.method import factor_system, inverse_dynamics, make_work
from soro_core.model.tables import Tables
from soro_core.model.work import Work

Array: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

# Codes of the steppers, beside those of `soro_core.model.dynamics`.
TOO_STIFF, NOT_RESOLVED, CLOSED = 20, 21, 22
# Largest part of a step's motion, of the scale of q (1 for strains, 1 / L for curvatures), that a stepper
# without error control may leave to chance.
RESOLVED = 0.1
ROWS = 18


class StepWork(NamedTuple):
    """Arrays that a run allocates once, and what it remembers from step to step."""

    model: Work
    """Workspace of the model's kernels."""
    system: Work
    """The same where the system was factored: the factors, and the frames that they belong to."""
    tangent: Array
    """d(force)/d(velocity) of each internal state, (n_z,)."""
    residual: Array
    weight: Array
    """What one unit of each coordinate counts in an error: 1 for a strain, L for a curvature, (n_q,)."""
    rows: Array
    """Room for the stages of a step, (ROWS, n_q)."""
    states: Array
    """The same for the internal states, (ROWS, n_z)."""
    pressure: Array
    """Pressures of a part of a step, (3, n_u)."""
    stage_pressure: Array
    """Pressures at one stage, (n_u,)."""
    command: Array
    """What is given for that stage: the pressures themselves, or where there are valves their set points."""
    pressure_slope: Array
    """Where there are valves, d(pressure)/d(volume) of each chamber, (n_u,)."""
    memory: Array
    """Accelerations kept for the next steps, the latest first, (2, n_q)."""
    known: Integers
    """How many rows of `memory` hold; one entry."""
    size: Array
    """Step that the adaptive stepper would take next [s]; one entry."""
    energy: Array
    """Energy that the arm may have at the start of a step [J], inf where there is no bound (see `balance`);
    one entry."""


class Stepping(NamedTuple):
    """What a stepper needs of an arm: its numbers, and room to compute in."""

    tables: Tables
    work: StepWork


@kernel
def make_stepping(t: Tables, n_q: int, n_z: int, n_u: int) -> Box:
    """`Stepping` in a box; one thread at a time."""
    weight = np.empty(n_q)
    for i in range(t.length.shape[0]):
        for b in range(t.offset[i], t.offset[i + 1]):
            angular = t.basis[b, 0] != 0.0 or t.basis[b, 1] != 0.0 or t.basis[b, 2] != 0.0
            weight[b] = t.length[i] if angular else 1.0
    work = StepWork(
        make_work(t),
        make_work(t),
        np.empty(n_z),
        np.empty(n_q),
        weight,
        np.empty((ROWS, n_q)),
        np.empty((ROWS, n_z)),
        np.empty((3, n_u)),
        np.empty(n_u),
        np.empty(n_u),
        np.empty(n_u),
        np.empty((2, n_q)),
        np.zeros(1, dtype=np.int64),
        np.full(1, np.inf),
        np.full(1, np.inf),
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
    force = w.rows[2]
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

    Gives False where it is not positive. The pressures are constant without air, else they fall by `slope`
    with the volumes.

    That is the approximate Hessian of [C22, App. C]: the derivatives of M, C and G are left out. `tangent`
    has an entry for each internal state, which counts at the coordinate that drags the state along.
    `diagonal` above 0 keeps of everything but M the diagonal alone, without negative entries, so that the sum
    is positive definite. `secant` = 1: friction by its ratio to velocity, see
    `soro_core.model.contact`. Needs `force_residual` with bodies at the same q, v in the same workspace;
    `solve_system` follows.
    """
    for b in range(q.shape[0]):
        for d in range(w.block.shape[1]):
            w.block[b, d] = by_v * t.damping[b, d]
    if by_q != 0.0:
        add_stiffness(t, q, by_q, w.block)
        add_pressure_stiffness(t, q, pressure, by_q, w.block)
        add_air_stiffness(air, t, q, slope, by_q, w.rows[2], w.block)
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
    """Tell whether the pressures at the end of one step (3, n_u) are not those at the start of the next."""
    differs = False
    for u in range(after.shape[1]):
        differs = differs or after[0, u] != before[2, u]
    return differs
