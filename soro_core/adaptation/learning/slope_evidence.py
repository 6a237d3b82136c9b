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

# Time over which the evidence is a mean [s].
_MEAN_S = 2.0
# Slopes come into force where the squares that are missed without them are larger by exp(0.6) = 1.8, and go
# where they are smaller by as much. What they explain is no longer missed, and W has got used to them: no
# evidence is none against them.
_ENOUGH = 0.6
# Squares, by the noise, that are as good as none: there is nothing to explain.
_AS_NONE = 0.05


@dataclass(frozen=True)
class SlopeEvidence:
    """What predictions have said of the slopes.

    Attributes
    ----------
    adopted : bool
        Whether the slopes are in force; else they stay at their start.
    mean : float
        Mean logarithm of the ratio of the squares that are missed without and with slopes; at least 0 while
        they are not in force.
    rivals : ndarray (2, size) or None
        Best values without and with slopes, beyond the start, when they were compared last.
    """

    adopted: bool = False
    mean: float = 0.0
    rivals: Array | None = None


NO_EVIDENCE = SlopeEvidence()


def compared(
    evidence: SlopeEvidence, sides: tuple[Array, Array], noise: Array, since_s: float
) -> tuple[bool, float]:
    """Return `adopted` and `mean` after a sample.

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
        return evidence.adopted, evidence.mean
    residual, regressor = sides
    missed = residual[:, None] - regressor @ evidence.rivals.T
    without, beside = np.mean(missed * np.linalg.solve(noise, missed), axis=0) + _AS_NONE
    mean = evidence.mean + since_s / _MEAN_S * (math.log(without / beside) - evidence.mean)
    if evidence.adopted:
        return mean > -_ENOUGH, mean
    # A start that swings speaks against what is not in force, and would delay it.
    mean = max(mean, 0.0)
    return mean > _ENOUGH, mean


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
