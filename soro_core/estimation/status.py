"""What the estimator hands out: the estimate, and what became of the samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Counts:
    """What became of the samples and steps since the start.

    Attributes
    ----------
    accepted, outliers, invalid : int
        Samples fused; refused by the chi-square gate; refused for a value that is not a number.
    stale, early : int
        Samples refused because their stamp did not increase or is too old; because it lies in the future.
    reacquired : int
        Times that a sensor was believed again after many outliers in a row.
    pressures : int
        Pressure readings that were not finite and were replaced by the last good ones.
    failed : int
        Predictions or updates that gave no finite result and were undone.
    restarted : int
        Restarts after a gap in time or a loss of the state.
    """

    accepted: int = 0
    outliers: int = 0
    invalid: int = 0
    stale: int = 0
    early: int = 0
    reacquired: int = 0
    pressures: int = 0
    failed: int = 0
    restarted: int = 0


@dataclass(frozen=True)
class EstimatorStatus:
    """Whether the estimate may be used; `message` says why not, and is empty where it may."""

    ok: bool
    message: str
    counts: Counts
    age_s: float
    """Time since the last sample that was fused [s]; infinite before the first."""


@dataclass(frozen=True)
class Estimate:
    """State of the arm at `t_s`.

    Attributes
    ----------
    q, qd : ndarray (n_q,)
        Coordinates and rates.
    covariance : ndarray (2 n_q, 2 n_q)
        Of (q, qd).
    tip_pose : ndarray (4, 4)
        Pose of the tip in the world frame.
    tip_covariance : ndarray (6, 6)
        Of the tip's position and rotation, both along the world's axes, position first; the errors of the
        kinematics that the configuration declares are included.
    force : ndarray (n_q,)
        Generalised force of the measured pressures, H p.
    disturbance : ndarray (n_q,)
        Acceleration that the model does not explain; zeros where it is not estimated.
    """

    t_s: float
    q: Array
    qd: Array
    covariance: Array
    tip_pose: Array
    tip_covariance: Array
    force: Array
    disturbance: Array
    status: EstimatorStatus
