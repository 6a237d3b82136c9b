"""Energy balance of a dissipative stepper, docs/model.md (35): without input no step gains energy.

Methods like TR-BDF2 dissipate by linear theory; in large motion their error may have either sign. After a
step the stored energy T + U is compared with that before, and an excess is removed from the velocities, v <-
v sqrt(1 - excess / T). This projection onto the allowed states is of the order of the local error, so the
method keeps its order [HLW06, IV.4; K19]. If the kinetic energy is too small for it, the step is divided.

The correction applies only to steps with an exact balance. Gravity, elasticity, creep, hysteresis, contact
and the held tip store energy and otherwise only dissipate; pressures that are constant over the step do the
work p (V1 - V0), with effective pressures p. Wrenches, obstacles that move, and pressures that change within
a step, are input: such steps are not corrected.
"""

from __future__ import annotations

import math

from soro_core._by_type import select_by_type
from soro_core._jit import inner
from soro_core.arrays import Array
from soro_core.integrate.step_work import StepInput, Stepping
from soro_core.integrate.steppers.scheme import Dissipative, Scheme
from soro_core.integrate.system import NOT_RESOLVED
from soro_core.model.dynamics import GOOD
from soro_core.model.forces.chambers import acting, volumes
from soro_core.model.forces.elasticity import elastic_energy
from soro_core.model.forces.external import add_external_forces
from soro_core.model.forces.internal import internal_energy
from soro_core.model.method import energy
from soro_core.model.records import ArmState, Motion

# Largest removed part of the kinetic energy; for a larger excess the step is divided.
SHARE = 0.25
# Part of the sum of energies below which an excess is round-off.
ROUND_OFF = 1e-14


@inner
def _stored(run: Stepping, wrench: Array, at: ArmState) -> tuple[float, float, float]:
    """Return kinetic energy, other stored energy, and the sum of their absolute values [J]."""
    t, w = run.tables, run.work.model
    kinetic, gravity = energy(t, w, at.q, at.v)
    outside = add_external_forces(t.external, t, w, wrench, Motion(at.q, at.v, at.v, w.zero), w.bias)
    elastic = elastic_energy(t, at.q) + internal_energy(t, at.z) + outside
    return kinetic, gravity + elastic, kinetic + abs(gravity) + abs(elastic)


@inner
def _no_begin(m: Scheme, run: Stepping, held: StepInput, start: ArmState) -> None:
    return


@inner
def _begin(m: Scheme, run: Stepping, held: StepInput, start: ArmState) -> None:
    row, wrench, work = held.pressure, held.wrench, run.work
    free = True
    for u in range(row.shape[1]):
        free = free and row[0, u] == row[1, u] and row[1, u] == row[2, u]
    for r in range(wrench.shape[0]):
        free = free and wrench[r] == 0.0
    obstacles = run.tables.external.obstacles
    for o in range(obstacles.shape[0]):
        for r in range(11, 14):
            free = free and obstacles[o, r] == 0.0
    if not free:
        work.energy[0] = math.inf
    elif not work.energy[0] < math.inf:
        kinetic, rest, _ = _stored(run, wrench, start)
        work.energy[0] = kinetic + rest


@inner
def _no_keep(m: Scheme, run: Stepping, held: StepInput, start: ArmState, end: ArmState) -> int:
    return GOOD


@inner
def _keep(m: Scheme, run: Stepping, held: StepInput, start: ArmState, end: ArmState) -> int:
    t, work, row = run.tables, run.work, held.pressure
    if not work.energy[0] < math.inf:
        return GOOD
    kinetic, rest, size = _stored(run, held.wrench, end)
    bound = work.energy[0]
    # Scratch for the volumes: no stage needs these arrays any more.
    before, after = work.command, work.stage_pressure
    volumes(t, start.q, before)
    volumes(t, end.q, after)
    for u in range(row.shape[1]):
        p = acting(t, u, row[0, u])
        bound += p * (after[u] - before[u])
        size += abs(p) * (abs(after[u]) + abs(before[u]))
    excess = kinetic + rest - bound
    if not excess > 0.0:
        work.energy[0] = kinetic + rest
        return GOOD
    if excess <= SHARE * kinetic:
        factor = math.sqrt(1.0 - excess / kinetic)
        for b in range(end.v.shape[0]):
            end.v[b] *= factor
    elif excess > ROUND_OFF * size:
        return NOT_RESOLVED
    # The bound, not the computed energy, so that round-off does not accumulate.
    work.energy[0] = bound
    return GOOD


begin_balance = select_by_type(Dissipative, _begin, _no_begin)
"""begin_balance(m, run, held, start): work.energy <- energy at the start of a step, or inf if the work of the
input is unknown."""
keep_balance = select_by_type(Dissipative, _keep, _no_keep)
"""keep_balance(m, run, held, start, end): after a step, end.v <- velocities without the excess, work.energy
<- bound of the energy. Gives NOT_RESOLVED if the kinetic energy is too small for that."""
