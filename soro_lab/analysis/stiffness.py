"""Stiffness of an arm at rest and of its tip, docs/analysis.md (1) to (3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.linear import solve
from soro_core.model import SoftArm
from soro_core.model.checks import refuse_underivable
from soro_core.model.equilibrium.rest_forces import NEUTRAL, RestForces

# Compliances below this part of the largest are those of directions in which the model cannot move.
RIGID = 1e-13


@dataclass(frozen=True)
class TipStiffness:
    """How a force at the tip moves the tip.

    Attributes
    ----------
    compliance : ndarray (3, 3)
        Displacement in the world per force in the world [m/N], symmetric.
    stiffness : ndarray (3,)
        Principal stiffnesses [N/m], the softest first; inf where the model cannot move.
    directions : ndarray (3, 3)
        Their unit vectors in the world, one a row.
    """

    compliance: Array
    stiffness: Array
    directions: Array


def tangent_stiffness(arm: SoftArm, pressure_pa: Array, q: Array) -> Array:
    """Derivative (n_q, n_q) of the unbalanced force at an equilibrium, exact where the arm has derivatives.

    Parameters
    ----------
    arm : SoftArm
    pressure_pa : ndarray (n_u,)
        [Pa gauge].
    q : ndarray (n_q,)
        Equilibrium under these pressures.
    """
    try:
        refuse_underivable(arm.robot, arm.method)
    except ModelError:  # contact, a held tip, wrenches at places
        matrix = RestForces(arm, pressure_pa).stiffness(q)
    else:
        # The acceleration is 0 at an equilibrium: the derivative of M has no part in that of M^-1 (force).
        by_q = arm.derivatives(q, np.zeros(arm.n_q), pressure_pa).by_q
        matrix = -arm.inertia_matrix(q) @ by_q
    return _free_to_turn(0.5 * (matrix + matrix.T))


def _free_to_turn(stiffness: Array) -> Array:
    """The same with a little stiffness where there is none but for round-off: about the vertical, at most."""
    unit = np.sqrt(np.maximum(np.abs(np.diag(stiffness)), 1e-300))
    values, vectors = np.linalg.eigh(stiffness / np.outer(unit, unit))
    if not -NEUTRAL < values[0] < NEUTRAL:
        return stiffness
    softest = vectors[:, 0] * unit
    return np.asarray(stiffness + (NEUTRAL - values[0]) * np.outer(softest, softest))


def tip_jacobian(arm: SoftArm, q: Array) -> Array:
    """Velocity (3, n_q) of the tip in the world by the rates of the coordinates."""
    pose, jacobian = arm.pose_and_jacobian(q, arm.length)
    return np.asarray(pose[:3, :3] @ jacobian[3:])


def tip_stiffness(arm: SoftArm, q: Array, stiffness: Array) -> TipStiffness:
    """Compliance of the tip and its principal stiffnesses.

    Parameters
    ----------
    arm : SoftArm
    q : ndarray (n_q,)
        Equilibrium.
    stiffness : ndarray (n_q, n_q)
        `tangent_stiffness` there.

    Raises
    ------
    ModelError
        If the arm has no stiffness in some directions.
    """
    jacobian = tip_jacobian(arm, q)
    try:
        compliance = jacobian @ solve(stiffness, jacobian.T)
    except np.linalg.LinAlgError:
        raise ModelError(f"{arm.robot.name} has no stiffness in some directions", "equilibrium") from None
    compliance = 0.5 * (compliance + compliance.T)
    values, vectors = np.linalg.eigh(compliance)
    values, vectors = values[::-1], vectors[:, ::-1]
    free = values > RIGID * values[0]
    principal = np.full(3, np.inf)
    principal[free] = 1.0 / values[free]
    largest = vectors[np.argmax(np.abs(vectors), axis=0), range(3)]
    return TipStiffness(compliance, principal, (vectors * np.sign(largest)).T)
