"""Closed surfaces inside a mesh, which are the walls of its cavities: by number, by a point, by their STL."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError
from soro_design.fem.elements.mesh import Mesh
from soro_design.fem.meshes.surface import differs_in_sense, edges_of, pieces

# Of a face, over the square root of its area: how far into the air the point is that has to lie in an STL.
_INTO_AIR = 0.1
# Faces times triangles that are looked at together.
_TOGETHER = 300_000


@dataclass(frozen=True, eq=False)
class InnerSurface:
    """A closed surface inside a mesh; about an axis one that the axis may close.

    Attributes
    ----------
    faces : ndarray of int, (f, m)
        Its faces, as `Mesh.boundary` turns them: from the material into the air.
    volume : float
        Of the air inside [m3], in plane strain its area [m2].
    """

    faces: Integers
    volume: float


def inner_surfaces(mesh: Mesh) -> list[InnerSurface]:
    """Return the closed surfaces inside a mesh, the one around most air first."""
    faces = mesh.boundary()
    if mesh.space == "axisymmetric":
        faces = faces[(mesh.points[faces, 0] > 0.0).any(axis=1)]  # the axis is no surface
    found = []
    for own in _joined(faces, mesh.points.shape[1]):
        volume = -_enclosed(mesh, own)
        if volume > 0.0:  # a boundary closes, but where it meets the axis
            found.append(InnerSurface(own, volume))
    return sorted(found, key=lambda one: -one.volume)


def surface_around(mesh: Mesh, found: Sequence[InnerSurface], point: ArrayLike) -> Integers:
    """Return the faces (f, m) of the least closed surface that has a point in its air.

    Parameters
    ----------
    mesh : Mesh
    found : sequence of InnerSurface
        Of `inner_surfaces`.
    point : array_like, (d,)
        Place [m].

    Raises
    ------
    ModelError
        If there is none.
    """
    place = np.asarray(point, dtype=float)[None]
    for one in reversed(found):
        if _is_around(_corners(mesh, one.faces), place)[0]:
            return one.faces
    raise ModelError(f"point {place[0]}; allowed: one in the air of {len(found)} inner surfaces", "point")


def surface_of(mesh: Mesh, found: Sequence[InnerSurface], points: Array, triangles: Integers) -> Integers:
    """Return the faces (f, m) of a solid beside the air that an STL encloses.

    Closed surfaces inside the mesh of which more than half the area is there are taken, whole and alone.

    Parameters
    ----------
    mesh : Mesh
        Of a solid.
    found : sequence of InnerSurface
        Of `inner_surfaces`.
    points, triangles : ndarray, (n, 3) [m] and (t, 3)
        Corners and triangles of the STL.

    Raises
    ------
    ModelError
        If there is none, or the triangles differ in sense.
    """
    if differs_in_sense(triangles):
        raise ModelError("stl with triangles that differ in sense; allowed: all outwards, or inwards", "stl")
    faces, inside = mesh.boundary(), points[triangles]
    corners = mesh.points[pieces(faces)].reshape(len(faces), -1, 3, 3)
    normal = 0.5 * np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    normal = normal.sum(axis=1)
    area = np.linalg.norm(normal, axis=1)
    air = corners.mean(axis=(1, 2)) + _INTO_AIR * normal / np.sqrt(area)[:, None]
    is_there = _is_around(inside, air)
    key = {tuple(face): k for k, face in enumerate(faces.tolist())}
    closed = np.zeros_like(is_there)
    for one in found:
        own = [key[tuple(face)] for face in one.faces.tolist()]
        closed[own] = area[own] @ is_there[own] > 0.5 * area[own].sum()
        is_there[own] = False
    is_there = closed if closed.any() else is_there
    if not is_there.any():
        raise ModelError("stl beside no face of the mesh; allowed: that of a cavity, in its unit", "stl")
    return np.asarray(faces[is_there])


def _joined(faces: Integers, d: int) -> list[Integers]:
    """Faces in groups that hang together, by common edges or in a section by common nodes."""
    edges = np.sort(edges_of(faces, d)[:, :, :2], axis=2)
    count = edges.shape[1]
    _, number = np.unique(edges.reshape(len(faces) * count, -1), axis=0, return_inverse=True)
    face = np.repeat(np.arange(len(faces)), count)
    size = len(faces) + int(number.max()) + 1
    joined = coo_array((np.ones(len(face)), (face, len(faces) + number.ravel())), shape=(size, size))
    groups, label = connected_components(joined, directed=False)
    return [own for k in range(groups) if len(own := faces[label[: len(faces)] == k])]


def _corners(mesh: Mesh, faces: Integers) -> Array:
    """Corners (p, d, d) of straight pieces of faces; about an axis with their mirror images."""
    corners = mesh.points[pieces(faces)]
    if mesh.space != "axisymmetric":
        return np.asarray(corners)
    return np.concatenate([corners, corners[:, ::-1] * [-1.0, 1.0]])


def _enclosed(mesh: Mesh, faces: Integers) -> float:
    """Volume inside faces turned outwards; below 0 where they are turned inwards."""
    corners = mesh.points[pieces(faces)]
    share = np.linalg.det(corners) / (2.0 if corners.shape[1] == 2 else 6.0)
    if mesh.space == "axisymmetric":
        share = share * 2.0 * np.pi * corners[:, :, 0].sum(axis=1) / 3.0
    return float(share.sum())


def _is_around(corners: Array, points: Array) -> Array:
    """Whether closed pieces (p, d, d), turned either way, go around points (m, d): (m,) of bool."""
    found = np.zeros(len(points), dtype=bool)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    for some in np.array_split(near, len(near) * len(corners) // _TOGETHER + 1):
        to = corners[None] - points[some, None, None]
        if corners.shape[1] == 2:
            a, b = to[:, :, 0], to[:, :, 1]
            angle = np.arctan2(np.linalg.det(to), (a * b).sum(axis=2)) / (2.0 * np.pi)
        else:
            # Van Oosterom and Strackee, The solid angle of a plane triangle (1983).
            a, b, c = to[:, :, 0], to[:, :, 1], to[:, :, 2]
            la, lb, lc = (np.linalg.norm(one, axis=2) for one in (a, b, c))
            level = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
            angle = 2.0 * np.arctan2(np.linalg.det(to), level) / (4.0 * np.pi)
        found[some] = np.abs(angle.sum(axis=1)) > 0.5
    return found
