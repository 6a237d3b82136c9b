"""What the model says of a plan before anything moves: the first section at which it has no balance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_lab.excitation.plan import ExcitationPlan
from soro_lab.excitation.section import ExcitationSegment


@dataclass(frozen=True)
class Warned:
    """Where the model has no balance.

    Attributes
    ----------
    index : int
        Number of the section, before which an excitation stops.
    reason : str
        One line.
    """

    index: int
    reason: str


def foresee(arm: SoftArm, plan: ExcitationPlan) -> Warned | None:
    """Return the first section at whose pressures the model has no balance, or None."""
    q = np.zeros(arm.n_q)
    known: dict[bytes, Array] = {}
    for index, section in enumerate(plan.sections):
        for pressure in _extremes(section):
            key = pressure.tobytes()
            if key not in known:
                try:
                    known[key] = equilibrium(arm, pressure, q)
                except ModelError as error:
                    at = ", ".join(
                        f"{name} {1e-3 * p:.1f} kPa"
                        for name, p in zip(plan.names, pressure, strict=True)
                        if p != 0.0
                    )
                    reason = f"the model has no balance at {at or 'no pressure'} ({section.stage}: {error})"
                    return Warned(index, reason)
            q = known[key]
    return None


def _extremes(section: ExcitationSegment) -> list[Array]:
    """Return the pressures (n_u,) [Pa gauge] between which a section moves."""
    level = section.level_pa
    if section.sweep is None:
        return [level]
    return [level - section.sweep.amplitude_pa, level + section.sweep.amplitude_pa]
