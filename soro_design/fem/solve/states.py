"""How loads rise, states in equilibrium, and what became of a solution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError


@dataclass(frozen=True)
class SolverSettings:
    """How loads rise and when forces count as balanced.

    Attributes
    ----------
    first_step, least_step : float
        First load step, and the one below which the solution stops.
    tolerance : float
        Greatest unbalanced force over the forces of stresses or springs, as norms.
    iterations : int
        Most iterations of one load step.

    Raises
    ------
    ModelError
        If a value is not allowed.
    """

    first_step: float = 0.25
    least_step: float = 1e-4
    tolerance: float = 1e-9
    iterations: int = 12

    def __post_init__(self) -> None:
        rules = {
            "first_step": 0.0 < self.first_step < np.inf,
            "least_step": 0.0 < self.least_step < np.inf,
            "tolerance": 0.0 < self.tolerance < 1.0,
            "iterations": self.iterations >= 1,
        }
        for key, is_kept in rules.items():
            if not is_kept:
                allowed = "steps above 0, tolerance between 0 and 1, 1 iteration or more"
                raise ModelError(f"{key} {getattr(self, key)}; allowed: {allowed}", key)


@dataclass(frozen=True, eq=False)
class EquilibriumState:
    """A state in equilibrium.

    Attributes
    ----------
    load : float
        Load factor.
    u : ndarray, (n, d)
        Displacements [m].
    reaction : ndarray, (n, d)
        Forces of the supports on the part [N], 0 where a node is free.
    energy : float
        Strain energy [J].
    """

    load: float
    u: Array
    reaction: Array
    energy: float


@dataclass(frozen=True, eq=False)
class LoadSolution:
    """What became of a solution.

    Attributes
    ----------
    status : str
        solved, or stopped before the last load.
    cause : str
        Why it stopped, else empty.
    states : tuple of EquilibriumState
        Those at the loads asked for that were reached; of `follow`, all on the path.
    last : EquilibriumState
        The last one in equilibrium, whatever the status.
    steps, iterations : int
        Load steps in equilibrium and all iterations.
    """

    status: str
    cause: str
    states: tuple[EquilibriumState, ...]
    last: EquilibriumState
    steps: int
    iterations: int
