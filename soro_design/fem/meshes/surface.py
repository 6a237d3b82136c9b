"""Surfaces of parts as triangles that close: of a solid, of an extruded or of a revolved section."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError
from soro_design.fem.elements.mesh import Mesh

# Straight pieces of a face, by its number of nodes.
_LINES = {2: ((0, 1),), 3: ((0, 2), (2, 1))}
_TRIANGLES = {
    6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    4: ((0, 1, 2), (0, 2, 3)),
    8: ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 6), (4, 6, 7)),
}


def pieces(faces: Integers) -> Integers:
    """Return straight pieces (p, d) of faces (f, m): lines of a section, triangles of a solid."""
    cut = np.array((_LINES | _TRIANGLES)[faces.shape[1]])
    return np.asarray(faces[:, cut].reshape(-1, cut.shape[1]))


def edges_of(faces: Integers, d: int) -> Integers:
    """Return the places around each face (f, c, k): c ends of one node of a section, or c edges of a solid.

    Parameters
    ----------
    faces : ndarray of int, (f, m)
        Faces of a boundary.
    d : int
        2 for a section, 3 for a solid.
    """
    if d == 2:
        return faces[:, :2, None]
    corners = 3 if faces.shape[1] == 6 else 4
    edges = np.stack([faces[:, :corners], np.roll(faces[:, :corners], -1, axis=1)], axis=2)
    # The node in the middle of an edge, if there is one, has the number of its first corner, plus `corners`.
    return np.concatenate([edges, faces[:, corners:, None]], axis=2) if faces.shape[1] > corners else edges


def solid_surface(mesh: Mesh, u: Array | float = 0.0) -> tuple[Array, Integers]:
    """Return corners (n, 3) [m] and triangles (t, 3), turned outwards, of a solid displaced by u (n, 3) [m].

    Raises
    ------
    ModelError
        If it is a section.
    """
    _check(mesh, ("solid",))
    return _used(mesh.points + u, pieces(mesh.boundary()))


def extruded(mesh: Mesh, depth_m: float, u: Array | float = 0.0) -> tuple[Array, Integers]:
    """Return the corners (n, 3) [m] and triangles (t, 3) of a section in plane strain, as deep as asked.

    Parameters
    ----------
    mesh : Mesh
        In plane strain.
    depth_m : float
        Along z.
    u : ndarray, (n, 2)
        Displacements [m].

    Raises
    ------
    ModelError
        If it is no such section, or the depth is not above 0.
    """
    _check(mesh, ("plane_strain",))
    if not 0.0 < depth_m < np.inf:
        raise ModelError(f"depth_m {depth_m}; allowed: a number above 0", "depth_m")
    flat, n = mesh.points + u, len(mesh.points)
    points = np.concatenate([np.insert(flat, 2, z, axis=1) for z in (0.0, depth_m)])
    cap = np.array(_TRIANGLES[mesh.cells.shape[1]])
    top = mesh.cells[:, cap].reshape(-1, 3)
    a, b = pieces(mesh.boundary()).T
    # Outwards is to the right of a line, so up is on the left of one who stands outside.
    sides = [np.stack(each, axis=1) for each in ((a, b, b + n), (a, b + n, a + n))]
    return _used(points, np.concatenate([top[:, ::-1], top + n, *sides]))


def revolved(mesh: Mesh, around: int = 96, u: Array | float = 0.0) -> tuple[Array, Integers]:
    """Return the corners (n, 3) [m] and triangles (t, 3) of an axisymmetric section, revolved about z.

    The polygon of corners lies partly outside the circle, so that the volume is that of the ring.

    Parameters
    ----------
    mesh : Mesh
        Axisymmetric.
    around : int
        Corners of a circle, 3 or more.
    u : ndarray, (n, 2)
        Displacements [m].

    Raises
    ------
    ModelError
        If it is no such section, or there are too few corners.
    """
    _check(mesh, ("axisymmetric",))
    if around < 3:
        raise ModelError(f"around {around}; allowed: 3 or more", "around")
    flat, n = mesh.points + u, len(mesh.points)
    angle = 2.0 * np.pi * np.arange(around) / around
    radius = flat[:, 0] * np.sqrt(2.0 * np.pi / around / np.sin(2.0 * np.pi / around))
    points = np.stack(
        [np.outer(np.cos(angle), radius), np.outer(np.sin(angle), radius), np.tile(flat[:, 1], (around, 1))],
        axis=2,
    ).reshape(-1, 3)
    # A node on the axis is one corner.
    turn = np.where(mesh.points[:, 0] == 0.0, 0, n)
    lines = pieces(mesh.boundary())
    a, b = lines[(mesh.points[lines, 0] > 0.0).any(axis=1)].T
    triangles = []
    for k in range(around):
        now, later = k, (k + 1) % around
        a0, a1, b0, b1 = (one + turn[one] * at for one in (a, b) for at in (now, later))
        triangles += [np.stack(each, axis=1) for each in ((a0, a1, b1), (a0, b1, b0))]
    found = np.concatenate(triangles)
    is_flat = (found[:, 0] == found[:, 1]) | (found[:, 1] == found[:, 2]) | (found[:, 0] == found[:, 2])
    return _used(points, found[~is_flat])


def volume(points: Array, triangles: Integers) -> float:
    """Return the volume [m3] inside triangles (t, 3) turned outwards, by their corners (n, 3) [m]."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6.0)


def is_closed(triangles: Integers) -> bool:
    """Whether each edge of triangles (t, 3) has one neighbour that runs along it the other way."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there, count = np.unique(edges, axis=0, return_counts=True)
    back = np.unique(edges[:, ::-1], axis=0)
    return bool((count == 1).all() and np.array_equal(there, back))


def differs_in_sense(triangles: Integers) -> bool:
    """Whether two neighbours among triangles (t, 3), which need not close, run along an edge the same way."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there, count = np.unique(edges, axis=0, return_counts=True)
    twice, back = there[count > 1], {tuple(edge) for edge in there[:, ::-1].tolist()}
    return any(tuple(edge) not in back for edge in twice.tolist())


def _check(mesh: Mesh, spaces: tuple[str, ...]) -> None:
    if mesh.space not in spaces:
        raise ModelError(f"space {mesh.space!r} of the mesh; allowed: {', '.join(spaces)}", "space")


def _used(points: Array, triangles: Integers) -> tuple[Array, Integers]:
    used, numbers = np.unique(triangles, return_inverse=True)
    return points[used], numbers.reshape(triangles.shape)
