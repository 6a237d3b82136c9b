"""Tendons of a part file: the way of each through the mesh, and its tension."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Annotated, TypeAlias

import numpy as np
from pydantic import Field
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from soro_core.arrays import Array, Integers
from soro_core.config import Strict
from soro_core.errors import ModelError
from soro_design.fem.elements.fibres import fibres, pieces_of
from soro_design.fem.elements.mesh import Mesh
from soro_design.fem.loads import Loads


class PartTendon(Strict):
    """A tendon or a fibre along straight lines between points, in tension alone."""

    along_m: Annotated[
        tuple[Annotated[tuple[float, float, float], Field(strict=False)], ...],
        Field(strict=False, min_length=2, description="its ends, and where it turns"),
    ]
    stiffness_n: Annotated[
        float, Field(ge=0.0, description="EA [N] of one that is fixed along its way; 0: it slides")
    ] = 0.0


# Pieces (m, 2) of a tendon, and its stiffness [N].
Routed: TypeAlias = tuple[Integers, float]


def route(mesh: Mesh, along: Sequence[Sequence[float]]) -> Integers:
    """Return the pieces (m, 2) of the chain of nodes that stays nearest to the lines between points [m].

    Neighbours in the chain are nodes of one element. Each piece costs its length and the distances of its
    ends from the line; the chain is the cheapest.

    Raises
    ------
    ModelError
        If a point is farther from every node than the elements there are long, or two are at one node.
    """
    pairs = np.array(list(combinations(range(mesh.cells.shape[1]), 2)))
    joined = np.unique(np.sort(mesh.cells[:, pairs].reshape(-1, 2), axis=1), axis=0)
    length = np.linalg.norm(mesh.points[joined[:, 0]] - mesh.points[joined[:, 1]], axis=1)
    points = np.asarray(along, dtype=float)
    stops = [_nearest(mesh, point, joined, length) for point in points]
    chain = [stops[0]]
    for (start, end), (a, b) in zip(pairwise(stops), pairwise(points), strict=True):
        if start == end:
            place = ", ".join(f"{x:.4g}" for x in b)
            raise ModelError(f"({place}) m is at the node of the point before; allowed: another place", "")
        off = _distance(mesh.points, a, b)
        costs = length + off[joined].sum(axis=1)
        graph = coo_array((costs, joined.T), shape=(len(off), len(off))).tocsr()
        before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)[1]
        back = [end]
        while back[-1] != start:
            if before[back[-1]] < 0:
                raise ModelError("two points lie in pieces of the mesh that do not touch; allowed: one", "")
            back.append(int(before[back[-1]]))
        chain += back[-2::-1]
    return pieces_of([chain])


def tensioned(loads: Loads, tendons: Sequence[Routed], tensions_n: Sequence[float]) -> Loads:
    """Return the loads with tendons under their tensions; none stated is 0.

    Parameters
    ----------
    loads : Loads
        Of the part.
    tendons : sequence of Routed
        Of `route`, with stiffness.
    tensions_n : sequence of float
        One a tendon [N], or none.
    """
    for (pieces, stiffness), tension in zip(tendons, tensions_n or [0.0] * len(tendons), strict=True):
        if stiffness or tension:
            loads = loads.reinforce(fibres(pieces, stiffness, tension))
    return loads


def _nearest(mesh: Mesh, point: Array, joined: Integers, length: Array) -> int:
    away = np.linalg.norm(mesh.points - point, axis=1)
    node = int(away.argmin())
    if away[node] > length[(joined == node).any(axis=1)].max():
        place = ", ".join(f"{x:.4g}" for x in point)
        raise ModelError(f"({place}) m, {away[node]:.3g} m from the nearest node; allowed: in the part", "")
    return node


def _distance(points: Array, a: Array, b: Array) -> Array:
    """Distance (n,) of points from the line between a and b."""
    share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
