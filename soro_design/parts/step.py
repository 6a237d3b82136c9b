"""STEP files of parts, by Open CASCADE of netgen (extra `mesh`): round where a mesh has polygons.

A rod has its chambers as closed voids. Fibres are no solid: a file holds the rubber alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.extras import named_packages
from soro_design.fem.meshes.bellows import Bellows
from soro_design.fem.meshes.rod import RodShape
from soro_design.parts.geometry import BellowsGeometry, RodGeometry, TubeGeometry

# STEP files are in millimetres.
MM = 1e3
# Pieces of a lobe that are arcs: neck and fillet of a half, in reverse order of the other one.
ROUND = (0, 2, 5, 7)


def write_step(path: str | Path, geometry: RodGeometry | BellowsGeometry | TubeGeometry) -> float:
    """Write, or replace, the solid of a part, in millimetres, upright from z = 0; return its volume [m3].

    Raises
    ------
    ModelError
        If the file cannot be written.
    MissingPackageError
        If netgen is not installed.
    """
    with named_packages():
        import netgen.occ as occ
    if isinstance(geometry, RodGeometry):
        solid = _rod(occ, geometry.shape)
    elif isinstance(geometry, BellowsGeometry):
        solid = _bellows(occ, geometry.shape)
    else:
        solid = _tube(occ, geometry)
    try:
        # Open CASCADE says nothing where it cannot write.
        Path(path).write_bytes(b"")
    except OSError as error:
        raise ModelError(f"path {path}: {error.strerror}; allowed: one that can be written", "path") from None
    solid.WriteStep(str(path))
    return float(solid.mass) / MM**3


def _rod(occ: Any, shape: RodShape) -> Any:
    """A cone, less chambers that narrow with it, so that the axis of each leans towards that of the rod."""
    low, high = shape.plug_m, shape.length_m - shape.plug_m

    def between(radius: float, centre: Array, bottom: float, top: float) -> Any:
        rims = []
        for z in (bottom, top):
            size = MM * (1.0 + (shape.taper - 1.0) * z / shape.length_m)
            axes = occ.Axes((*(size * centre), MM * z), occ.Z, occ.X)
            rims.append(occ.WorkPlane(axes).Circle(size * radius).Wire())
        return occ.ThruSections(rims)

    solid = between(shape.radius_m, np.zeros(2), 0.0, shape.length_m)
    for angle in 2.0 * np.pi * np.arange(shape.chambers) / shape.chambers:
        centre = shape.chamber_offset_m * np.array([np.cos(angle), np.sin(angle)])
        solid = solid - between(shape.chamber_radius_m, centre, low, high)
    return solid


def _tube(occ: Any, tube: TubeGeometry) -> Any:
    outer, inner = (
        occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, MM * radius, MM * tube.length_m)
        for radius in (tube.outer_radius_m, tube.inner_radius_m)
    )
    return outer - inner


def _bellows(occ: Any, shape: Bellows) -> Any:
    """The section, of lines and of arcs of circles, revolved about z."""
    # Both ends and the middle of each piece, up half a lobe; then the other half, mirrored.
    pieces = np.linspace(0.0, 4.0, 9)
    outer, normal = shape.outline(pieces)
    walls, sides = [], []
    for half in (outer, outer + shape.wall * normal):
        back = half[::-1] * [1.0, -1.0] + [0.0, shape.pitch]
        lobe = np.concatenate([half, back[1:]])
        lobes = [lobe + np.array([0.0, shape.end + k * shape.pitch]) for k in range(shape.lobes)]
        wall = MM * np.concatenate([lobes[0], *(one[1:] for one in lobes[1:])])
        side = [_edge(occ, wall[i : i + 3], i // 2 % 8 in ROUND) for i in range(0, len(wall) - 2, 2)]
        if shape.end > 0.0:
            tube = [0.0, MM * shape.end]
            wall = np.concatenate([wall[:1] - tube, wall, wall[-1:] + tube])
            side = [_edge(occ, wall[:2]), *side, _edge(occ, wall[-2:])]
        walls.append(wall)
        sides.append(side)
    base, end = (_edge(occ, np.array([wall[k] for wall in walls])) for k in (0, -1))
    # Open CASCADE takes edges in turn.
    face = occ.Face(occ.Wire([*sides[0], end, *sides[1][::-1], base]))
    return face.Revolve(occ.Axis((0, 0, 0), occ.Z), 360)


def _edge(occ: Any, places: Array, is_round: bool = False) -> Any:
    """An edge from the first to the last of places (m, 2) of r and z; where round, through the second."""
    points = [occ.Pnt(float(r), 0.0, float(z)) for r, z in places]
    return occ.ArcOfCircle(*points) if is_round else occ.Segment(points[0], points[-1])
