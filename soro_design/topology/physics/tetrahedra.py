"""The solid of a design in space: the tetrahedra of its grid, cut along the contour.

A tetrahedron that the contour cuts leaves a tetrahedron or a wedge; the diagonals of a wedge begin at its
least node, so that neighbours agree about them.
"""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array, Integers
from soro_design.fem.meshes.blocks import AROUND_DIAGONAL
from soro_design.topology.physics.grid import Grid

# Turns of a wedge (0, 1, 2 below 3, 4, 5) that bring each node to its first place.
_TURNS = ((0, 1, 2, 3, 4, 5), (1, 2, 0, 4, 5, 3), (2, 0, 1, 5, 3, 4))
_TURNED_OVER = tuple(tuple(turn[k] for k in (3, 5, 4, 0, 2, 1)) for turn in _TURNS)
_WEDGE = np.array((*_TURNS, *(tuple(t) for t in _TURNED_OVER)))
_ONE_DIAGONAL = ((0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3))
_OTHER_DIAGONAL = ((0, 1, 2, 4), (0, 4, 2, 5), (0, 4, 5, 3))


def tetrahedra(grid: Grid) -> Integers:
    """Return the corners (t, 4) of the tetrahedra of a grid of hex8."""
    return np.asarray(grid.mesh.cells[:, np.array(AROUND_DIAGONAL)].reshape(-1, 4))


def edges_of(cells: Integers) -> Integers:
    """Return the edges (m, 2) of tetrahedra (t, 4), each once."""
    pairs = np.concatenate([cells[:, [i, j]] for i in range(4) for j in range(i + 1, 4)])
    return np.asarray(np.unique(np.sort(pairs, axis=1), axis=0))


def cut_tetrahedra(cells: Integers, points: Array, level: Array) -> tuple[Array, Integers]:
    """Return points (n, 3) and tetrahedra (t, 4) of what has a level above 0.

    Parameters
    ----------
    cells : ndarray of int, (t, 4)
        Tetrahedra.
    points : ndarray, (n, 3)
        Their corners [m].
    level : ndarray, (n,)
        Of the corners; linear between them.
    """
    # Nodes in the solid first.
    cells = np.take_along_axis(cells, np.argsort(level[cells] <= 0.0, axis=1, kind="stable"), axis=1)
    count = (level[cells] > 0.0).sum(axis=1)
    n = len(points)

    def between(a: Integers, b: Integers) -> Integers:
        """Key of the cut of an edge from solid to void: the node b where that lies on the contour."""
        return np.asarray(np.where(level[b] == 0.0, b * (n + 1), np.minimum(a, b) * n + np.maximum(a, b)))

    p, q, r, s = (cells[:, k] * (n + 1) for k in range(4))
    a, b, c, d = cells.T
    tets = [np.stack([p, between(a, b), between(a, c), between(a, d)], axis=1)[count == 1]]
    tets.append(np.stack([p, q, r, s], axis=1)[count == 4])
    two = [p, between(a, c), between(a, d), q, between(b, c), between(b, d)]
    three = [p, q, r, between(a, d), between(b, d), between(c, d)]
    wedges = np.concatenate([np.stack(two, axis=1)[count == 2], np.stack(three, axis=1)[count == 3]])
    keys = np.concatenate([*tets, _divided(wedges)])
    ordered = np.sort(keys, axis=1)
    keys = keys[(ordered[:, 1:] != ordered[:, :-1]).all(axis=1)]
    used, numbers = np.unique(keys, return_inverse=True)
    low, high = np.divmod(used, n)
    # Of a node itself both are the same.
    drop = level[low] - level[high]
    share = np.divide(level[low], drop, out=np.zeros(len(used)), where=drop != 0.0)
    return points[low] + share[:, None] * (points[high] - points[low]), numbers.reshape(keys.shape)


def turned(points: Array, cells: Integers) -> Integers:
    """Return tetrahedra (t, 4) of positive volume."""
    at = points[cells]
    volume = np.linalg.det(at[:, 1:] - at[:, :1])
    return np.asarray(np.where((volume < 0.0)[:, None], cells[:, [1, 0, 2, 3]], cells))


def _divided(wedges: Integers) -> Integers:
    """Tetrahedra of wedges (w, 6) by the numbers of their nodes (Dompierre et al. 1999)."""
    turn = _WEDGE[np.argmin(wedges, axis=1)]
    turned = np.take_along_axis(wedges, turn, axis=1)
    is_one = np.minimum(turned[:, 1], turned[:, 5]) < np.minimum(turned[:, 2], turned[:, 4])
    parts = [
        turned[some][:, np.array(diagonal)].reshape(-1, 4)
        for some, diagonal in ((is_one, _ONE_DIAGONAL), (~is_one, _OTHER_DIAGONAL))
    ]
    return np.concatenate(parts)
