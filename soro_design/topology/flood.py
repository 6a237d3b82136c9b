"""What is wet in the final part: the void that the inlet reaches, and where it leaks into the open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from soro_core.arrays import Array, Flags, Integers
from soro_design.fem import Mesh
from soro_design.topology.domain import Domain, normals
from soro_design.topology.shape import Contour, grid_edges, is_bridged


@dataclass(frozen=True, eq=False)
class Flood:
    """Nodes of the grid in void, by what they are joined with.

    Attributes
    ----------
    is_wet : ndarray of bool, (n,)
        In void that reaches the inlet.
    is_leak : ndarray of bool, (n,)
        Wet, and in the open.
    is_closed : ndarray of bool, (n,)
        In void that reaches neither the inlet nor the open.
    is_full : ndarray of bool, (i,)
        Inlets that are full of solid.
    """

    is_wet: Flags
    is_leak: Flags
    is_closed: Flags
    is_full: Flags


def flood(domain: Domain, cut: Contour) -> Flood:
    """Return what is wet of a part with a contour."""
    cells, is_void = domain.grid.mesh.cells, cut.level < 0.0
    edges = [grid_edges(domain.grid)]
    # Air passes between two void corners across a cell, unless solid joins the other two. Tetrahedra leave
    # no such doubt.
    for a, b in ((0, 2), (1, 3)) if len(domain.grid.counts) == 2 else ():
        edges.append(cells[~is_bridged(cut.level, cells)][:, [a, b]])
    pairs = np.concatenate(edges)
    a, b = pairs[is_void[pairs].all(axis=1)].T
    n = len(is_void)
    _, label = connected_components(coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)

    def joined(with_: Flags) -> Flags:
        return np.asarray(is_void & np.isin(label, np.unique(label[is_void & with_])))

    wet, dry = joined(domain.is_inlet), joined(domain.is_open)
    is_full = np.asarray(~(domain.inlets & wet).any(axis=1))
    return Flood(wet, wet & domain.is_open, is_void & ~wet & ~dry, is_full)


def wet_faces(domain: Domain, cut: Contour, found: Flood, mesh: Mesh) -> tuple[Integers, Integers]:
    """Return the boundary faces of the solid that the air of the inlet presses on, and those in the open.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    cut : Contour
        Border of the solid.
    found : Flood
        What is wet.
    mesh : Mesh
        Of the solid.
    """
    grid = domain.grid
    faces = mesh.boundary()
    ends = mesh.points[faces]
    normal = normals(mesh.points, faces)
    outwards = normal / np.linalg.norm(normal, axis=1)[:, None]
    size = grid.mesh.points.max(axis=0)
    is_border = np.logical_or(*on_border(ends, size))
    void = np.flatnonzero(cut.level < 0.0)
    beside = ends.mean(axis=1) + 0.5 * min(grid.edge_m) * outwards
    nearest = void[cKDTree(grid.mesh.points[void]).query(beside)[1]]
    is_wet = ~is_border.any(axis=1) & found.is_wet[nearest]
    # On the border of the grid, what lies at nodes that are open.
    at = cKDTree(grid.mesh.points).query(ends.mean(axis=1))[1]
    is_outer = np.where(is_border.any(axis=1), domain.is_open[at], ~found.is_wet[nearest])
    return faces[is_wet], faces[is_outer & ~is_wet]


def on_border(ends: Array, size: Array) -> tuple[Flags, Flags]:
    """Return which faces with ends (f, m, d) lie in planes of the grid, at 0 and at its size: both (f, d)."""
    near = 1e-9 * size
    low, high = (np.asarray((np.abs(ends - at) < near).all(axis=1)) for at in (0.0, size))
    return low, high


def thinnest_wall(mesh: Mesh, wet: Integers, outer: Integers) -> tuple[float, Array]:
    """Return the least distance [m] from a wet to an open face, and where it is (d,) [m]; inf without any.

    Of a solid it is that between nodes, the middles of edges with them.

    Parameters
    ----------
    mesh : Mesh
        Of the solid.
    wet, outer : ndarray of int, (f, m)
        Its faces.
    """
    best, place = np.inf, np.full(mesh.points.shape[1], np.nan)
    if len(wet) == 0 or len(outer) == 0:
        return best, place
    if mesh.space == "solid":
        ends = mesh.points[np.unique(wet)]
        gap = cKDTree(mesh.points[np.unique(outer)]).query(ends)[0]
        return float(gap.min()), np.asarray(ends[int(gap.argmin())])
    # Of two segments that do not cross one end is nearest; ends against segments, both ways.
    for some, others in ((wet, outer), (outer, wet)):
        ends = mesh.points[np.unique(some)]
        a, b = mesh.points[others[:, 0]], mesh.points[others[:, 1]]
        _, near = cKDTree(0.5 * (a + b)).query(ends, k=min(8, len(others)))
        for candidate in np.reshape(near, (len(ends), -1)).T:
            p, d = a[candidate], (b - a)[candidate]
            share = np.clip(((ends - p) * d).sum(axis=1) / (d * d).sum(axis=1), 0.0, 1.0)
            gap = np.hypot(*(ends - p - share[:, None] * d).T)
            if gap.min() < best:
                best, place = float(gap.min()), ends[int(gap.argmin())]
    return best, place
