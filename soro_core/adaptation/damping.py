"""Damping that is learned: one retardation time for the stretch and one for the bend of each link.

Beside the robot file's damping R, that of a kind of strain of link i is taken as tau_k K_k, with the
stiffness K_k of these coordinates at rest, q = 0. So one number holds for both bends, for all
coefficients of a strain and for all pieces of a link, and the units do not depend on the arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from soro_core.arrays import Array, Integers
from soro_core.robot.coordinates import strain_fields

if TYPE_CHECKING:
    from soro_core.model import SoftArm

# Largest retardation time [s]: what takes longer is creep, and no damping of an arm that is controlled.
MOST_S = 3.0
# Part of the variance of what has been found that is common to all.
_SHARED = 0.8
# Least part of the file's damping that stays.
LEAST_PART = 0.1


@dataclass(frozen=True)
class DampingModel:
    """The learned damping of one arm.

    Attributes
    ----------
    number : ndarray of int (n_q,)
        The retardation time of each coordinate.
    matrix : ndarray (n_q, n_q)
        Damping by 1 s: the stiffness between coordinates of one number.
    critical_s : ndarray (size,)
        Retardation time of critical damping [s], the largest of the stretches or bends of the arm.
    lower : ndarray (size,)
        Bounds [s]: a part of the file's damping stays.
    names : tuple of str
    """

    number: Integers
    matrix: Array
    critical_s: Array
    lower: Array
    names: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of retardation times."""
        return len(self.names)

    def prior(self, std: Array, far: Array) -> Array:
        """Return the inverse covariance (size, size) of what is expected of retardation times.

        Most files are right, and who has guessed one damping has guessed all: the prior has long tails. Links
        of one material share their retardation time.

        Parameters
        ----------
        std : ndarray (size,)
            Deviation where the file is right [s].
        far : ndarray (size,)
            What has been found [s], absolute.
        """
        found = float((far**2).max(initial=0.0))
        own = 1.0 / (std**2 + (1.0 - _SHARED) * found)
        common = _SHARED * found / (1.0 + _SHARED * found * own.sum())
        precision = np.multiply.outer(-common * own, own)
        precision.flat[:: own.size + 1] += own
        return np.asarray(precision)

    def force(self, times_s: Array, qd: Array) -> Array:
        """Return the force (n_q,) of retardation times (size,) [s] at rates (n_q,)."""
        return np.asarray(times_s[self.number] * (self.matrix @ qd))


def damping_model(arm: SoftArm, pieces: int = 1) -> DampingModel:
    """Return what is learned of the damping of an arm of which each link is divided into `pieces`."""
    fields, zero = strain_fields(arm.robot), np.zeros(arm.n_q)
    kinds = [
        (link // pieces, fields.stretch[first])
        for link, first in zip(fields.links, fields.first, strict=True)
    ]
    order = {kind: i for i, kind in enumerate(dict.fromkeys(kinds))}
    number = np.array([order[kind] for kind in kinds], dtype=np.int64)[fields.index]
    matrix = arm.stiffness_matrix(zero) * (number[:, None] == number)
    stiffness, inertia = np.diag(matrix), np.diag(arm.inertia_matrix(zero))
    # A strain without stiffness has no such time, and no learner.
    per_stiffness = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0.0)
    critical, present = 2.0 * np.sqrt(inertia * per_stiffness), arm.damping_matrix()
    groups = [np.flatnonzero((number == i) & (stiffness > 0.0)) for i in range(len(order))]
    return DampingModel(
        number,
        np.ascontiguousarray(matrix),
        np.array([critical[fields.stretch == stretch].max() for _, stretch in order]),
        np.array([(LEAST_PART - 1.0) * _least_time(present, matrix, own) for own in groups]),
        tuple(f"link{link * pieces}/{'stretch' if stretch else 'bend'}_damping" for link, stretch in order),
    )


def _least_time(damping: Array, stiffness: Array, own: Integers) -> float:
    """Return the shortest retardation time [s] of coordinates: below minus it they gain energy."""
    block = np.ix_(own, own)
    return float(eigh(damping[block], stiffness[block], eigvals_only=True)[0]) if own.size else 0.0
