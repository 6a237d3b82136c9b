"""Fibres that carry tension alone, and tendons of a given tension; docs/parts.md (1) and (2).

Both are straight pieces between nodes. The nodes of a piece lie in one element, so that its stiffness has a
place in the matrix of the part.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from soro_core._jit import kernel
from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError


@dataclass(frozen=True, eq=False)
class Fibres:
    """Pieces between nodes.

    Attributes
    ----------
    pieces : ndarray of int, (m, 2)
        Their two nodes.
    stiffness_n : ndarray, (m,)
        EA [N]: tension per strain of a piece that is longer than in the undeformed mesh; 0 in a shorter one.
    tension_n : ndarray, (m,)
        Tension besides [N] at load factor 1, whatever the length: that of a tendon that slides.
    """

    pieces: Integers
    stiffness_n: Array
    tension_n: Array


def pieces_of(chains: Iterable[Sequence[int]]) -> Integers:
    """Return the pieces (m, 2) of chains of nodes; a ring ends with the node that it begins with."""
    pieces = [pair for chain in chains for pair in pairwise(chain)]
    return np.array(pieces, dtype=np.int64).reshape(-1, 2)


def fibres(pieces: Integers, stiffness_n: ArrayLike = 0.0, tension_n: ArrayLike = 0.0) -> Fibres:
    """Return checked fibres.

    Parameters
    ----------
    pieces : ndarray of int, (m, 2)
        Nodes of each piece, see `pieces_of`.
    stiffness_n, tension_n : float or array_like, (m,)
        EA and tension [N], both 0 or more.

    Raises
    ------
    ModelError
        If a number is negative or not finite, or a piece joins a node to itself.
    """
    if pieces.ndim != 2 or pieces.shape[1] != 2 or (pieces[:, 0] == pieces[:, 1]).any():
        raise ModelError(f"pieces of shape {pieces.shape}; allowed: pairs of different nodes", "pieces")
    found = []
    for name, values in (("stiffness_n", stiffness_n), ("tension_n", tension_n)):
        each = np.broadcast_to(np.asarray(values, dtype=float), len(pieces)).copy()
        if not (np.isfinite(each) & (each >= 0.0)).all():
            raise ModelError(f"{name} {values!r}; allowed: finite numbers, 0 or more", name)
        found.append(each)
    return Fibres(pieces, *found)


@kernel
def add_fibres(
    fibres: tuple[Integers, Array, Array],
    places: tuple[Array, Array],
    force: Array,
    into: tuple[Integers, Array],
) -> float:
    """Add the forces of pieces to `force` (n, d) and their stiffness to `data` unless empty.

    Return their strain energy [J]. `fibres` has pieces, stiffness and tension; `places` X and x (n, d),
    undeformed and deformed; `into`: position (m, 2 d, 2 d) says where in `data` the stiffness of a piece
    goes.
    """
    pieces, stiffness, tension = fibres
    X, x = places
    position, data = into
    d = X.shape[1]
    along = np.empty(d)
    energy = 0.0
    for m in range(pieces.shape[0]):
        a, b = pieces[m, 0], pieces[m, 1]
        rest, length = 0.0, 0.0
        for i in range(d):
            rest += (X[b, i] - X[a, i]) ** 2
            along[i] = x[b, i] - x[a, i]
            length += along[i] ** 2
        rest, length = math.sqrt(rest), math.sqrt(length)
        strain = max(length / rest - 1.0, 0.0)
        pull = tension[m] + stiffness[m] * strain
        energy += 0.5 * stiffness[m] * rest * strain * strain
        for i in range(d):
            along[i] /= length
            force[a, i] -= pull * along[i]
            force[b, i] += pull * along[i]
        if data.shape[0] == 0:
            continue
        axial = stiffness[m] / rest if strain > 0.0 else 0.0
        across = pull / length
        for i in range(d):
            for j in range(d):
                value = (axial - across) * along[i] * along[j] + (across if i == j else 0.0)
                data[position[m, i, j]] += value
                data[position[m, d + i, d + j]] += value
                data[position[m, i, d + j]] -= value
                data[position[m, d + i, j]] -= value
    return energy
