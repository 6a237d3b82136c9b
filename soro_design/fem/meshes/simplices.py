"""Quadrilaterals and hexahedra in place of triangles and tetrahedra: each corner gets one of its own.

A new element runs from a corner of the old one over the middles of its edges and faces to its middle. So
meshes of programs that know triangles and tetrahedra alone become ones that do not lock.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from soro_core.arrays import Array, Integers

# Corners whose middle is a node of the new element at corner 0; the others follow by turning the old one.
_QUAD = ((0,), (0, 1), (0, 1, 2), (0, 2))
_HEX = ((0,), (0, 1), (0, 1, 2), (0, 2), (0, 3), (0, 1, 3), (0, 1, 2, 3), (0, 2, 3))
# Corners in an order of the same sense that begins with each.
_TURNS = {3: ((0, 1, 2), (1, 2, 0), (2, 0, 1)), 4: ((0, 1, 2, 3), (1, 0, 3, 2), (2, 3, 0, 1), (3, 2, 1, 0))}


def split(points: Array, simplices: Integers) -> tuple[Array, Integers, list[Integers]]:
    """Return points, and three quad4 of each triangle or four hex8 of each tetrahedron.

    Third come the corners of which the new points are the middles, in their order: of edges (m, 2), of
    triangles (m, 3), of tetrahedra (m, 4).

    Parameters
    ----------
    points : ndarray, (n, d)
        Places of the corners.
    simplices : ndarray of int, (s, d + 1)
        Corners of each, numbered in the sense of VTK.
    """
    count = simplices.shape[1]
    found: dict[tuple[int, ...], Integers] = {(k,): simplices[:, k] for k in range(count)}
    places, middles, first = [points], [], len(points)
    for size in range(2, count + 1):
        these = list(combinations(range(count), size))
        corners = np.concatenate([np.sort(simplices[:, one], axis=1) for one in these])
        # What several elements share has one middle.
        shared, inverse = np.unique(corners, axis=0, return_inverse=True)
        found |= dict(zip(these, np.split(first + inverse.ravel(), len(these)), strict=True))
        places.append(points[shared].mean(axis=1))
        middles.append(shared)
        first += len(shared)
    nodes = _QUAD if count == 3 else _HEX
    cells = [
        np.stack([found[tuple(sorted(turn[k] for k in node))] for node in nodes], axis=1)
        for turn in _TURNS[count]
    ]
    return np.concatenate(places), np.concatenate(cells).astype(np.int64), middles
