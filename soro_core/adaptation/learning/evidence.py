"""Which model of an arm is in force: its file, slopes of the areas, or another stiffness of all strains.

On one motion a slope looks like a stiffness or a load, and what samples say of it is no proof: models of all
kinds are solved for from the same samples, and predict those that come afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from soro_core.adaptation.learning.bounds import bounded_minimum
from soro_core.arrays import Array

Rival: TypeAlias = Literal["file", "slopes", "stiffness"]
RIVALS: tuple[Rival, ...] = ("file", "slopes", "stiffness")
# Time over which the evidence is a mean [s].
_MEAN_S = 2.0
# A rival comes into force where the squares that are missed by the one in force are larger by exp(0.6) = 1.8.
# What it explains then is no longer missed, and W has got used to it: no evidence is none against it.
_ENOUGH = 0.6
# Slopes come only where they are better than another stiffness by this: with one motion they explain one,
# too, and the force that the arm feels would be wrong by as much.
_SIMPLER = 0.2
# Squares, by the noise, that are as good as none: there is nothing to explain.
_AS_NONE = 0.05


@dataclass(frozen=True)
class RivalEvidence:
    """What predictions have said of the rivals.

    Attributes
    ----------
    adopted : {"file", "slopes", "stiffness"}
        The rival in force.
    means : tuple of float
        Mean logarithm of the ratio of the squares that are missed by the file and by each rival; at least 0
        where it is not in force.
    rivals : ndarray (3, size) or None
        Best values of each, beyond the start, when they were compared last.
    """

    adopted: Rival = "file"
    means: tuple[float, ...] = (0.0, 0.0, 0.0)
    rivals: Array | None = None


NO_EVIDENCE = RivalEvidence()


def compared(
    evidence: RivalEvidence, sides: tuple[Array, Array], noise: Array, since_s: float
) -> tuple[Rival, tuple[float, ...]]:
    """Return `adopted` and `means` after a sample.

    Parameters
    ----------
    evidence : RivalEvidence
    sides : tuple of ndarray (n,), (n, size)
        Residual and regressor, which the rivals have not seen.
    noise : ndarray (n, n)
        Covariance of the residual.
    since_s : float
        Time since the rivals were found [s].
    """
    if evidence.rivals is None:
        return evidence.adopted, evidence.means
    residual, regressor = sides
    missed = residual[:, None] - regressor @ evidence.rivals.T
    squares = (np.mean(missed * np.linalg.solve(noise, missed), axis=0) + _AS_NONE).tolist()
    part, means = since_s / _MEAN_S, []
    for rival, mean, square in zip(RIVALS, evidence.means, squares, strict=True):
        mean += part * (math.log(squares[0] / square) - mean)
        # A start that swings speaks against what is not in force, and would delay it.
        means.append(mean if rival == evidence.adopted else max(mean, 0.0))
    of = dict(zip(RIVALS, means, strict=True))
    if evidence.adopted != "slopes" and of["slopes"] < of["stiffness"] + _SIMPLER:
        del of["slopes"]
    best = max(of, key=of.__getitem__)
    is_better = of[best] - of[evidence.adopted] > _ENOUGH
    if best != "file":  # where another one has become bad, this one is not yet good
        is_better = is_better and of[best] > _ENOUGH
    return best if is_better else evidence.adopted, tuple(means)


def rivals(informations: Sequence[Array], moment: Array, first: int, room: tuple[Array, Array]) -> Array:
    """Return the best values (3, size) of each rival.

    Parameters
    ----------
    informations : sequence of ndarray (size, size)
        Of all values, with the prior of each rival.
    moment : ndarray (size,)
    first : int
        Number of values before the slopes.
    room : tuple of ndarray (size,)
        Bounds of the values.
    """
    found = np.zeros((len(RIVALS), moment.size))
    for values, rival, information in zip(found, RIVALS, informations, strict=True):
        count = moment.size if rival == "slopes" else first
        A, b = information[:count, :count], moment[:count]
        free = np.asarray(np.linalg.solve(A, b), dtype=np.float64)
        values[:count] = bounded_minimum(A, b, free, *(bound[:count] for bound in room))
    return found
