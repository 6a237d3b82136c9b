"""How an arm moves by itself: its first bending and its first stretching, and what accelerates it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from soro_core.adaptation.scales import FORCE_PART, scales_of
from soro_core.arrays import Array
from soro_core.robot.coordinates import strain_fields

if TYPE_CHECKING:
    from soro_core.model import SoftArm


# Strains and rates for difference quotients of the losses, which are linear in them but for hysteresis.
_STEP = 1e-6


@dataclass(frozen=True)
class Mode:
    """The slowest motion of one kind about the straight arm, without gravity.

    Attributes
    ----------
    rate_per_s : float
        Angular frequency without losses [rad/s].
    uniform_rate_per_s : float
        That of strains that are uniform along their links alone, whatever the basis [rad/s].
    damping : float
        Part of the critical damping, creep and hysteresis included.
    acceleration : float
        Acceleration of a strain of the kind by one unit of force on each, geometric mean of the strains
        [1/s^2 or 1/(m s^2)].
    """

    rate_per_s: float
    uniform_rate_per_s: float
    damping: float
    acceleration: float


def least_stiffness(arm: SoftArm, force: Callable[[Array], Array], q: Array, k_p: Array) -> float:
    """Return how stiff the arm is at least with a feedback, in parts of its own stiffness.

    Parameters
    ----------
    arm : SoftArm
        With stiffness in each coordinate.
    force : callable
        Gives the force (n_q,) that pressures lack to hold the arm at coordinates (n_q,).
    q : ndarray (n_q,)
        Where it is taken.
    k_p : ndarray (n_q, n_q)
        Of the feedback.

    Returns
    -------
    float
        Below 0 the arm leaves `q` by itself; infinite where the forces are not finite.

    Raises
    ------
    LinAlgError
        If the arm has a strain without stiffness.
    """
    from scipy.linalg import eigh  # imported here: a scene reads the keys of a learner without it

    steps, here = _STEP * scales_of(arm).q, force(q)
    change = np.array([(force(q + step) - here) / h for step, h in zip(np.diag(steps), steps, strict=True)]).T
    if not np.isfinite(change).all():
        return math.inf
    own = arm.stiffness_matrix(np.zeros(arm.n_q))
    return float(eigh(0.5 * (change + change.T) + k_p, own, eigvals_only=True)[0])


def first_mode(arm: SoftArm, stretch: bool) -> Mode | None:
    """Return the first mode of elongation and shears, or of bending and torsion.

    Parameters
    ----------
    arm : SoftArm
        With stiffness in each coordinate.
    stretch : bool
        True for elongation and shears.

    Returns
    -------
    Mode or None
        None where the arm has no such strain.

    Raises
    ------
    ConfigError
        If a coordinate has no stiffness.
    """
    fields = strain_fields(arm.robot)
    of_kind = fields.stretch == stretch
    if not of_kind.any():
        return None
    zero = np.zeros(arm.n_q)
    unit = scales_of(arm).q[fields.first]
    stiffness, inertia = arm.stiffness_matrix(zero), arm.inertia_matrix(zero)
    rate, shape = _slowest(stiffness, inertia, of_kind)
    # Strains that are uniform along their links alone: what is pushed then does not depend on the basis.
    uniform = np.where(np.arange(len(fields.first)) == fields.index[:, None], fields.uniform[:, None], 0.0)
    stiffness, inertia = uniform.T @ stiffness @ uniform, uniform.T @ inertia @ uniform
    uniform_rate, _ = _slowest(stiffness, inertia, of_kind[fields.first])
    force = FORCE_PART * np.diag(stiffness) * unit
    pushed = np.linalg.norm(np.linalg.solve(inertia, np.diag(force)), axis=1)
    acceleration = float(np.exp(np.mean(np.log(pushed[of_kind[fields.first]]))))
    return Mode(rate, uniform_rate, float(shape @ losses(arm, rate) @ shape) / (2.0 * rate), acceleration)


def _slowest(stiffness: Array, inertia: Array, of_kind: NDArray[np.bool_]) -> tuple[float, Array]:
    """Return angular frequency and shape of the slowest mode that is mostly of some strains."""
    from scipy.linalg import eigh  # imported here: a scene reads the keys of a learner without it

    square, shapes = eigh(stiffness, inertia)
    energy = shapes * (stiffness @ shapes)
    share = energy[of_kind].sum(axis=0) / energy.sum(axis=0)
    # Coupled modes may be half of each kind.
    index = int(np.argmax(share >= min(0.5, float(share.max()))))
    return float(np.sqrt(square[index])), shapes[:, index]


def losses(arm: SoftArm, rate_per_s: float) -> Array:
    """Return the damping (n_q, n_q) of the straight arm at a rate [rad/s], creep and hysteresis included."""
    if arm.n_internal == 0:
        return np.asarray(arm.damping_matrix())
    zero, still = np.zeros(arm.n_q), np.zeros(arm.n_internal)
    steps, moves = _STEP * np.eye(arm.n_internal), _STEP * np.eye(arm.n_q)
    back = np.stack([arm.internal_rate(zero, zero, step) for step in steps], axis=1) / _STEP
    driven = np.stack([arm.internal_rate(zero, move, still) for move in moves], axis=1) / _STEP
    made = np.stack([arm.internal_force(zero, step) for step in steps], axis=1) / _STEP
    state = np.linalg.solve(1j * rate_per_s * np.eye(arm.n_internal) - back, driven)
    return np.asarray(arm.damping_matrix() + np.real(made @ state))
