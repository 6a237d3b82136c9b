"""How runs begin: the internal states that earlier motion has left, which no recording shows.

A run begins at rest. An arm with hysteresis or slow creep rests where its past has left it, so the states of
these at the first sample are numbers of the run.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from soro_core.identification.arm.numbers import Number
from soro_core.model import SoftArm
from soro_core.model.tables import CREEP
from soro_core.robot.coordinates import strain_fields

# Deviations before any data: of z over its range, of creep in elongation and in bending times length [rad].
_DAHL, _STRETCH, _BEND = 0.5, 0.05, 0.3
# Only what relaxes more slowly than this [s] outlasts the rest before a run.
_SLOW_S = 1.0


def is_of_run(name: str, run: str) -> bool:
    """Whether a number belongs to a run."""
    return name.startswith(f"run/{run}/")


def start_numbers(arm: SoftArm, runs: Iterable[str]) -> tuple[Number, ...]:
    """Return the numbers of the first sample of each run, for the internal states that an arm has."""
    fields = strain_fields(arm.robot)
    found = []
    for run in runs:
        for name, index, is_creep in _states(arm, run):
            if is_creep:
                scale = _STRETCH if fields.stretch[index] else _BEND / fields.length[index]
                found.append(Number(name, 0.0, "of the coordinate", "shift", scale, -10 * scale, 10 * scale))
            else:
                found.append(Number(name, 0.0, "of the range", "shift", _DAHL, -1.0, 1.0))
    return tuple(found)


def internal_at_start(arm: SoftArm, run: str, values: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the internal states (n_internal,) at the first sample of a run; 0 of what has no number."""
    tables, z = arm.tables, np.zeros(arm.n_internal)
    for name, index, is_creep in _states(arm, run):
        for j in range(arm.n_internal):
            if tables.internal_coordinate[j] == index and _is_meant(arm, j, is_creep):
                z[j] = values.get(name, 0.0) * (1.0 if is_creep else tables.internal_scale[j])
    return z


def _states(arm: SoftArm, run: str) -> list[tuple[str, int, bool]]:
    """Name, coordinate and kind of what a run begins with."""
    fields, found = strain_fields(arm.robot), {}
    for j in range(arm.n_internal):
        index, is_creep = int(arm.tables.internal_coordinate[j]), arm.tables.internal_kind[j] == CREEP
        if _is_meant(arm, j, is_creep):
            field = int(fields.index[index])
            kind = "slow" if is_creep else "dahl"
            name = f"run/{run}/link{fields.links[field]}/{fields.strains[field]}/{kind}"
            found[name] = (name, index, bool(is_creep))
    return list(found.values())


def _is_meant(arm: SoftArm, j: int, is_creep: bool) -> bool:
    own = (arm.tables.internal_kind[j] == CREEP) == is_creep
    return bool(own and (not is_creep or arm.tables.internal_scale[j] > _SLOW_S))
