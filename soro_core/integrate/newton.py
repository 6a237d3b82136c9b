"""One stage of an implicit stepper: the acceleration x that satisfies the equation of motion.

The stages of all implicit steppers have the form q = q_base + c_q x, v = v_base + c_v x with known bases and
coefficients; x solves M(q) x + C(q, v) v + ... = H p. Newton with the approximate Hessian
M + c_v R + c_q K of docs/model.md (34), factored once, and again only if convergence is slow.
"""

from __future__ import annotations

import math

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.integrate.air import Air, breathe
from soro_core.integrate.system import CLOSED, StepWork, factor, force_residual
from soro_core.model.dynamics import GOOD, NOT_CONVERGED, NOT_FINITE, SINGULAR, check, finite
from soro_core.model.forces.internal import advance_internal
from soro_core.model.links.sweep import NO, YES
from soro_core.model.method import solve_system
from soro_core.model.tables import Tables

MAX_ITERATIONS = 30
# Slower contraction than this requires a new Hessian.
SLOW = 0.2
# Corrections below this size that do not decrease are round-off.
ROUND_OFF = 1e-9


@inner
def solve_stage(
    t: Tables,
    air: Air,
    work: StepWork,
    q_base: Array,
    v_base: Array,
    c_q: float,
    c_v: float,
    z0: Array,
    v0: Array,
    span: float,
    wrench: Array,
    tolerance: float,
    sweeps: int,
    x: Array,
    q: Array,
    v: Array,
    z: Array,
) -> int:
    """x <- solution, from its first guess; q, v, z <- state of the stage. Gives a code.

    Internal states start at z0 and follow a velocity that changes linearly from v0 to v over `span` seconds.
    The pressures are `work.command`, or follow it through valves. The iteration takes at least `sweeps`
    steps, and ends when the error of q relative to its scale is below `tolerance`.
    """
    r, pressure = work.residual, work.stage_pressure
    n_q = x.shape[0]
    done, factored = False, False
    diagonal = NO
    before, rate = math.inf, math.inf
    for sweep in range(MAX_ITERATIONS + 1):
        for b in range(n_q):
            q[b] = q_base[b] + c_q * x[b]
            v[b] = v_base[b] + c_v * x[b]
        code = check(t, q, v)
        if code != GOOD:
            return code
        advance_internal(t, z0, v0, v, span, z, work.tangent)
        if not breathe(air, t, q, z0, work.command, span, z, pressure, work.pressure_slope):
            return CLOSED
        if done:
            return GOOD if finite(z) else NOT_FINITE
        if factored:
            force_residual(t, work.model, q, v, x, z, pressure, wrench, NO, r)
        else:
            force_residual(t, work.system, q, v, x, z, pressure, wrench, YES, r)
            slope = work.pressure_slope
            # Friction: the robust secant at first and when the iteration diverges, else the derivative.
            secant = 0.0 if rate < 1.0 else 1.0
            if not factor(
                t, air, work.system, q, v, pressure, slope, c_v, c_q, work.tangent, diagonal, secant
            ):
                if diagonal > 0.0:
                    return SINGULAR
                # The stiffness is indefinite: its diagonal converges with more iterations.
                diagonal = YES
                continue
            factored = True
        solve_system(t, work.system, r)
        if not finite(r):
            return NOT_FINITE
        change = 0.0
        for b in range(n_q):
            change = max(change, abs(c_q * r[b]) * work.weight[b])
            x[b] += r[b]
        rate = change / before
        # With linear convergence the remaining error is about change * rate / (1 - rate).
        left = change * rate / (1.0 - rate) if 0.0 < rate < 1.0 else change
        done = sweep + 1 >= sweeps and (left < tolerance or (change < ROUND_OFF and rate > 0.5))
        if rate > SLOW and before < math.inf:
            factored = False
        before = change
    return NOT_CONVERGED
