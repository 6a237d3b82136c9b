"""A part that is ready to be loaded: its mesh, what holds it, and what is measured of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from soro_core.errors import ConfigError, ModelError
from soro_core.fem import State
from soro_core.fem.backbone import section_poses
from soro_core.fem.bellows import bellows_mesh
from soro_core.fem.blocks import grid, revolved_tube
from soro_core.fem.fibres import fibres
from soro_core.fem.loads import no_loads, traction
from soro_core.fem.part import Part, make_part
from soro_core.fem.parts.file import (
    BellowsGeometry,
    PartFile,
    RodGeometry,
    Sweep,
    TubeGeometry,
    material_of,
)
from soro_core.fem.response import Array, Indices
from soro_core.fem.rod import Rod, rod_mesh
from soro_core.rotation import rotation_log


@dataclass(frozen=True, eq=False)
class RodSpecimen:
    """A rod with chambers, clamped at its base.

    Attributes
    ----------
    part : Part
        Without loads.
    rod : Rod
        What lies where.
    tip : ndarray of int, (f, 4)
        Faces of the end.
    """

    part: Part
    rod: Rod
    tip: Indices

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

    def under(self, sweep: Sweep) -> Part:
        """Return the part under pressures in its chambers and a force on its end face."""
        loads = self.part.loads
        for faces, pressure in zip(self.rod.chambers, sweep.pressures_pa, strict=False):
            loads = loads.press(faces, pressure) if pressure else loads
        if any(sweep.force_n):
            pull = traction(self.part.mesh, self.tip, sweep.force_n)
            loads = loads.pull(pull * np.linalg.norm(sweep.force_n) / np.linalg.norm(pull.sum(axis=0)))
        return self.part.under(loads)

    def measured(self, state: State) -> dict[str, float]:
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
    """

    part: Part
    inside: Indices
    tip: Indices

    @property
    def chambers(self) -> int:
        """Number of pressures."""
        return 1

    def under(self, sweep: Sweep) -> Part:
        """Return the part with its upper end held at an extension, under a pressure inside."""
        loads = self.part.loads.hold(self.tip, 1, sweep.extension_m)
        for pressure in sweep.pressures_pa:
            loads = loads.press(self.inside, pressure)
        return self.part.under(loads)

    def measured(self, state: State) -> dict[str, float]:
        """Return the extension, the force that holds it, and the greatest change of a radius."""
        r = state.u[:, 0]
        return {
            "extension_m": float(state.u[self.tip, 1].mean()),
            "force_n": float(state.reaction[self.tip, 1].sum()),
            "radius_change_m": float(r[np.abs(r).argmax()]),
        }


Specimen: TypeAlias = RodSpecimen | RingSpecimen


def make_specimen(file: PartFile) -> Specimen:
    """Return the specimen of a part file.

    Raises
    ------
    ConfigError
        If an element of its mesh is inverted or degenerate.
    """
    try:
        return (
            _rod(file, file.geometry)
            if isinstance(file.geometry, RodGeometry)
            else _ring(file, file.geometry)
        )
    except ModelError as error:
        raise ConfigError(file.name, "geometry", str(error), "a mesh without such elements") from None


def _rod(file: PartFile, geometry: RodGeometry) -> RodSpecimen:
    rod = rod_mesh(geometry.shape, geometry.counts)
    loads = no_loads(rod.mesh)
    for direction in range(3):
        loads = loads.hold(rod.base, direction)
    if geometry.hoops is not None:
        stiffness = geometry.hoops.stiffness_n * rod.hoop_spacing_m / geometry.hoops.spacing_m
        loads = loads.reinforce(fibres(rod.hoops, stiffness))
    ends = np.zeros(len(rod.mesh.points), dtype=bool)
    ends[rod.tip] = True
    return RodSpecimen(make_part(rod.mesh, material_of(file), loads), rod, rod.mesh.faces_at(ends))


def _ring(file: PartFile, geometry: TubeGeometry | BellowsGeometry) -> RingSpecimen:
    if isinstance(geometry, TubeGeometry):
        counts = (geometry.across, geometry.along)
        radii = (geometry.inner_radius_m, geometry.outer_radius_m)
        mesh = revolved_tube(geometry.element, counts, radii, geometry.length_m)
    else:
        mesh = bellows_mesh(geometry.element, geometry.shape, geometry.across, geometry.along)
        counts = (geometry.across, len(mesh.cells) // geometry.across)
    across, along = grid(geometry.element, counts)[0].T
    part = make_part(mesh, material_of(file), no_loads(mesh).hold(along == 0.0, 1))
    return RingSpecimen(part, mesh.faces_at(across == 0.0), np.flatnonzero(along == 1.0))
