"""A part about an axis whose end is closed by a rigid lid and moves freely along the axis under pressure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.config import with_changes
from soro_core.errors import ModelError
from soro_design.fem.part import Balance
from soro_design.fem.solve.equations import Equations
from soro_design.fem.solve.steps import LoadSteps, shortened
from soro_design.parts.file import LoadSweep
from soro_design.parts.specimen import RingSpecimen

ITERATIONS, TOLERANCE = 20, 1e-8


@dataclass(frozen=True, eq=False)
class FreeEnd:
    """A state in equilibrium with a free end.

    Attributes
    ----------
    u : ndarray, (n, 2)
        Displacements [m].
    stiffness_n_m : float
        Of the end against a force along the axis, at constant pressure [N/m].
    """

    u: Array
    stiffness_n_m: float


def lid_force(specimen: RingSpecimen, u: Array, pressure_pa: float) -> tuple[float, int, float]:
    """Return the force of a pressure on the lid [N], the node at its rim, and its derivative by r [N/m]."""
    points = specimen.part.mesh.points
    rim = int(specimen.tip[points[specimen.tip, 0].argmin()])
    radius = float(points[rim, 0] + u[rim, 0])
    return np.pi * pressure_pa * radius**2, rim, 2.0 * np.pi * pressure_pa * radius


def free_end(specimen: RingSpecimen, sweep: LoadSweep) -> FreeEnd:
    """Return the state under the pressure of a sweep, by Newton's method with the extension as one unknown.

    Raises
    ------
    ModelError
        If there is no equilibrium.
    """
    part = specimen.under(with_changes(sweep, extension_m=0.0))
    equations, steps = Equations(part), LoadSteps(0.25, 1e-3)
    load, found = 0.0, FreeEnd(np.zeros_like(part.mesh.points), 0.0)
    while load < 1.0:
        aim = steps.next(load, 1.0)
        ahead = _balanced(specimen, equations, found.u, aim, aim * sum(sweep.pressures_pa))
        if ahead is not None:
            steps.has_succeeded(aim - load)
            load, found = aim, ahead
        elif steps.has_failed(aim - load):
            raise ModelError(f"load factor {load:.3g}: no equilibrium above it", "pressures_pa")
    return found


def _balanced(
    specimen: RingSpecimen, equations: Equations, u: Array, load: float, pressure_pa: float
) -> FreeEnd | None:
    """Return the state at a load, or None."""
    part, tip = equations.part, specimen.tip
    zero, unit = np.zeros_like(u), np.zeros_like(u)
    unit[tip, 1] = 1.0

    def balance_at(at: Array, before: Array) -> Balance:
        return part.balance(at, load, before=before)

    balance = balance_at(u, u)
    for _ in range(ITERATIONS):
        if balance.inverted >= 0 or (tangent := equations.tangent(balance, u)) is None:
            return None
        alone, raised = tangent.move(-balance.unbalanced, zero), tangent.move(zero, unit)
        if alone is None or raised is None:
            return None
        lid, rim, by_radius = lid_force(specimen, u, pressure_pa)
        matrix = part.matrix(balance)
        # What lacks at the lid changes by these with each of both motions.
        slopes = [
            float((matrix @ move.ravel()).reshape(u.shape)[tip, 1].sum() - by_radius * move[rim, 0])
            for move in (alone, raised)
        ]
        lacks = float(balance.unbalanced[tip, 1].sum()) - lid
        off = max(float(np.linalg.norm(equations.free(balance))), abs(lacks))
        if off <= TOLERANCE * max(balance.size, lid):
            # Beyond a limit point there are states that no end comes to.
            return FreeEnd(u, slopes[1]) if slopes[1] > 0.0 else None
        u, balance = shortened(balance_at, u, alone - (lacks + slopes[0]) / slopes[1] * raised)
    return None
