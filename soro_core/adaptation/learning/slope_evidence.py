"""Whether learned slopes of the areas are in force: where models with them predict better than without.

On one motion a slope looks like a stiffness or a load, and what samples say of it is no proof: models of both
kinds are solved for from the same samples, and predict those that come afterwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.adaptation.learning.bounds import bounded_minimum
from soro_core.arrays import Array

# Slopes come into force at this sum over time of the logarithm of the squares that are missed without them,
# by those with them [s], and go at as much against them (ADR 0088). What slopes explain is no longer missed,
# and W has got used to them: no evidence is none against them.
_ENOUGH_S = 0.37
# Added to both squares, in those of the noise: what is well within five deviations counts little. A stiffness
# that W has still to learn misses less, and for some seconds; a slope for as long as it is not in force.
_ADDED = 25.0


@dataclass(frozen=True)
class SlopeEvidence:
    """What predictions have said of the slopes.

    Attributes
    ----------
    adopted : bool
        Whether the slopes are in force; else they stay at their start.
    sum_s : float
        Sum over time of the logarithm of the ratio of the squares that are missed without and with slopes
        [s]: at least 0 while they are not in force, at most 0 while they are (Page's test).
    rivals : ndarray (2, size) or None
        Best values without and with slopes, beyond the start, when they were compared last.
    """

    adopted: bool = False
    sum_s: float = 0.0
    rivals: Array | None = None


NO_EVIDENCE = SlopeEvidence()


def compared(
    evidence: SlopeEvidence, sides: tuple[Array, Array], noise: Array, since_s: float
) -> tuple[bool, float]:
    """Return `adopted` and `sum_s` after a sample.

    Parameters
    ----------
    evidence : SlopeEvidence
    sides : tuple of ndarray (n,), (n, size)
        Residual and regressor, which the rivals have not seen.
    noise : ndarray (n, n)
        Covariance of the residual.
    since_s : float
        Time since the rivals were found [s].
    """
    if evidence.rivals is None:
        return evidence.adopted, evidence.sum_s
    residual, regressor = sides
    missed = residual[:, None] - regressor @ evidence.rivals.T
    without, beside = np.mean(missed * np.linalg.solve(noise, missed), axis=0) + _ADDED
    total = evidence.sum_s + since_s * math.log(without / beside)
    # The 0 stands first: a sum that is no number is no evidence.
    total = min(0.0, total) if evidence.adopted else max(0.0, total)
    if abs(total) > _ENOUGH_S:
        return not evidence.adopted, 0.0
    return evidence.adopted, total


def rivals(information: Array, moment: Array, first: int, room: tuple[Array, Array]) -> Array:
    """Return the best values (2, size) without and with slopes.

    Parameters
    ----------
    information, moment : ndarray (size, size), (size,)
        Of all values.
    first : int
        Number of values before the slopes.
    room : tuple of ndarray (size,)
        Bounds of the values.
    """
    found = np.zeros((2, moment.size))
    for values, count in zip(found, (first, moment.size), strict=True):
        A, b = information[:count, :count], moment[:count]
        free = np.asarray(np.linalg.solve(A, b), dtype=np.float64)
        values[:count] = bounded_minimum(A, b, free, *(bound[:count] for bound in room))
    return found
