"""Elements: shape functions, places and weights of integration, faces.

Corners come in the order of VTK, then the nodes in the middles of edges, in the order of VTK too. One
formula serves lines, quadrilaterals and hexahedra, because a node is known by its place xi in the cube
[-1, 1]^d; another one triangles and tetrahedra, with xi >= 0 and a sum of at most 1.
"""

from __future__ import annotations

import math
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
_TRI = ((0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5))
_TET = (
    *((*node, 0) for node in _TRI[:3]),
    (0, 0, 1),
    *((*middle, 0) for middle in _TRI[3:]),
    *((0.5 * x, 0.5 * y, 0.5) for x, y in _TRI[:3]),
)
# Places of nodes, the element of their faces, the points of integration, the number of VTK. Of a cube the
# points are those of Gauss a direction; of a triangle or a tetrahedron all, see `_SIMPLEX_POINTS`.
_KINDS = {
    "line2": (_LINE[:2], "", 2, 3),
    "line3": (_LINE, "", 3, 21),
    "quad4": (_QUAD[:4], "line2", 2, 9),
    "quad8": (_QUAD, "line3", 3, 23),
    "tri6": (_TRI, "", 6, 22),
    "hex8": (_HEX[:8], "quad4", 2, 12),
    "hex20": (_HEX, "quad8", 3, 25),
    "tet10": (_TET, "tri6", 4, 24),
}
SOLIDS = ("quad4", "quad8", "hex8", "hex20", "tet10")
# Of orbits of points with one barycentric coordinate 1 - d a and d times a: a, and the weight of each over
# the volume. Exact to degree 4 of a triangle, 2 of a tetrahedron (Zienkiewicz and Taylor, The Finite Element
# Method, vol. 1).
_SIMPLEX_POINTS = {
    6: ((0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322)),
    4: ((0.25 - 0.05 * 5.0**0.5, 0.25),),
}
# Corners of the faces of a tetrahedron, turned outwards.
_TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))


@dataclass(frozen=True, eq=False)
class Element:
    """One kind of element.

    Attributes
    ----------
    kind : str
        quad4, quad8, hex8, hex20 or tet10; of faces also line2, line3 and tri6.
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

    Of a cube linear where all nodes are corners, else of the serendipity family; of a simplex quadratic.
    """
    d = nodes.shape[1]
    if nodes.min() >= 0.0:
        return _simplex_shapes(nodes, xi)
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


def _simplex_shapes(nodes: Array, xi: Array) -> tuple[Array, Array]:
    """Quadratic: L (2 L - 1) of a corner, 4 L_i L_j of a middle, with barycentric coordinates L."""
    d = nodes.shape[1]
    share, of_node = (np.insert(at, 0, 1.0 - at.sum(axis=1), axis=1) for at in (xi, nodes))
    share_slope = np.concatenate([-np.ones((1, d)), np.eye(d)])
    # A corner has one coordinate, twice; a middle has two.
    i, j = np.argmax(of_node > 0.0, axis=1), d - np.argmax(of_node[:, ::-1] > 0.0, axis=1)
    is_corner = i == j
    Li, Lj = share[:, i], share[:, j]
    value = np.where(is_corner, Li * (2.0 * Li - 1.0), 4.0 * Li * Lj)
    by_i = np.where(is_corner, 4.0 * Li - 1.0, 4.0 * Lj)
    by_j = np.where(is_corner, 0.0, 4.0 * Li)
    return value, by_i[..., None] * share_slope[i] + by_j[..., None] * share_slope[j]


@cache
def element(kind: str) -> Element:
    """Return an element by its kind."""
    places, face, points, vtk = _KINDS[kind]
    nodes = np.array(places, dtype=float)
    xi, weight = _simplex_points(points, nodes) if nodes.min() >= 0.0 else _gauss(points, nodes.shape[1])
    shape, slope = shapes(nodes, xi)
    return Element(kind, nodes, shape, slope, weight, _faces(nodes, face), face, vtk)


def _gauss(points: int, d: int) -> tuple[Array, Array]:
    at, by = np.polynomial.legendre.leggauss(points)
    return np.array(list(product(at, repeat=d))), np.array(list(product(by, repeat=d))).prod(axis=1)


def _simplex_points(points: int, nodes: Array) -> tuple[Array, Array]:
    d = nodes.shape[1]
    corners, volume = nodes[: d + 1], 1.0 / math.factorial(d)
    xi = [(1.0 - (d + 1) * a) * corners + a * corners.sum(axis=0) for a, _ in _SIMPLEX_POINTS[points]]
    return np.concatenate(xi), volume * np.repeat([w for _, w in _SIMPLEX_POINTS[points]], d + 1)


@cache
def mean_products(kind: str) -> Array:
    """Return the means of N_a N_b over a tetrahedron with straight edges (n, n).

    Its points of integration are fewer than its nodes, so that a mass by them is singular.
    """
    nodes = element(kind).nodes
    # A cube collapsed to a tetrahedron, by Duffy: exact to degree 4 with 4 points a direction.
    at, weight = _gauss(4, 3)
    u, v, w = 0.5 * (at.T + 1.0)
    xi = np.stack([u, v * (1.0 - u), w * (1.0 - u) * (1.0 - v)], axis=1)
    shape = shapes(nodes, xi)[0]
    share = weight * (1.0 - u) ** 2 * (1.0 - v)
    return np.asarray(np.einsum("g,ga,gb->ab", share / share.sum(), shape, shape))


def _faces(nodes: Array, face: str) -> np.ndarray:
    """Nodes of the faces, of a cube xi_k = -1 and 1 of each direction, turned outwards."""
    if not face:
        return np.empty((0, 0), dtype=np.int64)
    d = nodes.shape[1]
    places = np.array(_KINDS[face][0], dtype=float)
    found = []
    if nodes.min() >= 0.0:
        share = np.insert(places, 0, 1.0 - places.sum(axis=1), axis=1)
        for corners in _TET_FACES:
            at = share @ nodes[list(corners)]
            found.append([int(np.flatnonzero((nodes == place).all(axis=1))[0]) for place in at])
        return np.array(found, dtype=np.int64)
    for k, side in product(range(d), (-1.0, 1.0)):
        along = [(k + 1) % d] if d == 2 else [(k + 1) % 3, (k + 2) % 3]
        # A quarter turn from x to y, then outwards is to the right of an edge; of a face, as of a screw.
        sign = side * (1.0 if d == 3 or k == 0 else -1.0)
        on_face = np.full((len(places), d), side)
        on_face[:, along] = places
        on_face[:, along[0]] *= sign
        found.append([int(np.flatnonzero((nodes == place).all(axis=1))[0]) for place in on_face])
    return np.array(found, dtype=np.int64)
