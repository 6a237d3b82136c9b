"""Kernels of the derivatives of a step: how a stage depends on the start of the step and on the pressures.

docs/model.md (48), (49). A sensitivity is the derivative of a stage's q, qd, acceleration or internal states
by the parameters (q, qd, internal, p) of the step, a row a parameter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core._box import Box, view
from soro_core._jit import inner, kernel
from soro_core.arrays import Array, Integers
from soro_core.integrate.step_work import MOST_STAGES
from soro_core.model.derivative.work import BY_A, BY_Q, BY_V, DerivativeWork, derivative_workspace
from soro_core.model.forces.internal import BY_FIRST, BY_SECOND, BY_START
from soro_core.model.links.linear import lu_factor, lu_solve
from soro_core.model.tables import CREEP, Tables

# First index of the sensitivities: start of the step, stage before, present stage.
START, LAST, STAGE = 0, 1, 2
# Rows of `Sensitivity.point`: those of a stage, velocity of the stage before, acceleration at the start.
Q, V, A, V_LAST, A_START = 0, 1, 2, 3, 4


class Sensitivity(NamedTuple):
    """Sensitivities to w = 2 n_q + n_z + n_u parameters."""

    q: Array
    """Sensitivities of q, (3, w, n_q); no stage uses q of the stage before."""
    v: Array
    a: Array
    z: Array
    """Sensitivities of the internal states, (3, w, n_z)."""
    stage_v: Array
    """Sensitivities of the velocities of explicit stages, (MOST_STAGES, w, n_q)."""
    stage_a: Array
    stage_z: Array
    """Sensitivities of the rates of their internal states, (MOST_STAGES, w, n_z)."""
    slope: Array
    """Slopes of each internal state over a stage, rows as in `internal_slopes`, (3, n_z)."""
    system: Array
    """(n_q, n_q)."""
    pivots: Integers
    point: Array
    """State and acceleration of a stage, rows Q to A_START, (5, n_q)."""
    internal: Array
    """Internal states of an explicit stage, (n_z,)."""


class StepDerivation(NamedTuple):
    """Workspace for the derivatives of a step: of the equation of motion, and the sensitivities."""

    equation: DerivativeWork
    sensitivity: Sensitivity


class StepRule(NamedTuple):
    """Rule of a stepper, and the length h of its step [s].

    The coefficients are the stages of a `Scheme`, of which `own` are its own and `at_start` says whether it
    uses the acceleration at the start; or with `own` = 0 the matrix of a `Tableau`.
    """

    coefficients: Array
    own: int
    at_start: bool
    h: float


def make_sensitivity(n_q: int, n_z: int, n_u: int) -> Sensitivity:
    """Return zeros; the start of the step, the stage before the first too, depends on itself alone.

    Parameters
    ----------
    n_q, n_z, n_u : int
        Numbers of coordinates, internal states and chambers.
    """
    w = 2 * n_q + n_z + n_u
    of_q, of_z, stages = (3, w, n_q), (3, w, n_z), (MOST_STAGES, w, n_q)
    s = Sensitivity(
        q=np.zeros(of_q),
        v=np.zeros(of_q),
        a=np.zeros(of_q),
        z=np.zeros(of_z),
        stage_v=np.zeros(stages),
        stage_a=np.zeros(stages),
        stage_z=np.zeros((MOST_STAGES, w, n_z)),
        slope=np.zeros((3, n_z)),
        system=np.zeros((n_q, n_q)),
        pivots=np.zeros(n_q, dtype=np.int64),
        point=np.zeros((5, n_q)),
        internal=np.zeros(n_z),
    )
    s.q[START, :n_q] = s.v[START, n_q : 2 * n_q] = np.eye(n_q)
    s.z[START, 2 * n_q : 2 * n_q + n_z] = np.eye(n_z)
    return s


@kernel
def box_of(arm: Box, s: Sensitivity) -> Box:
    """Return a `StepDerivation` of the arm in a box; the caller keeps the arrays of `s`."""
    return Box(StepDerivation(derivative_workspace(view(arm).tables), s))


@inner
def solve_stage(t: Tables, d: DerivativeWork, s: Sensitivity, c_q: float, c_v: float) -> bool:
    """Complete STAGE: from what does not depend on its acceleration x, to q + c_q x, v + c_v x and z."""
    n_q, n_z = s.q.shape[2], s.z.shape[2]
    M = s.system
    for b in range(n_q):
        for c in range(n_q):
            mass = d.equation[BY_A, max(b, c), min(b, c)]
            M[b, c] = mass + c_q * d.equation[BY_Q, b, c] + c_v * d.equation[BY_V, b, c]
    for j in range(n_z):
        c = t.internal_coordinate[j]
        M[c, c] += c_v * _stiffness(t, j) * s.slope[BY_SECOND, j]
    if not lu_factor(M, s.pivots):
        return False
    for w in range(s.q.shape[1]):
        q, v, x, z = s.q[STAGE, w], s.v[STAGE, w], s.a[STAGE, w], s.z[STAGE, w]
        for b in range(n_q):
            x[b] = 0.0
            for c in range(n_q):
                x[b] -= d.equation[BY_Q, b, c] * q[c] + d.equation[BY_V, b, c] * v[c]
        u = w - 2 * n_q - n_z
        if u >= 0:
            for b in range(n_q):
                x[b] += d.actuation[b, u]
        for j in range(n_z):
            x[t.internal_coordinate[j]] -= _stiffness(t, j) * z[j]
        lu_solve(M, s.pivots, x)
        for b in range(n_q):
            q[b] += c_q * x[b]
            v[b] += c_v * x[b]
        for j in range(n_z):
            z[j] += s.slope[BY_SECOND, j] * c_v * x[t.internal_coordinate[j]]
    return True


@inner
def _stiffness(t: Tables, j: int) -> float:
    """Force on the left-hand side by an internal state."""
    stiffness: float = t.internal_stiffness[j]
    return -stiffness if t.internal_kind[j] == CREEP else stiffness


@inner
def follow(t: Tables, s: Sensitivity, before: int) -> None:
    """Let the internal states of STAGE follow those of `before`, by `slope`."""
    for w in range(s.q.shape[1]):
        for j in range(s.z.shape[2]):
            c = t.internal_coordinate[j]
            s.z[STAGE, w, j] = (
                s.slope[BY_START, j] * s.z[before, w, j]
                + s.slope[BY_FIRST, j] * s.v[before, w, c]
                + s.slope[BY_SECOND, j] * s.v[STAGE, w, c]
            )
