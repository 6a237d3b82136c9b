"""Forces that are found together."""

from __future__ import annotations

from typing import NamedTuple

from soro_core.arrays import Array


class MotionForces(NamedTuple):
    """Forces of a motion.

    Attributes
    ----------
    own : ndarray (n_q,)
        M a + C qd + G + dU_e/dq + R qd.
    by_mass : ndarray (n_q,)
        `SoftArm.tip_mass_force`.
    actuation : ndarray (n_q, n_u)
        `SoftArm.actuation_matrix`.
    """

    own: Array
    by_mass: Array
    actuation: Array
