"""A part of a mesh file that is ready to be loaded: what is held, pressed, forced and moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from soro_core.arrays import Integers
from soro_core.errors import ConfigError, ModelError
from soro_design.fem import EquilibriumState
from soro_design.fem.loads import no_loads, spread_force
from soro_design.fem.meshes.mesh_files import MeshFile, mesh_step, mesh_stl, read_mesh
from soro_design.fem.part import Part
from soro_design.parts.bare import bare_part
from soro_design.parts.file import LoadSweep, PartFile
from soro_design.parts.mesh_geometry import AXES, MeshGeometry
from soro_design.parts.regions import ChosenRegion, choose, doubled
from soro_design.parts.tendons import Routed, tensioned


@dataclass(frozen=True, eq=False)
class MeshSpecimen:
    """A part of a mesh file.

    Attributes
    ----------
    part : Part
        Without loads, held where its file says.
    pressed : tuple of tuple of ndarray and bool
        Faces of each pressure, and whether they are an open surface.
    forced : ndarray of int, (f, m)
        Faces that take the force, or none.
    moved : ndarray of int, (n,)
        Nodes that move by the extension, or none.
    direction : int
        Of that motion.
    tendons : tuple of Routed
        Tendons.
    """

    part: Part
    pressed: tuple[tuple[Integers, bool], ...]
    forced: Integers
    moved: Integers
    direction: int
    tendons: tuple[Routed, ...] = ()

    @property
    def chambers(self) -> int:
        """Number of pressures."""
        return len(self.pressed)

    @property
    def watched(self) -> Integers:
        """Nodes whose mean motion is measured: forced ones, else moved ones, else all."""
        if self.forced.size:
            return np.unique(self.forced)
        return self.moved if self.moved.size else np.arange(len(self.part.mesh.points))

    def under(self, sweep: LoadSweep) -> Part:
        """Return the part under the pressures, the force, the extension and the tensions of a sweep."""
        loads, mesh = self.part.loads, self.part.mesh
        for (faces, is_open), pressure in zip(self.pressed, sweep.pressures_pa, strict=False):
            loads = loads.press(faces, pressure, is_open) if pressure else loads
        if any(sweep.force_n):
            loads = loads.pull(spread_force(mesh, self.forced, sweep.force_n[: mesh.points.shape[1]]))
        if self.moved.size:
            loads = loads.hold(self.moved, self.direction, sweep.extension_m)
        return self.part.under(tensioned(loads, self.tendons, sweep.tensions_n))

    def measured(self, state: EquilibriumState) -> dict[str, float]:
        """Return the mean motion of what is forced or moved, the force that moves it, the greatest motion."""
        axes = AXES[self.part.mesh.space]
        mean = state.u[self.watched].mean(axis=0)
        found = {f"mean_{axis}_m": float(value) for axis, value in zip(axes, mean, strict=True)}
        if self.moved.size:
            found["reaction_n"] = float(state.reaction[self.moved, self.direction].sum())
        return found | {"farthest_m": float(np.linalg.norm(state.u, axis=1).max())}


def read_part_mesh(geometry: MeshGeometry) -> MeshFile:
    """Return the mesh of the file of a part, with its groups.

    Raises
    ------
    ModelError
        If the file cannot be read, or its elements make no mesh.
    MissingPackageError
        If meshio or netgen is not installed.
    """
    if not (geometry.is_step or geometry.is_surface):
        return read_mesh(geometry.file, geometry.space, geometry.unit_m)
    assert geometry.largest_m is not None  # checked when the part is loaded
    if geometry.is_step:
        return MeshFile(mesh_step(geometry.file, geometry.largest_m), {})
    return MeshFile(mesh_stl(geometry.file, geometry.largest_m, geometry.unit_m), {})


def mesh_specimen(file: PartFile, geometry: MeshGeometry) -> MeshSpecimen:
    """Return the specimen of a part file with a mesh.

    Raises
    ------
    ConfigError
        If a group is not in the mesh, a region has no nodes or no faces, a cavity is open, or a piece of
        the mesh is loose.
    ModelError
        If the file cannot be read, or its elements make no mesh.
    """
    read = read_part_mesh(geometry)
    mesh = read.mesh
    _check_pieces(file.name, read, geometry)
    regions = {name: choose(file.name, read, name, geometry) for name in geometry.named().values()}
    loads = no_loads(mesh)
    for held in geometry.held:
        for axis in held.directions:
            loads = loads.hold(regions[held.region].nodes, "xyz".index(axis))
    part, tendons = bare_part(file, mesh, loads)
    none = np.empty(0, dtype=np.int64)
    direction = 0 if geometry.moved is None else "xyz".index(geometry.moved.direction)
    moved = none if geometry.moved is None else np.flatnonzero(regions[geometry.moved.region].nodes)
    # Motions are held before cavities are looked at: a rim may be closed by them.
    held_part = part.under(loads.hold(moved, direction)) if moved.size else part
    pressed = []
    for i, one in enumerate(geometry.pressed):
        faces = _faces(file.name, f"pressed[{i}].region", one.region, regions)
        try:
            held_part.under(held_part.loads.press(faces, 1.0, one.is_open))
        except ModelError as error:
            opening = str(error).split("; allowed")[0].split(": ", 1)[-1]
            allowed = "a closed cavity, a rim that is held or in a plane of symmetry, or is_open: true"
            raise ConfigError(
                file.name, f"geometry.pressed[{i}]", one.region, f"{allowed}; {opening}"
            ) from None
        pressed.append((faces, one.is_open))
    forced = _faces(file.name, "forced", geometry.forced, regions) if geometry.forced else none
    return MeshSpecimen(part, tuple(pressed), forced, moved, direction, tendons)


def _check_pieces(where: str, read: MeshFile, geometry: MeshGeometry) -> None:
    """Refuse a mesh in several pieces, of which one has no node that is held or moved."""
    cells, n = read.mesh.cells, len(read.mesh.points)
    joined = coo_array((np.ones(cells.size), (np.repeat(cells[:, 0], cells.shape[1]), cells.ravel())), (n, n))
    count, piece = connected_components(joined, directed=False)
    if count == 1:
        return
    names = {one.region for one in (*geometry.held, geometry.moved) if one is not None}
    is_held = np.zeros(n, dtype=bool)
    for name in names:
        is_held |= choose(where, read, name, geometry).nodes
    for k in np.setdiff1d(np.arange(count), piece[is_held]):
        place = ", ".join(f"{x:.4g}" for x in read.mesh.points[piece == k].mean(axis=0))
        allowed = (
            f"nodes of each of the {count} pieces that share no node, here none of that around ({place}) m;"
            f" {doubled(read.mesh.points)} nodes lie where others are"
        )
        raise ConfigError(where, "geometry.held", sorted(names), allowed)


def _faces(where: str, key: str, name: str, regions: dict[str, ChosenRegion]) -> Integers:
    """Faces of the boundary in a region."""
    faces = regions[name].faces
    if len(faces) == 0:
        allowed = "a region with all nodes of a face of the boundary"
        raise ConfigError(where, f"geometry.{key}", name, allowed)
    return faces
