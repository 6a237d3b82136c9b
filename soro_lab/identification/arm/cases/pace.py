"""How long the steps of a simulation may be, for what a fit compares."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from soro_core.model import SoftArm
from soro_core.model.equilibrium.rest_forces import RestForces
from soro_core.model.equilibrium.statics import equilibrium

# No step is longer: pressures of regulators change within some 50 ms.
LONGEST_S = 0.01


def longest_step(arm: SoftArm, turn: float) -> float:
    """Return a step [s] in which the slowest swing of an arm at rest turns by at most `turn` [rad].

    The stepper of `Whole` makes a swing slower by 0.04 `turn`^2 of its frequency.

    Raises
    ------
    ModelError
        If the arm has no rest without pressure.
    """
    none = np.zeros(arm.n_u)
    rest = equilibrium(arm, none)
    stiffness = RestForces(arm, none, 0.0).stiffness(rest)
    square = float(eigh(0.5 * (stiffness + stiffness.T), arm.inertia_matrix(rest), eigvals_only=True)[0])
    return min(LONGEST_S, turn / np.sqrt(square)) if square > 0.0 else LONGEST_S
