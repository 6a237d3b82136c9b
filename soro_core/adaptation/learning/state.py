"""What the learner of an arm takes in one tick, and what it holds between two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from soro_core.adaptation.external_force import Stage
from soro_core.adaptation.learned import Learned
from soro_core.adaptation.learning.slope_evidence import NO_EVIDENCE, SlopeEvidence
from soro_core.adaptation.nonuniform_force import NonuniformForce
from soro_core.arrays import Array
from soro_core.frozen import quick


@quick
@dataclass(frozen=True)
class LearnerSample:
    """What one tick shows.

    Attributes
    ----------
    q, qd : ndarray (n_q,)
        Estimated coordinates and rates.
    pressure_pa : ndarray (n_u,)
        Measured pressures [Pa gauge].
    creep : ndarray (n_internal,)
        Creep and hysteresis states.
    covariance : ndarray (n_q, n_q)
        Covariance of q.
    unmodelled : NonuniformForce or None
        Unmodelled force near to q; the rest is learned.
    stage : {"free", "outside force", "contact"}
        What pushes from outside: under an outside force the mass alone is learned, in contact nothing.
    """

    q: Array
    qd: Array
    pressure_pa: Array
    creep: Array
    covariance: Array
    unmodelled: NonuniformForce | None = None
    stage: Stage = "free"


@dataclass(frozen=True)
class LearnerState:
    """State of the learner.

    Attributes
    ----------
    learned : Learned
        Mass, W and damping in force.
    chambers : ndarray
        Relative gains and slopes of the chambers in force, see `ChamberModel`.
    information, moment : ndarray (size, size), (size,)
        A and b of A (theta - start) = b.
    start : ndarray (size,)
        The prior's mean, from which it has started.
    prior : ndarray (size, size)
        A_0, a part of A.
    residual, regressor : ndarray (n_q,), (n_q, size); None before the first sample
        Both sides after the low-pass, in units of force.
    rate : ndarray (n_q,) or None
        qd of the last sample; None before the first one.
    waited_s, passed_s : float
        Time before the low-pass began, and since then [s].
    at_bound_s : float
        Time at a bound without a break [s].
    slopes : SlopeEvidence
        Whether the slopes of the areas are in force.
    refused, restored : int
        Samples that were not finite; restorations of the prior.
    judged_s, named : float, str
        Time since the chambers were judged [s], and those that differ from the others of their link.
    note : str
        What the last sample has caused, for the user; else empty.
    stage : {"free", "outside force", "contact"}
        Stage of the last sample.
    past : tuple
        What was known up to two times `PAST_S` ago, oldest first, each with its age: a force from outside is
        found a little after it has begun to teach.
    unpushed : tuple of float and two ndarray, or None
        Mass [kg], information and regressor before the present force from outside.
    """

    learned: Learned
    chambers: Array
    information: Array
    moment: Array
    start: Array
    prior: Array
    residual: Array | None = None
    regressor: Array | None = None
    rate: Array | None = None
    waited_s: float = 0.0
    passed_s: float = 0.0
    at_bound_s: float = 0.0
    slopes: SlopeEvidence = NO_EVIDENCE
    refused: int = 0
    restored: int = 0
    judged_s: float = 0.0
    named: str = ""
    note: str = ""
    stage: Stage = "free"
    past: tuple[tuple[Any, ...], ...] = ()
    unpushed: tuple[float, Array, Array] | None = None
