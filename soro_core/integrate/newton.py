"""One stage of an implicit stepper: the acceleration x that satisfies the equation of motion.

The stages of all implicit steppers have the form q = q_base + c_q x, v = v_base + c_v x with known bases and
coefficients; x solves M(q) x + C(q, v) v + ... = H p. Newton with the approximate Hessian
M + c_v R + c_q K of docs/model.md (34), factored once, and again only if convergence is slow.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.integrate.air import Air, breathe
from soro_core.integrate.step_work import Stepping
from soro_core.integrate.system import CLOSED, StageEquation, factor, force_residual
from soro_core.model.dynamics import GOOD, NOT_CONVERGED, NOT_FINITE, SINGULAR, check, finite
from soro_core.model.forces.internal import advance_internal
from soro_core.model.links.sweep import NO, YES
from soro_core.model.method import solve_system
from soro_core.model.records import ArmState

MAX_ITERATIONS = 30
# Slower contraction than this requires a new Hessian.
SLOW = 0.2
# Corrections below this size that do not decrease are round-off.
ROUND_OFF = 1e-9


class Outside(NamedTuple):
    """What acts on the arm from outside over a run: the air behind valves, or none, and wrenches."""

    air: Air
    wrench: Array


@inner
def solve_stage(
    outside: Outside, run: Stepping, equation: StageEquation, last: ArmState, at: ArmState
) -> int:
    """work.acceleration <- solution x, from its first guess; `at` <- state of the stage. Gives a code.

    Internal states start at those of the `last` stage and follow a velocity that changes linearly from that
    of the last over the span. The pressures are `work.command`, or follow it through valves.
    """
    t, work = run.tables, run.work
    x, q_base, v_base, r = work.acceleration, work.q_base, work.v_base, work.residual
    q, v, z = at
    v0, z0 = last.v, last.z
    c_q, c_v, span = equation.c_q, equation.c_v, equation.span
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
        advance_internal(t, z0, (v0, v), span, z, work.tangent)
        if not breathe(outside.air, run, q, z0, span, z):
            return CLOSED
        if done:
            return GOOD if finite(z) else NOT_FINITE
        if factored:
            force_residual(run, work.model, at, outside.wrench, NO)
        else:
            force_residual(run, work.system, at, outside.wrench, YES)
            # Friction: the robust secant at first and when the iteration diverges, else the derivative.
            secant = 0.0 if rate < 1.0 else 1.0
            if not factor(outside.air, run, equation, at, diagonal, secant):
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
        done = sweep + 1 >= equation.sweeps and (
            left < equation.tolerance or (change < ROUND_OFF and rate > 0.5)
        )
        if rate > SLOW and before < math.inf:
            factored = False
        before = change
    return NOT_CONVERGED
