"""How runs begin: at rest with relaxed internal states, or where somebody has held the arm.

A release is a run that does not begin at rest. Its coordinates at the first sample, and what creep has
forgotten of them by then, are numbers of the run. All other runs begin at their balance: an offset of the run
that is judged would hide the unmodelled part.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from soro_core.arrays import Array
from soro_core.model import SoftArm
from soro_core.model.tables import CREEP
from soro_core.robot.coordinates import strain_fields
from soro_lab.identification.arm.cases.parameters import ArmParameter
from soro_lab.identification.recording.recording import Recording
from soro_lab.identification.recording.sections import sections

# Deviations, before any data, of the strains that a hand holds: elongation, and bending times length
# [rad].
_STRETCH, _BEND = 0.1, 0.5
# Of the part of it that creep has forgotten: 1 is an arm that was held for long, 0 one that was bent at once.
_FORGOTTEN, _FORGOTTEN_DOUBT = 0.5, 0.3


def is_of_run(name: str, run: str) -> bool:
    """Whether a number belongs to a run."""
    return name.startswith(f"run/{run}/")


def is_release(recording: Recording) -> bool:
    """Whether a recording begins when somebody lets the arm go."""
    found = sections(recording)
    return bool(found) and found[0].kind == "release" and not found[0].starts_at_rest


def start_numbers(arm: SoftArm, releases: Iterable[str]) -> tuple[ArmParameter, ...]:
    """Return the numbers of the first sample of each release, for the coordinates and the creep of an arm."""
    fields, found = strain_fields(arm.robot), []
    for run in releases:
        for index, name in enumerate(arm.robot.coordinate_names):
            doubt = _STRETCH if fields.stretch[index] else _BEND / fields.length[index]
            found.append(
                ArmParameter(
                    f"run/{run}/{name}", 0.0, "of the coordinate", "shift", doubt, -10 * doubt, 10 * doubt
                )
            )
        if (arm.tables.internal_kind == CREEP).any():
            found.append(
                ArmParameter(_forgotten(run), _FORGOTTEN, "of the held", "shift", _FORGOTTEN_DOUBT, 0.0, 1.0)
            )
    return tuple(found)


def at_start(arm: SoftArm, run: str, balance: Array, values: Mapping[str, float]) -> tuple[Array, Array]:
    """Return the coordinates (n_q,) and internal states (n_internal,) at the first sample of a run.

    Parameters
    ----------
    arm : SoftArm
    run : str
        Its name.
    balance : (n_q,)
        Coordinates at rest.
    values : mapping of str to float
        Numbers by name; without those of this run it begins at its balance.
    """
    held = np.array([values.get(f"run/{run}/{name}", 0.0) for name in arm.robot.coordinate_names])
    tables = arm.tables
    creep = (1.0 - values.get(_forgotten(run), 1.0)) * held[tables.internal_coordinate]
    return balance + held, np.where(tables.internal_kind == CREEP, -creep, 0.0)


def _forgotten(run: str) -> str:
    return f"run/{run}/forgotten"
