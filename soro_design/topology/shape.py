"""The part that a design means: the mesh of its solid, cut along the contour of the densities.

Nodes near the contour move onto it, so that no cut is close to a corner. The rest of each cell of a section
is a polygon of three to six corners; lines from its centre to the middles of its edges divide it into as many
quad4, which fit those of the next cell. Of a solid see `soro_design.topology.physics.tetrahedra`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from soro_core.arrays import Array, Flags, Integers
from soro_core.errors import ModelError
from soro_design.fem import Mesh, make_mesh
from soro_design.fem.meshes.mesh_files import refined
from soro_design.topology.domain import Domain
from soro_design.topology.physics.filter import projection
from soro_design.topology.physics.grid import Grid
from soro_design.topology.physics.tetrahedra import cut_tetrahedra, edges_of, tetrahedra, turned

# A node whose edge is cut nearer than this share of the edge moves onto the contour.
SNAP = 0.25
# Places along each edge of an element at which its level is read for the volume.
PIECES = 6
_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0))
# Corners of the faces of an element.
_SIDES = {
    "plane_strain": _EDGES,
    "axisymmetric": _EDGES,
    "solid": ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
}


@dataclass(frozen=True, eq=False)
class Contour:
    """A field on the nodes of a grid whose zero is the border of the solid.

    Attributes
    ----------
    points : ndarray, (n, d)
        Nodes, some of them moved onto the contour [m].
    level : ndarray, (n,)
        Positive in the solid, negative in the void, 0 on the contour.
    """

    points: Array
    level: Array


def contour(domain: Domain, filtered: Array) -> Contour:
    """Return the contour of the filtered densities (e,), whose solid has the volume of the projected ones."""
    return snapped(domain.grid, contour_level(domain, filtered))


def contour_level(domain: Domain, filtered: Array) -> Array:
    """Return `mean_level` (n,), shifted: above 0 is the volume of the densities that the schedule ends with.

    Means fill the inner edges of walls and cut the outer ones, of which walls have fewer.
    """
    grid, schedule = domain.grid, domain.task.schedule
    density = projection(filtered, schedule.at(schedule.iterations - 1)[2], schedule.threshold)[0]
    volume = grid.volumes @ np.where(domain.is_solid, 1.0, np.where(domain.is_void, 0.0, density))
    level = mean_level(domain, filtered)
    if volume >= grid.volumes.sum() * (1.0 - 1e-12):  # solid everywhere: no level leaves anything out
        return level
    # Linear in each direction within an element.
    share = (np.arange(PIECES) + 0.5) / PIECES
    places = np.stack(np.meshgrid(*[share] * len(grid.counts)), axis=-1).reshape(-1, 1, len(grid.counts))
    is_upper = grid.mesh.points[grid.mesh.cells[0]] > grid.centres[0]
    inside = level[grid.mesh.cells] @ np.where(is_upper, places, 1.0 - places).prod(axis=-1).T
    falling = np.argsort(-inside, axis=None)
    pieces = grid.volumes[falling // len(places)] / len(places)
    above = np.cumsum(pieces) - 0.5 * pieces
    # One grey everywhere is void: no wall of it holds air.
    return np.asarray(level - np.interp(volume, above, inside.ravel()[falling]) - 1e-9)


def mean_level(domain: Domain, filtered: Array) -> Array:
    """Return the mean density of the elements about each node (n,), less the threshold of the projection.

    About a given element they count as solid or void: else given solid swells where grey is beside it.
    """
    grid, threshold = domain.grid, domain.task.schedule.threshold
    density = np.where(domain.is_solid, 1.0, np.where(domain.is_void, 0.0, filtered))
    total, whole, given, count = (
        grid.gathered(np.repeat(one, grid.mesh.cells.shape[1]))
        for one in (density, density >= threshold, domain.is_given, np.ones_like(density))
    )
    return np.asarray(np.where(given > 0, whole, total) / count - threshold)


def snapped(grid: Grid, level: Array) -> Contour:
    """Return the contour of a level (n,), with the nodes near it moved onto it."""
    points, level = grid.mesh.points.copy(), level.copy()
    level[np.abs(level) < 1e-12] = 0.0
    size = points.max(axis=0)
    # Nodes of a border stay on it, those of corners where they are.
    is_fixed = (grid.mesh.points == 0.0) | (grid.mesh.points == size)
    edges = grid_edges(grid)
    a, b = edges[level[edges[:, 0]] * level[edges[:, 1]] < 0.0].T
    share = level[a] / (level[a] - level[b])
    node, other = np.concatenate([a, b]), np.concatenate([b, a])
    share = np.concatenate([share, 1.0 - share])
    along = grid.mesh.points[other] - grid.mesh.points[node]
    is_near = (share < SNAP) & ~(is_fixed[node] & (along != 0.0)).any(axis=1)
    for k in np.argsort(-share[is_near], kind="stable"):
        n = node[is_near][k]
        points[n] = grid.mesh.points[n] + share[is_near][k] * along[is_near][k]
        level[n] = 0.0
    return Contour(points, level)


def grid_edges(grid: Grid) -> Integers:
    """Return the edges (m, 2) of a grid by their nodes, of one in space those of its tetrahedra."""
    if len(grid.counts) == 3:
        return edges_of(tetrahedra(grid))
    number = np.arange(len(grid.mesh.points)).reshape(grid.counts[0] + 1, grid.counts[1] + 1)
    pairs = ((number[:-1], number[1:]), (number[:, :-1], number[:, 1:]))
    return np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])


def is_bridged(level: Array, cells: Integers) -> Flags:
    """Return which cells (e,) with two solid corners across from each other join them by solid."""
    signs = np.sign(level[cells])
    is_saddle = (signs[:, 0] == signs[:, 2]) & (signs[:, 1] == signs[:, 3]) & (signs[:, 0] * signs[:, 1] < 0)
    return np.asarray(is_saddle & (level[cells].mean(axis=1) > 0.0))


def solid_mesh(domain: Domain, cut: Contour) -> Mesh:
    """Return the mesh of the solid that is connected with the output, or with what is held without one.

    Raises
    ------
    ModelError
        If there is none.
    """
    grid = domain.grid
    if domain.task.space == "solid":
        corners, tets = cut_tetrahedra(tetrahedra(grid), cut.points, cut.level)
        return _wanted(domain, corners, turned(corners, tets))
    return _wanted(domain, *cut_quads(grid, cut)[:2])


def cut_quads(grid: Grid, cut: Contour, is_filled: Flags | None = None) -> tuple[Array, Integers, Flags]:
    """Return points (n, 2) and quad4 (q, 4) of the solid of a section, and which quad4 are filled void (q,).

    Parameters
    ----------
    grid : Grid
        The grid.
    cut : Contour
        Border of the solid.
    is_filled : ndarray of bool, (n,), optional
        Nodes of void that is divided into quad4 too, which fit those of the solid; default: none.
    """
    points: list[Array] = []
    numbers: dict[tuple[int, ...], int] = {}

    def number(key: tuple[int, ...], place: Array) -> int:
        if key not in numbers:
            numbers[key] = len(points)
            points.append(place)
        return numbers[key]

    quads: list[list[int]] = []
    is_void: list[bool] = []
    cells, bridged = grid.mesh.cells, is_bridged(cut.level, grid.mesh.cells)
    sides = [(cut, cut.level > 0.0, bridged)]
    if is_filled is not None:
        void = Contour(cut.points, -cut.level)
        sides.append((void, is_filled, ~bridged))
    for side, (of, is_wanted, is_joined) in enumerate(sides):
        for e in np.flatnonzero(is_wanted[cells].any(axis=1)):
            for part, polygon in enumerate(_polygons(of, cells[e], bool(is_joined[e]))):
                if not any(is_wanted[a] for a, b in polygon if a == b):
                    continue
                places = [_place(of, key) for key in polygon]
                n = len(polygon)
                centre = number((-1, int(e), part, side, 0), np.mean(places, axis=0))
                corner = [number(key, place) for key, place in zip(polygon, places, strict=True)]
                middle = []
                for k in range(n):
                    low, high = sorted((polygon[k], polygon[(k + 1) % n]))
                    middle.append(number((*low, *high), 0.5 * (places[k] + places[(k + 1) % n])))
                quads += [[corner[k], middle[k], centre, middle[k - 1]] for k in range(n)]
                is_void += [bool(side)] * n
    return np.array(points), np.array(quads, dtype=np.int64).reshape(-1, 4), np.array(is_void, dtype=bool)


def _polygons(cut: Contour, cell: Integers, is_bridged: bool) -> list[list[tuple[int, ...]]]:
    """Corners of the solid of a cell: nodes (a, a) and cuts (a, b) of edges, counter-clockwise."""
    level = cut.level[cell]
    found: list[tuple[int, ...]] = []
    for k in range(4):
        here, following, before = level[k], level[(k + 1) % 4], level[k - 1]
        a, b = int(cell[k]), int(cell[(k + 1) % 4])
        # A corner on the contour between void ones only touches the cell.
        if here > 0.0 or (here == 0.0 and (following >= 0.0 or before >= 0.0)):
            found.append((a, a))
        if here * following < 0.0:
            found.append((min(a, b), max(a, b)))
    if len(found) == 6 and not is_bridged:
        k = next(i for i, (a, b) in enumerate(found) if a == b)
        turned = found[k - 1 :] + found[: k - 1]
        return [turned[:3], turned[3:]]
    return [found] if len(found) > 2 else []


def _place(cut: Contour, key: tuple[int, ...]) -> Array:
    a, b = key
    if a == b:
        return np.asarray(cut.points[a])
    share = cut.level[a] / (cut.level[a] - cut.level[b])
    return np.asarray(cut.points[a] + share * (cut.points[b] - cut.points[a]))


def joined_with_output(domain: Domain, points: Array, cells: Integers) -> Flags:
    """Return which quad4 or tetrahedra share faces with those at the output, or at what is held without one.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    points : ndarray, (n, d)
        Corners [m].
    cells : ndarray of int, (c, 4)
        Quad4 or tetrahedra.

    Raises
    ------
    ModelError
        If there is none.
    """
    if len(cells) == 0:
        raise ModelError("the design holds no solid", "density")
    corners = np.array(_SIDES[domain.task.space])
    faces = np.sort(cells[:, corners].reshape(-1, corners.shape[1]), axis=1)
    _, of_face = np.unique(faces, axis=0, return_inverse=True)
    owner = np.repeat(np.arange(len(cells)), 4)
    to_faces = coo_matrix((np.ones(len(owner)), (owner, of_face.ravel()))).tocsr()
    _, label = connected_components(to_faces @ to_faces.T, directed=False)
    marks = domain.output.any(axis=1) if domain.output.any() else domain.is_held.any(axis=1)
    gap = cKDTree(domain.grid.mesh.points[marks]).query(points, p=np.inf)[0]
    is_there = (gap < 0.5 * min(domain.grid.edge_m))[cells].any(axis=1)
    if not is_there.any():
        raise ModelError("the design holds no solid at the output", "goal.output")
    return np.asarray(np.isin(label, np.unique(label[is_there])))


def _wanted(domain: Domain, points: Array, cells: Integers) -> Mesh:
    used, numbers = np.unique(cells[joined_with_output(domain, points, cells)], return_inverse=True)
    kept, found = numbers.reshape(-1, 4), points[used]
    if domain.task.space == "solid":
        return make_mesh("tet10", "solid", *refined(found, kept)[:2])
    return make_mesh("quad4", domain.task.space, found, kept)
