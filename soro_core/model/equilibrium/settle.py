"""From an unstable equilibrium to the stable one beside it, by short steps that each lower the energy."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.model.equilibrium.rest_forces import NEUTRAL, RestForces
from soro_core.robot.coordinates import strain_fields

# Longest step, and the first one away from the equilibrium: strains, curvatures times the length of the link.
LONGEST, PUSH = 0.1, 1e-2
MOST_STEPS = 1000
# Largest change by a last step.
TOLERANCE = 1e-9


def settle(forces: RestForces, start: Array) -> Array:
    """Return the coordinates (n_q,) of a stable equilibrium that the arm falls to.

    Each step is that of Newton where the stiffness is positive, else one against the force with the stiffness
    shifted until it is.

    Parameters
    ----------
    forces : RestForces
    start : ndarray (n_q,)
        Unstable equilibrium, or other coordinates.

    Raises
    ------
    ModelError
        If it finds none.
    """
    fields = strain_fields(forces.arm.robot)
    weight = np.where(fields.stretch, 1.0, fields.length)
    values, vectors = _stiffness(forces, start, weight)
    away = vectors[:, 0] * np.sign(vectors[np.argmax(np.abs(vectors[:, 0])), 0])
    x = start * weight + PUSH * away
    for _ in range(MOST_STEPS):
        values, vectors = _stiffness(forces, x / weight, weight)
        along = vectors.T @ (forces.unbalanced(x / weight) / weight)
        shifted = values + max(0.0, -2.0 * values[0])
        step = -vectors @ (along / np.maximum(shifted, NEUTRAL * np.abs(values).max()))
        length = float(np.abs(step).max())
        x = x + step * min(1.0, LONGEST / max(length, 1e-300))
        if length < TOLERANCE and forces.is_stable(x / weight):
            return np.asarray(x / weight)
    raise ModelError(f"{forces.arm.robot.name} falls to no stable equilibrium", "equilibrium")


def _stiffness(forces: RestForces, q: Array, weight: Array) -> tuple[Array, Array]:
    """Eigenvalues and vectors of the stiffness against weighted coordinates, the smallest first."""
    matrix = forces.stiffness(q) / np.outer(weight, weight)
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return values, vectors
