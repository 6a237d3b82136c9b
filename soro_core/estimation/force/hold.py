"""What the filter's model lacks to be where the arm is held from outside: it predicts with this force.

What the model lacks is what balances it where its place is measured, without its acceleration: that of the
filter would drive the filter. The part of it at the tip keeps its direction while the arm turns under it; the
rest is that of one constant strain where a force bends a link non-uniformly.
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
    missing : ndarray (n_q,)
        Generalised force that the model asks for there beyond that of the pressures.
    learned : Learned
        What is learned, less this.
    """

    q: Array
    missing: Array
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
        Part of the way that what is missing goes to a new value, and time since the last one [s].

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
    missing = asked - arm.pressure_force(q, seen.pressure_pa)
    if before is not None:
        missing = before.missing + part * (missing - before.missing)
    return TipHold(q, missing, learned.with_force(q, -missing, -_by_q(force, q, seen.force_n), scales))


def _by_q(force: LearnedForce, q: Array, force_n: Array) -> Array:
    """Return the derivative (n_q, n_q) of the generalised force of a force at the tip."""
    arm, unit = force.arm, _STEP * force.scales.q
    found = [
        arm.pose_and_jacobian(q + step, arm.length) for step in np.vstack([np.zeros(q.size), np.diag(unit)])
    ]
    forces = np.stack([jacobian[3:].T @ pose[:3, :3].T @ force_n for pose, jacobian in found])
    return np.asarray((forces[1:] - forces[0]).T / unit)
