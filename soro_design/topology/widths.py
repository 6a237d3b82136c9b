"""How thin a finished part is, and how narrow its gaps: what a printer or a mould has to make."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from soro_core.arrays import Array
from soro_design.fem import Mesh
from soro_design.topology.domain import Domain, normals
from soro_design.topology.flood import on_border

# Walls and hinges below this tear, or are not printed [m].
PRINTABLE_M = 8e-4
# Two places of the surface face each other within this cosine: a round end counts with so much of its width.
FACING = 0.9
# Widths are looked for between points up to this share of the least length of the grid apart.
FARTHEST = 0.5


class Widths(NamedTuple):
    """Least widths of a part and where they are; inf where nothing faces anything.

    Attributes
    ----------
    solid_m, gap_m : float
        Of the solid, walls and hinges alike, and of the void between two faces of it [m].
    solid_at, gap_at : ndarray, (d,)
        Middles of them [m].
    """

    solid_m: float
    solid_at: Array
    gap_m: float
    gap_at: Array


def least_widths(domain: Domain, mesh: Mesh) -> Widths:
    """Return the least distances between places of the surface that face each other.

    Parameters
    ----------
    domain : Domain
        The task on its grid; its mirror images count, the planes between them do not.
    mesh : Mesh
        Of the solid.
    """
    points, outwards = _surface(domain, mesh)
    for axis in domain.task.mirrors:
        turn = np.where(np.arange(points.shape[1]) == "xyz".index(axis), -1.0, 1.0)
        points, outwards = (
            np.concatenate([points, points * turn]),
            np.concatenate([outwards, outwards * turn]),
        )
    # Outward normals point apart across solid, at each other across a gap.
    return Widths(*_least(domain, points, -outwards), *_least(domain, points, outwards))


def _least(domain: Domain, points: Array, across: Array) -> tuple[float, Array]:
    """The least width between points (n, d) whose directions (n, d) face each other, and its middle."""
    tree = cKDTree(points)
    reach, most = 1.5 * min(domain.grid.edge_m), FARTHEST * min(domain.task.size_m)
    while True:
        a, b = tree.query_pairs(reach, output_type="ndarray").T
        along = points[b] - points[a]
        length = np.linalg.norm(along, axis=1)
        # Images of one point in a plane of symmetry lie on each other.
        is_apart = length > 1e-9 * reach
        a, b, along, length = a[is_apart], b[is_apart], along[is_apart], length[is_apart]
        of_a, of_b = (along * across[a]).sum(axis=1), -(along * across[b]).sum(axis=1)
        width = np.where(np.minimum(of_a, of_b) > FACING * length, length, np.inf)
        if width.min(initial=np.inf) < np.inf:
            k = int(width.argmin())
            return float(width[k]), 0.5 * (points[a[k]] + points[b[k]])
        if reach >= most:
            return np.inf, np.full(points.shape[1], np.nan)
        reach = min(2.0 * reach, most)


def _surface(domain: Domain, mesh: Mesh) -> tuple[Array, Array]:
    """Nodes of the surface (m, d) [m] and their outward normals, from the faces about them by size."""
    faces = mesh.boundary()
    size = domain.grid.mesh.points.max(axis=0)
    is_low = on_border(mesh.points[faces], size)[0]
    shared = ["xyz".index(axis) for axis in domain.task.mirrors]
    faces = faces[~is_low[:, shared].any(axis=1)]
    total = np.zeros_like(mesh.points)
    np.add.at(total, faces, normals(mesh.points, faces)[:, None])
    nodes = np.unique(faces)
    return mesh.points[nodes], total[nodes] / np.linalg.norm(total[nodes], axis=1)[:, None]
