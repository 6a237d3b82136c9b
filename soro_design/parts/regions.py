"""Regions of a part of a mesh file: their nodes and their faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Array, Integers
from soro_core.errors import ConfigError, ModelError
from soro_core.files.stl import read_stl
from soro_design.fem.elements.mesh import Mesh
from soro_design.fem.meshes.cavities import InnerSurface, inner_surfaces, surface_around, surface_of
from soro_design.fem.meshes.mesh_files import MeshFile
from soro_design.parts.mesh_geometry import MeshGeometry, Region

# A node is at a bound of a region if it is nearer than this part of the size of the mesh.
NEAR = 1e-6
# As many closed surfaces are listed in one line.
_LISTED = 4


@dataclass(frozen=True, eq=False)
class ChosenRegion:
    """What a region has of a mesh.

    Attributes
    ----------
    nodes : ndarray of bool, (n,)
        Its nodes.
    faces : ndarray of int, (f, m)
        Its faces of the boundary, or none.
    """

    nodes: NDArray[np.bool_]
    faces: Integers


def choose(where: str, read: MeshFile, name: str, geometry: MeshGeometry) -> ChosenRegion:
    """Return the nodes and faces of a region of the part file `where`.

    Raises
    ------
    ConfigError
        If its group or its closed surface is not in the mesh, or no node fits.
    """
    region, key = geometry.regions[name], f"geometry.regions.{name}"
    points = read.mesh.points
    inside, faces = np.ones(len(points), dtype=bool), read.mesh.boundary()
    if region.group:
        if region.group not in read.groups:
            allowed = ", ".join(read.groups) or "none: this file has no named groups; state bounds"
            raise ConfigError(where, f"{key}.group", region.group, allowed)
        inside &= read.groups[region.group]
    if region.has_surface:
        faces = _surface(where, read.mesh, key, region, geometry.unit_m)
        inside &= np.isin(np.arange(len(points)), faces)
    near = NEAR * np.ptp(points)
    for bound, (low, high) in region.bounds().items():
        axis = "xyz".find(bound[0])
        places = points[:, axis] if axis >= 0 else np.hypot(points[:, 0], points[:, 1])
        inside &= (places > low - near) & (places < high + near)
    if not inside.any():
        allowed = f"one with nodes; the mesh reaches from {_extent(points)}"
        raise ConfigError(where, key, "a region without nodes", allowed)
    return ChosenRegion(inside, faces[inside[faces].all(axis=1)])


def doubled(points: Array) -> int:
    """Return how many of the nodes (n, d) lie where another one is."""
    return len(points) - len(np.unique(np.round(points / (NEAR * np.ptp(points))), axis=0))


def _surface(where: str, mesh: Mesh, key: str, region: Region, unit_m: float) -> Integers:
    """Faces (f, m) that are on all surfaces that a region states."""
    found = inner_surfaces(mesh)
    if not found and not region.stl:
        used = "inner_surface" if region.inner_surface is not None else "around_m"
        count = doubled(mesh.points)
        why = f" ({count} nodes lie where others are)" if count else ""
        allowed = f"none: no surface closes inside this mesh{why}; state stl, a group or bounds"
        raise ConfigError(where, f"{key}.{used}", getattr(region, used), allowed)
    stated = []
    if region.inner_surface is not None:
        if region.inner_surface > len(found):
            raise ConfigError(where, f"{key}.inner_surface", region.inner_surface, _listed(mesh, found))
        stated.append(found[region.inner_surface - 1].faces)
    if region.around_m is not None:
        try:
            stated.append(surface_around(mesh, found, region.around_m))
        except ModelError:
            allowed = f"one in the air of an inner surface: {_listed(mesh, found)}"
            raise ConfigError(where, f"{key}.around_m", list(region.around_m), allowed) from None
    if region.stl:
        try:
            corners, triangles = read_stl(region.stl, unit_m)
            stated.append(surface_of(mesh, found, corners, triangles))
        except ModelError as error:
            allowed = str(error).split("allowed: ")[-1]
            raise ConfigError(where, f"{key}.stl", region.stl, allowed) from None
    faces = stated[0]
    for other in stated[1:]:
        faces = faces[(faces[:, None] == other).all(axis=2).any(axis=1)]
    return faces


def _listed(mesh: Mesh, found: Sequence[InnerSurface]) -> str:
    """Numbers, volumes and places of closed surfaces."""
    unit, scale = ("mm2", 1e6) if mesh.space == "plane_strain" else ("mm3", 1e9)
    listed = [
        f"{k + 1} ({scale * one.volume:.4g} {unit}, {_extent(mesh.points[one.faces.ravel()])})"
        for k, one in enumerate(found[:_LISTED])
    ]
    return ", ".join([*listed, f"to {len(found)}"] if len(found) > _LISTED else listed)


def _extent(points: Array) -> str:
    low, high = (", ".join(f"{x:.4g}" for x in edge(axis=0)) for edge in (points.min, points.max))
    return f"({low}) to ({high}) m"
