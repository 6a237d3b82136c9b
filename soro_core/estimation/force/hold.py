"""What the filter's model lacks to be where the arm is held from outside: it predicts with this force.

The force at the tip keeps its direction while the arm turns under it. The rest, of one constant strain where
a force bends a link non-uniformly, is what balances the model where its place is measured, without its
acceleration: that of the filter would drive the filter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core.adaptation.force import LearnedForce
from soro_core.adaptation.learned import Learned
from soro_core.arrays import Array
from soro_core.errors import ModelError

# Part of a unit of q for the difference quotient of a force.
_STEP = 1e-5
# Largest way from the estimated coordinates, in their units.
_FAR = 3.0


class TipHold(NamedTuple):
    """What holds the arm.

    Attributes
    ----------
    q : ndarray (n_q,)
        Coordinates of the model that have the place where it is measured.
    rest : ndarray (n_q,)
        Generalised force that the model lacks there beside that at the tip.
    learned : Learned
        What is learned, with both.
    """

    q: Array
    rest: Array
    learned: Learned


class HeldPlace(NamedTuple):
    """What is measured: all behind one low-pass.

    Attributes
    ----------
    position : ndarray (3,)
        Position of a place [m].
    s : float
        The place, along the whole arm [m].
    q : ndarray (n_q,)
        Estimated coordinates, to which those of the model are nearest.
    pressure_pa : ndarray (n_u,)
        Pressures [Pa gauge].
    internal : ndarray (n_internal,)
        Creep and hysteresis states.
    force_n : ndarray (3,)
        Force at the tip [N].
    """

    position: Array
    s: float
    q: Array
    pressure_pa: Array
    internal: Array
    force_n: Array


def hold(
    force: LearnedForce, before: TipHold | None, seen: HeldPlace, learned: Learned, part: float, dt: float
) -> TipHold:
    """Return what holds the arm.

    Parameters
    ----------
    force : LearnedForce
        Of the filter's model.
    before : TipHold or None
        After the last estimate; None for a first one.
    seen : HeldPlace
    learned : Learned
        What is learned now.
    part, dt : float
        Part of the way that the rest goes to a new value, and time since the last one [s].

    Raises
    ------
    ModelError
        If no coordinates have the place there.
    """
    arm, scales, q = force.arm, force.scales, seen.q
    for _ in range(2):
        pose, jacobian = arm.pose_and_jacobian(q, seen.s)
        columns = pose[:3, :3] @ jacobian[3:] * scales.q
        q = q + scales.q * np.linalg.lstsq(columns, seen.position - pose[:3, 3], rcond=None)[0]
    if not np.all(np.abs(q - seen.q) < _FAR * scales.q):  # what is not finite is not less
        raise ModelError(f"no coordinates near {seen.q} have the place at {seen.position} m")
    qd = np.zeros(arm.n_q) if before is None or dt <= 0.0 else (q - before.q) / dt
    asked = arm.gravity_force(q) + arm.elastic_force(q) + arm.damping_force(q, qd)
    asked = asked + arm.internal_force(q, seen.internal) + force.force(learned, q, qd, np.zeros(arm.n_q))
    of_tip, by_q = _of_tip(force, q, seen.force_n)
    rest = arm.pressure_force(q, seen.pressure_pa) - asked + of_tip
    if before is not None:
        rest = before.rest + part * (rest - before.rest)
    return TipHold(q, rest, learned.with_force(q, rest - of_tip, -by_q, scales))


def _of_tip(force: LearnedForce, q: Array, force_n: Array) -> tuple[Array, Array]:
    """Return the generalised force (n_q,) of a force at the tip, and its derivative (n_q, n_q)."""
    arm, unit = force.arm, _STEP * force.scales.q
    found = [
        arm.pose_and_jacobian(q + step, arm.length) for step in np.vstack([np.zeros(q.size), np.diag(unit)])
    ]
    forces = np.stack([jacobian[3:].T @ pose[:3, :3].T @ force_n for pose, jacobian in found])
    return forces[0], (forces[1:] - forces[0]).T / unit
