"""The section of a part with its mirror images."""

from __future__ import annotations

import numpy as np

from soro_design.fem import Mesh, make_mesh
from soro_design.fem.elements.mesh import Space


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
