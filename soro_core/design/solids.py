"""From the section of a part to the surface of its solid: mirrored, extruded or revolved, written as STL."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from soro_core.errors import ModelError
from soro_core.fem import Mesh, make_mesh
from soro_core.fem.response import Array

# One triangle of a binary STL: normal, corners, and two bytes that nothing reads.
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
_HEAD = 80


def mirrored(mesh: Mesh, axes: tuple[str, ...]) -> Mesh:
    """Return a section (quad4) with its mirror images behind x = 0 and y = 0, as `axes` says."""
    points, cells = mesh.points, mesh.cells
    for axis in axes:
        k = "xy".index(axis)
        is_shared = points[:, k] == 0.0
        number = np.where(is_shared, np.arange(len(points)), len(points) + np.cumsum(~is_shared) - 1)
        image = points[~is_shared] * np.where(np.arange(2) == k, -1.0, 1.0)
        points = np.concatenate([points, image])
        cells = np.concatenate([cells, number[cells][:, ::-1]])
    return make_mesh("quad4", "plane_strain", points, cells)


def extruded(mesh: Mesh, height_m: float) -> Array:
    """Return the triangles (t, 3, 3) [m] of a section extruded along z, turned outwards."""
    if not 0.0 < height_m < np.inf:
        raise ModelError(f"height {height_m} m; allowed: above 0", "height_m")
    top = np.column_stack([mesh.points, np.full(len(mesh.points), height_m)])
    bottom = top * [1.0, 1.0, 0.0]
    halves = mesh.cells[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    a, b = mesh.boundary().T
    sides = _two(bottom[a], bottom[b], top[b], top[a])
    return np.concatenate([top[halves], bottom[halves[:, ::-1]], sides])


def revolved(mesh: Mesh, pieces: int = 96) -> Array:
    """Return the triangles (t, 3, 3) [m] of a section turned about x = 0 in flat pieces."""
    if pieces < 3:
        raise ModelError(f"pieces {pieces}; allowed: from 3", "pieces")
    if mesh.points[:, 0].min() < 0.0:
        raise ModelError("a section on both sides of x = 0; allowed: x >= 0", "mesh")
    angle = 2.0 * np.pi * np.arange(pieces) / pieces
    turn = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring = np.stack(
        [
            np.outer(turn[:, 0], mesh.points[:, 0]),
            np.broadcast_to(mesh.points[:, 1], (pieces, len(mesh.points))),
            np.outer(turn[:, 1], mesh.points[:, 0]),
        ],
        axis=2,
    )
    a, b = mesh.boundary().T
    following = np.roll(ring, -1, axis=0)
    found = _two(ring[:, a], ring[:, b], following[:, b], following[:, a]).reshape(-1, 3, 3)
    # What lies on the axis is no surface.
    is_flat = (found == np.roll(found, 1, axis=1)).all(axis=2).any(axis=1)
    return np.asarray(found[~is_flat])


def revolved_volume(mesh: Mesh, pieces: int) -> float:
    """Return the volume [m3] of a section revolved in flat pieces: n sin(2 pi / n) int x dA."""
    a, b = (mesh.points[side] for side in mesh.boundary().T)
    # Green: int x dA = 1/2 the integral of x^2 along the border, to y.
    moment = float(((a[:, 0] ** 2 + a[:, 0] * b[:, 0] + b[:, 0] ** 2) * (b - a)[:, 1]).sum()) / 6.0
    return pieces * float(np.sin(2.0 * np.pi / pieces)) * moment


def area(mesh: Mesh) -> float:
    """Return the area of a section [m2]."""
    a, b = (mesh.points[side] for side in mesh.boundary().T)
    return 0.5 * float((a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]).sum())


def enclosed(triangles: Array) -> float:
    """Return the volume [m3] that triangles (t, 3, 3) enclose."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return float(np.einsum("ti,ti->", a, np.cross(b, c))) / 6.0


def open_edges(triangles: Array) -> int:
    """Return how many edges of triangles (t, 3, 3) lack one that runs the other way: 0 where watertight."""
    _, number = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    corners = number.reshape(-1, 3)
    edges = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)])
    low, high = edges.min(axis=1), edges.max(axis=1)
    _, which = np.unique(np.stack([low, high], axis=1), axis=0, return_inverse=True)
    return int(np.abs(np.bincount(which.ravel(), np.where(edges[:, 0] == low, 1.0, -1.0))).sum())


def write_stl(path: Path, triangles: Array) -> None:
    """Write triangles (t, 3, 3) [m] as a binary STL in millimetres."""
    rows = np.zeros(len(triangles), dtype=_TRIANGLE)
    rows["corners"] = 1e3 * triangles
    a, b, c = np.moveaxis(rows["corners"].astype(float), 1, 0)
    normal = np.cross(b - a, c - a)
    rows["normal"] = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    head = b"soro design, millimetres".ljust(_HEAD)
    path.write_bytes(head + np.uint32(len(rows)).tobytes() + rows.tobytes())


def read_stl(path: Path) -> Array:
    """Return the triangles (t, 3, 3) [m] of a binary STL in millimetres."""
    content = path.read_bytes()
    count = int(np.frombuffer(content[_HEAD : _HEAD + 4], dtype="<u4")[0])
    rows = np.frombuffer(content[_HEAD + 4 :], dtype=_TRIANGLE, count=count)
    return 1e-3 * rows["corners"].astype(float)


def _two(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Two triangles of each of the quadrilaterals a b c d, counter-clockwise."""
    return np.concatenate([np.stack([a, b, c], axis=-2), np.stack([a, c, d], axis=-2)])
