"""A part that is ready to be loaded: its mesh, what holds it, and what is measured of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from soro_core.arrays import Array, Integers
from soro_core.errors import ConfigError, ModelError
from soro_core.rotation import rotation_log
from soro_design.fem import EquilibriumState
from soro_design.fem.backbone import section_poses
from soro_design.fem.elements.fibres import fibres
from soro_design.fem.loads import no_loads, spread_force
from soro_design.fem.meshes.bellows import bellows_mesh
from soro_design.fem.meshes.blocks import grid, revolved_tube
from soro_design.fem.meshes.pneunet import pneunet_mesh
from soro_design.fem.meshes.rod import Rod, rod_mesh
from soro_design.fem.part import Part
from soro_design.parts.bare import bare_part
from soro_design.parts.file import LoadSweep, PartFile
from soro_design.parts.geometry import BellowsGeometry, PneunetGeometry, RodGeometry, TubeGeometry
from soro_design.parts.mesh_geometry import MeshGeometry
from soro_design.parts.mesh_specimen import MeshSpecimen, mesh_specimen
from soro_design.parts.tendons import Routed, tensioned


@dataclass(frozen=True, eq=False)
class RodSpecimen:
    """A rod with chambers or a PneuNet, clamped at its base.

    Attributes
    ----------
    part : Part
        Without loads.
    rod : Rod
        What lies where.
    tip : ndarray of int, (f, 4)
        Faces of the end.
    tendons : tuple of Routed
        Tendons.
    """

    part: Part
    rod: Rod
    tip: Integers
    tendons: tuple[Routed, ...] = ()

    @property
    def chambers(self) -> int:
        """Number of pressures."""
        return len(self.rod.chambers)

    @property
    def z(self) -> Array:
        """Undeformed places of the sections along the axis [m]."""
        return np.asarray(self.part.mesh.points[self.rod.sections[:, 0], 2])

    def poses(self, u: Array) -> Array:
        """Return the poses of the sections (s, 4, 4) at displacements (n, 3)."""
        return section_poses(self.part.mesh.points, u, self.rod.sections, self.rod.share)

    def under(self, sweep: LoadSweep) -> Part:
        """Return the part under pressures in its chambers, a force on its end face and tensions."""
        loads = self.part.loads
        for faces, pressure in zip(self.rod.chambers, sweep.pressures_pa, strict=False):
            loads = loads.press(faces, pressure) if pressure else loads
        if any(sweep.force_n):
            loads = loads.pull(spread_force(self.part.mesh, self.tip, sweep.force_n))
        return self.part.under(tensioned(loads, self.tendons, sweep.tensions_n))

    def measured(self, state: EquilibriumState) -> dict[str, float]:
        """Return place and turn of the last section."""
        pose = self.poses(state.u)[-1]
        place, turn = pose[:3, 3], rotation_log(pose[:3, :3])
        return {
            **{f"tip_{axis}_m": float(v) for axis, v in zip("xyz", place, strict=True)},
            **{f"turn_{axis}_rad": float(v) for axis, v in zip("xyz", turn, strict=True)},
        }


@dataclass(frozen=True, eq=False)
class RingSpecimen:
    """A tube or bellows about the axis r = 0, whose ends keep their planes.

    Attributes
    ----------
    part : Part
        Without loads; its base does not move along the axis.
    inside : ndarray of int, (f, m)
        Faces of the inner wall.
    tip : ndarray of int
        Nodes of the upper end.
    tendons : tuple of Routed
        None.
    """

    part: Part
    inside: Integers
    tip: Integers
    tendons: tuple[Routed, ...] = ()

    @property
    def chambers(self) -> int:
        """Number of pressures."""
        return 1

    def under(self, sweep: LoadSweep) -> Part:
        """Return the part with its upper end held at an extension, under a pressure inside."""
        loads = self.part.loads.hold(self.tip, 1, sweep.extension_m)
        for pressure in sweep.pressures_pa:
            loads = loads.press(self.inside, pressure)
        return self.part.under(loads)

    def measured(self, state: EquilibriumState) -> dict[str, float]:
        """Return the extension, the force that holds it, and the greatest change of a radius."""
        r = state.u[:, 0]
        return {
            "extension_m": float(state.u[self.tip, 1].mean()),
            "force_n": float(state.reaction[self.tip, 1].sum()),
            "radius_change_m": float(r[np.abs(r).argmax()]),
        }


Specimen: TypeAlias = RodSpecimen | RingSpecimen | MeshSpecimen


def make_specimen(file: PartFile) -> Specimen:
    """Return the specimen of a part file.

    Raises
    ------
    ConfigError
        If an element of its mesh is inverted or degenerate, or what its file states does not fit the mesh.
    """
    try:
        if isinstance(file.geometry, RodGeometry | PneunetGeometry):
            return _rod(file, file.geometry)
        if isinstance(file.geometry, MeshGeometry):
            return mesh_specimen(file, file.geometry)
        return _ring(file, file.geometry)
    except ModelError as error:
        got, _, allowed = str(error).partition("; allowed: ")
        if isinstance(file.geometry, MeshGeometry):
            got = got.removeprefix(f"path {file.geometry.file}: ")
            raise ConfigError(file.name, "geometry.file", got, allowed) from None
        raise ConfigError(file.name, "geometry", got, allowed) from None


def _rod(file: PartFile, geometry: RodGeometry | PneunetGeometry) -> RodSpecimen:
    if isinstance(geometry, PneunetGeometry):
        rod, hoops = pneunet_mesh(geometry.shape, geometry.across, geometry.between), None
    else:
        rod, hoops = rod_mesh(geometry.shape, geometry.counts), geometry.hoops
    loads = no_loads(rod.mesh)
    for direction in range(3):
        loads = loads.hold(rod.base, direction)
    if hoops is not None:
        stiffness = hoops.stiffness_n * rod.hoop_spacing_m / hoops.spacing_m
        loads = loads.reinforce(fibres(rod.hoops, stiffness))
    ends = np.zeros(len(rod.mesh.points), dtype=bool)
    ends[rod.tip] = True
    part, tendons = bare_part(file, rod.mesh, loads)
    return RodSpecimen(part, rod, rod.mesh.faces_at(ends), tendons)


def _ring(file: PartFile, geometry: TubeGeometry | BellowsGeometry) -> RingSpecimen:
    if isinstance(geometry, TubeGeometry):
        counts = (geometry.across, geometry.along)
        radii = (geometry.inner_radius_m, geometry.outer_radius_m)
        mesh = revolved_tube(geometry.element, counts, radii, geometry.length_m)
    else:
        mesh = bellows_mesh(geometry.element, geometry.shape, geometry.across, geometry.along)
        counts = (geometry.across, len(mesh.cells) // geometry.across)
    across, along = grid(geometry.element, counts)[0].T
    part, _ = bare_part(file, mesh, no_loads(mesh).hold(along == 0.0, 1))
    return RingSpecimen(part, mesh.faces_at(across == 0.0), np.flatnonzero(along == 1.0))
