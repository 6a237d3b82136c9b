"""Creep and hysteresis states along the motion of the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soro_core.arrays import Array

if TYPE_CHECKING:  # a scene reads a law's keys without its model
    from soro_core.model import SoftArm


def advance_creep(arm: SoftArm, internal: Array, q: Array, qd: Array, dt: float) -> Array:
    """Return the internal states after `dt`, docs/model.md (21) and (22), by the midpoint rule.

    Parameters
    ----------
    arm : SoftArm
        Model.
    internal : ndarray (n_internal,)
        Creep and hysteresis states.
    q, qd : ndarray (n_q,)
        Coordinates and rates, held over the step.
    dt : float
        Time step [s].

    Returns
    -------
    ndarray (n_internal,)
        A state that would not be finite keeps its value.
    """
    if internal.size == 0:
        return internal
    return arm.internal_midpoint(q, qd, internal, dt)
