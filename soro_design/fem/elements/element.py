"""Elements: shape functions, places and weights of integration, faces; lines, quadrilaterals and hexahedra.

Corners come in the order of VTK, then the nodes in the middles of edges, in the order of VTK too. One
formula serves all dimensions, because a node is known by its place xi in the cube [-1, 1]^d.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from itertools import product

import numpy as np

from soro_core.arrays import Array

_LINE = ((-1,), (1,), (0,))
_QUAD = ((-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0))
_BOTTOM = tuple((*corner, -1) for corner in _QUAD[:4])
_TOP = tuple((*corner, 1) for corner in _QUAD[:4])
_HEX = (
    *_BOTTOM,
    *_TOP,
    *((*middle, -1) for middle in _QUAD[4:]),
    *((*middle, 1) for middle in _QUAD[4:]),
    *((*corner, 0) for corner in _QUAD[:4]),
)
# Places of nodes, the element of their faces, the points of Gauss a direction, the number of VTK.
_KINDS = {
    "line2": (_LINE[:2], "", 2, 3),
    "line3": (_LINE, "", 3, 21),
    "quad4": (_QUAD[:4], "line2", 2, 9),
    "quad8": (_QUAD, "line3", 3, 23),
    "hex8": (_HEX[:8], "quad4", 2, 12),
    "hex20": (_HEX, "quad8", 3, 25),
}
SOLIDS = ("quad4", "quad8", "hex8", "hex20")


@dataclass(frozen=True, eq=False)
class Element:
    """One kind of element.

    Attributes
    ----------
    kind : str
        quad4, quad8, hex8 or hex20; of faces also line2 and line3.
    nodes : ndarray, (n, d)
        Places of the nodes.
    shape, slope : ndarray, (g, n) and (g, n, d)
        Shape functions and their derivatives by xi at the points of integration.
    weight : ndarray, (g,)
        Weights of these points.
    faces : ndarray, (f, m)
        Nodes of each face, in the order of its own kind and turned outwards.
    face : str
        Kind of the faces.
    vtk : int
        Number of the kind in VTK.
    """

    kind: str
    nodes: Array
    shape: Array
    slope: Array
    weight: Array
    faces: np.ndarray = field(repr=False)
    face: str
    vtk: int


def shapes(nodes: Array, xi: Array) -> tuple[Array, Array]:
    """Return shape functions (g, n) and their derivatives (g, n, d) of `nodes` (n, d) at `xi` (g, d).

    Linear where all nodes are corners, else of the serendipity family.
    """
    d = nodes.shape[1]
    is_corner = np.abs(nodes).sum(axis=1) == d
    is_linear = bool(is_corner.all())
    # One factor a direction: 1 + xi xi_a, or 1 - xi^2 across the edge of a node in its middle.
    is_across = (nodes == 0)[None]
    factor = np.where(is_across, 1.0 - xi[:, None] ** 2, 1.0 + xi[:, None] * nodes[None])
    factor_slope = np.where(is_across, -2.0 * xi[:, None], np.broadcast_to(nodes[None], factor.shape))
    share = 0.5 ** np.abs(nodes).sum(axis=1)
    value = share * factor.prod(axis=2)
    slope = np.empty((*value.shape, d))
    for k in range(d):
        others = np.delete(factor, k, axis=2).prod(axis=2)
        slope[:, :, k] = share * others * factor_slope[:, :, k]
    if is_linear:
        return value, slope
    # Corners of the serendipity family vanish in the middles of their edges.
    last = np.where(is_corner, xi @ nodes.T - (d - 1.0), 1.0)
    last_slope = np.where(is_corner[:, None], nodes, 0.0)
    return value * last, slope * last[..., None] + value[..., None] * last_slope


@cache
def element(kind: str) -> Element:
    """Return an element by its kind."""
    places, face, points, vtk = _KINDS[kind]
    nodes = np.array(places, dtype=float)
    at, by = np.polynomial.legendre.leggauss(points)
    d = nodes.shape[1]
    xi = np.array(list(product(at, repeat=d)))
    weight = np.array(list(product(by, repeat=d))).prod(axis=1)
    shape, slope = shapes(nodes, xi)
    return Element(kind, nodes, shape, slope, weight, _faces(nodes, face), face, vtk)


def _faces(nodes: Array, face: str) -> np.ndarray:
    """Nodes of the faces xi_k = -1 and 1 of each direction, turned outwards."""
    if not face:
        return np.empty((0, 0), dtype=np.int64)
    d = nodes.shape[1]
    places = np.array(_KINDS[face][0], dtype=float)
    found = []
    for k, side in product(range(d), (-1.0, 1.0)):
        along = [(k + 1) % d] if d == 2 else [(k + 1) % 3, (k + 2) % 3]
        # A quarter turn from x to y, then outwards is to the right of an edge; of a face, as of a screw.
        sign = side * (1.0 if d == 3 or k == 0 else -1.0)
        on_face = np.full((len(places), d), side)
        on_face[:, along] = places
        on_face[:, along[0]] *= sign
        found.append([int(np.flatnonzero((nodes == place).all(axis=1))[0]) for place in on_face])
    return np.array(found, dtype=np.int64)
