"""Equilibrium of an arm under constant pressures."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import root

from soro_core.errors import ModelError
from soro_core.model.soft_arm import SoftArm

Array: TypeAlias = NDArray[np.float64]


def equilibrium(arm: SoftArm, pressure: ArrayLike, start: ArrayLike | None = None) -> Array:
    """Coordinates at rest under constant pressures, creep and hysteresis relaxed; contact without friction.

    Parameters
    ----------
    arm : SoftArm
    pressure : array_like of shape (n_u,)
        [Pa gauge].
    start : array_like of shape (n_q,), optional
        Where the search starts; default straight.

    Returns
    -------
    Array of shape (n_q,)

    Raises
    ------
    ModelError
        If no equilibrium is found from there.
    """
    p = np.asarray(pressure, float)
    at_rest = np.zeros(arm.n_q)
    outside = arm.robot.contacts is not None or arm.robot.tip_constraint is not None

    def unbalanced(q: Array) -> Array:
        force = arm.gravity_force(q) + arm.elastic_force(q) - arm.actuation_matrix(q) @ p
        return np.asarray(force - arm.external_forces(q).generalised if outside else force)

    # Forces on elongation and on curvature differ by orders of magnitude: weigh each by its stiffness.
    step = 1e-6
    stiffness = np.array(
        [(unbalanced(at_rest + e) - unbalanced(at_rest - e)) / (2 * step) for e in step * np.eye(arm.n_q)]
    )
    scale = np.maximum(np.abs(np.diag(stiffness)), 1e-12)
    begin = at_rest if start is None else np.asarray(start, float)
    try:
        found = root(lambda q: unbalanced(q) / scale, begin, tol=1e-10)
    except ModelError as error:
        raise ModelError(f"no equilibrium at pressures {p.tolist()} Pa: {error}") from None
    if not np.isfinite(found.x).all() or not np.abs(found.fun).max() <= 1e-6:
        reason = " ".join(str(found.message).split())
        raise ModelError(f"no equilibrium at pressures {p.tolist()} Pa: {reason}")
    return np.asarray(found.x, float)
