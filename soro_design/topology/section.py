"""A part with its mirror images: the mesh of a section, and the surface of the whole."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array, Integers
from soro_design.fem import Mesh, extruded, make_mesh, revolved
from soro_design.fem.elements.mesh import Space
from soro_design.fem.meshes.surface import solid_surface
from soro_design.topology.task import Task


def mirrored(mesh: Mesh, axes: tuple[str, ...], space: Space = "plane_strain") -> Mesh:
    """Return a section (quad4) with its mirror images.

    Parameters
    ----------
    mesh : Mesh
    axes : tuple of str
        "x" for an image behind x = 0, "y" for one behind y = 0.
    space : Space
        Of the mesh that is returned: "plane_strain", or "axisymmetric" about x = 0.
    """
    points, cells = mesh.points, mesh.cells
    for axis in axes:
        k = "xy".index(axis)
        is_shared = points[:, k] == 0.0
        number = np.where(is_shared, np.arange(len(points)), len(points) + np.cumsum(~is_shared) - 1)
        image = points[~is_shared] * np.where(np.arange(2) == k, -1.0, 1.0)
        points = np.concatenate([points, image])
        cells = np.concatenate([cells, number[cells][:, ::-1]])
    return make_mesh("quad4", space, points, cells)


def mirrored_surface(points: Array, triangles: Integers, axes: tuple[str, ...]) -> tuple[Array, Integers]:
    """Return corners (n, 3) [m] and triangles (t, 3) of a solid with its mirror images, open between none.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Corners [m].
    triangles : ndarray of int, (t, 3)
        Turned outwards.
    axes : tuple of str
        Directions in which the part goes on behind 0.
    """
    for axis in axes:
        k = "xyz".index(axis)
        is_shared = points[:, k] == 0.0
        triangles = triangles[~is_shared[triangles].all(axis=1)]
        number = np.where(is_shared, np.arange(len(points)), len(points) + np.cumsum(~is_shared) - 1)
        points = np.concatenate([points, points[~is_shared] * np.where(np.arange(3) == k, -1.0, 1.0)])
        triangles = np.concatenate([triangles, number[triangles][:, ::-1]])
    used, numbers = np.unique(triangles, return_inverse=True)
    return points[used], numbers.reshape(triangles.shape)


def final_surface(task: Task, mesh: Mesh, height_m: float, pieces: int) -> tuple[Array, Integers]:
    """Return the surface of a part with its mirror images: corners (n, 3) [m], triangles (t, 3).

    Parameters
    ----------
    task : Task
    mesh : Mesh
        Of its solid.
    height_m : float
        Along z [m], in plane strain.
    pieces : int
        Of a revolution about an axis.
    """
    if task.space == "solid":
        return mirrored_surface(*solid_surface(mesh), task.mirrors)
    if task.space == "axisymmetric":
        return revolved(mirrored(mesh, tuple({*task.mirrors} - {"x"}), "axisymmetric"), pieces)
    return extruded(mirrored(mesh, task.mirrors), height_m)
