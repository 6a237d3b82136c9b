"""What a stepper knows and writes into: tables of an arm, workspace of a run, and the records in between."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core._box import Box
from soro_core._jit import inner, kernel
from soro_core.arrays import Array, Integers
from soro_core.model.links.linear import assign
from soro_core.model.method import make_work
from soro_core.model.records import ArmState
from soro_core.model.tables import Tables
from soro_core.model.work import Work

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


@inner
def assign_state(state: ArmState, out: ArmState) -> None:
    """Out <- state."""
    assign(state.q, out.q)
    assign(state.v, out.v)
    assign(state.z, out.z)


class StepInput(NamedTuple):
    """What is held over a step: pressures [Pa], those of its start, middle and end (3, n_u), and wrenches."""

    pressure: Array
    wrench: Array


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
