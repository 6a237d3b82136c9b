"""Output of the estimator: estimate, status and counts of samples."""

from __future__ import annotations

from typing import NamedTuple

from soro_core.adaptation.external_force import ExternalForce
from soro_core.arrays import Array


class Counts(NamedTuple):
    """Counts of samples and steps since the start.

    Attributes
    ----------
    accepted, outliers, invalid : int
        Samples fused; refused by the chi-square gate; refused for a value that is not finite or not allowed.
    stale, early : int
        Samples refused because their stamp is too old or did not increase; because it is too far in the
        future.
    frozen : int
        Poses refused because their sensor repeats one under new stamps while the arm moves.
    learned : int
        Learned models refused for a wrong shape or a value that is not finite.
    reacquired : int
        Re-acquisitions of the state from a sensor after many outliers in a row.
    pressures : int
        Sets of pressures with a reading that was not finite, replaced by the last good one.
    failed : int
        Predictions or updates without a finite result, which were undone.
    restarted : int
        Restarts after a gap in time or a loss of the state.
    """

    accepted: int = 0
    outliers: int = 0
    invalid: int = 0
    stale: int = 0
    early: int = 0
    frozen: int = 0
    learned: int = 0
    reacquired: int = 0
    pressures: int = 0
    failed: int = 0
    restarted: int = 0


class EstimatorStatus(NamedTuple):
    """Whether the estimate may be used.

    Attributes
    ----------
    ok : bool
        Whether it may.
    message : str
        Why not; empty where it may.
    counts : Counts
        Counts of samples and steps since the start.
    age_s : float
        Time since the last sample that was fused [s]; infinite before the first.
    note : str
        What the user must know of an estimate that may be used.
    """

    ok: bool
    message: str
    counts: Counts
    age_s: float
    note: str = ""


class Estimate(NamedTuple):
    """State of the arm.

    Attributes
    ----------
    t_s : float
        Its time [s].
    q, qd : ndarray (n_q,)
        Coordinates and rates.
    covariance : ndarray (2 n_q, 2 n_q)
        Covariance of (q, qd).
    tip_pose : ndarray (4, 4)
        Pose of the tip in the world frame; the position in m.
    tip_covariance : ndarray (6, 6)
        Covariance of position and rotation of the tip, in this order, along the world's axes; it includes the
        configured errors of the kinematics.
    force : ndarray (n_q,)
        Generalised force of the measured pressures, H p.
    disturbance : ndarray (n_q,)
        Acceleration that the model does not explain; 0 if it is not estimated.
    positions : bool
        Whether poses were fused lately, not orientations alone.
    unseen : ndarray (n_q, n_q)
        Covariance of q, beside that of the filter, in directions that no position shows: a learner must doubt
        what the filter takes from its model.
    status : EstimatorStatus
        Whether it may be used.
    external : ExternalForce or None
        What pushes on the arm at its tip; None where it is not estimated.
    """

    t_s: float
    q: Array
    qd: Array
    covariance: Array
    tip_pose: Array
    tip_covariance: Array
    force: Array
    disturbance: Array
    positions: bool
    unseen: Array
    status: EstimatorStatus
    external: ExternalForce | None = None
