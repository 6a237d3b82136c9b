"""Convex polyhedra: the hull of corners, with what its contacts and its motion need."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from soro_core.arrays import Array, Integers
from soro_core.errors import short

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

MOST_CORNERS = 60
"""Corners of a hull: each is looked at in each step."""
# A corner this near to the hull of the others is none, in parts of the size; so faces with this angle [rad].
_FLAT = 1e-6
# Largest volume that a mesh may lack of its hull, as a part of the hull.
_CONVEX = 1e-3


@dataclass(frozen=True)
class Polyhedron:
    """A solid convex polyhedron about its centre of mass.

    Attributes
    ----------
    corners : ndarray (n_c, 3)
        [m]
    planes : ndarray (n_f, 4)
        Of each face its normal, outwards, and its distance from the centre [m].
    edges : ndarray of int (n_e, 2)
        Corners at the ends of each edge.
    triangles : ndarray of int (n_t, 4)
        Corners of triangles of the surface, counter-clockwise from outside, and the plane of each.
    volume : float
        [m^3]
    centre : ndarray (3,)
        Centre of mass, from where the given corners count [m].
    inertia_per_mass : ndarray (3, 3)
        About the centre of mass [m^2].
    principal : ndarray (3,)
        Principal moments per mass [m^2].
    axes : ndarray (3, 3)
        Principal axes, as columns.
    """

    corners: Array
    planes: Array
    edges: Integers
    triangles: Integers
    volume: float
    centre: Array
    inertia_per_mass: Array
    principal: Array
    axes: Array


@lru_cache(maxsize=1024)
def polyhedron(corners: tuple[float, ...]) -> Polyhedron:
    """Return the hull of corners.

    Parameters
    ----------
    corners : tuple of float, (3 n_c,)
        Coordinates of one after the other [m].

    Raises
    ------
    ValueError
        If they span no volume, or one of them is no corner of the hull.
    """
    points = np.reshape(np.array(corners, dtype=np.float64), (-1, 3))
    if len(points) > MOST_CORNERS:
        raise ValueError(f"at most {MOST_CORNERS} corners, not {len(points)}")
    middle = points.mean(axis=0) if len(points) else np.zeros(3)
    points = points - middle  # so that no digits are lost far from the origin
    hull = _hull(points)
    if inner := sorted(set(range(len(points))) - set(hull.vertices.tolist())):
        which = f"number {inner[0]}, {short((points[inner[0]] + middle).tolist())}, counted from 0"
        raise ValueError(f"corners of one convex hull, each once; {which}, is none of the hull of the others")
    triangles = _outwards(hull)
    volume, centre, second = _moments(points[triangles])
    faces, planes = _planes(hull)
    planes[:, 3] -= planes[:, :3] @ centre
    pairs = [
        sorted(set(hull.simplices[t]) & set(hull.simplices[u]))
        for t, beside in enumerate(hull.neighbors)
        for u in beside
        if t < u and faces[t] != faces[u]
    ]
    inertia = np.trace(second) * np.eye(3) - second
    moments, axes = _principal(inertia)
    return Polyhedron(
        corners=points - centre,
        planes=planes,
        edges=np.array(pairs, dtype=np.int64),
        triangles=np.column_stack((triangles, faces)).astype(np.int64),
        volume=volume,
        centre=middle + centre,
        inertia_per_mass=inertia,
        principal=moments,
        axes=axes,
    )


def corners_of_mesh(points: Array, triangles: Integers) -> Array:
    """Return the corners (n_c, 3) of the hull of a closed mesh.

    Parameters
    ----------
    points, triangles : ndarray (n, 3), ndarray of int (t, 3)
        Turned all outwards or all inwards.

    Raises
    ------
    ValueError
        If the mesh is not convex, or has too many corners.
    """
    middle = points.mean(axis=0)
    hull = _hull(points - middle)
    part = abs(_volume((points - middle)[triangles])) / hull.volume
    if not abs(part - 1.0) <= _CONVEX:
        raise ValueError(f"a closed convex mesh; this one fills {100.0 * part:.1f} % of its hull")
    kept = len(points) + 1
    while len(hull.vertices) < kept:  # of nearly flat corners a smaller number may make others flat
        kept, points = len(hull.vertices), points[np.sort(hull.vertices)]
        hull = _hull(points - points.mean(axis=0))
    if len(points) > MOST_CORNERS:
        raise ValueError(f"a mesh of at most {MOST_CORNERS} corners, not {len(points)}: simplify it")
    return np.asarray(points)


def _hull(points: Array) -> ConvexHull:
    """Hull of points about their middle."""
    from scipy.spatial import ConvexHull, QhullError  # of meshes alone: a tenth of a second

    size, hull = np.abs(points).max() if len(points) else 0.0, None
    if len(points) > 3 and np.linalg.svd(points, compute_uv=False)[-1] > _FLAT * size:
        # The facets that are flat within a part of the size are one: what lies in them is no corner.
        with suppress(QhullError):
            hull = ConvexHull(points, qhull_options=f"Qt C{_FLAT * size}")
    if hull is None:
        raise ValueError(f"four or more corners that span a volume, not {len(points)} within a plane")
    return hull


def _outwards(hull: ConvexHull) -> Integers:
    """Triangles of a hull, counter-clockwise from outside."""
    found: Integers = hull.simplices.astype(np.int64)
    a, b, c = (hull.points[found[:, k]] for k in range(3))
    turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    found[turned] = found[turned][:, [0, 2, 1]]
    return found


def _planes(hull: ConvexHull) -> tuple[Integers, Array]:
    """Plane of each triangle, and planes (n_f, 4): normal, and distance from the origin."""
    faces = np.full(len(hull.equations), -1)
    planes: list[list[float]] = []
    for t, (*normal, offset) in enumerate(hull.equations):
        if faces[t] < 0:
            alike = np.linalg.norm(hull.equations[:, :3] - normal, axis=1) < _FLAT
            faces[alike & (faces < 0)] = len(planes)
            planes.append([*normal, -offset])
    return faces, np.array(planes)


def _volume(triangles: Array) -> float:
    """Volume of what triangles (t, 3, 3) enclose, negative where they are turned inwards."""
    return float(np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2]))) / 6.0


def _moments(triangles: Array) -> tuple[float, Array, Array]:
    """Volume, centre (3,), and mean (3, 3) of x x' about the centre, of what triangles (t, 3, 3) enclose."""
    six = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2]))
    volume = _volume(triangles)
    total = triangles.sum(axis=1)
    centre = (six @ total) / (24.0 * volume)
    # Of a tetrahedron with a corner at the origin: 6 V / 120 (sum of x x' + total total').
    own = np.einsum("t,tki,tkj->ij", six, triangles, triangles) + np.einsum("t,ti,tj->ij", six, total, total)
    return volume, centre, own / (120.0 * volume) - np.outer(centre, centre)


def _principal(inertia: Array) -> tuple[Array, Array]:
    """Principal moments (3,), and axes as columns (3, 3): the given ones where they are principal."""
    own = np.diag(inertia)
    if np.abs(inertia - np.diag(own)).max() <= 1e-9 * own.max():
        return own, np.eye(3)
    moments, axes = np.linalg.eigh(inertia)
    return moments, axes * np.sign(np.linalg.det(axes))
