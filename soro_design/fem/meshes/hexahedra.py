"""Meshes of solids from those of sections, extruded along z or revolved about it; surfaces: `fem.surface`."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_design.fem.elements.element import element
from soro_design.fem.elements.mesh import Mesh, make_mesh

_SOLID_OF = {"quad4": "hex8", "quad8": "hex20"}


def extruded_mesh(section: Mesh, height_m: float, layers: int) -> Mesh:
    """Return a solid of hex8 from quad4, or of hex20 from quad8: a section along z, from z = 0.

    Parameters
    ----------
    section : Mesh
        In plane strain.
    height_m : float
        Along z.
    layers : int
        Number of elements along z.

    Raises
    ------
    ModelError
        If it is no such section, or height or layers make no solid.
    """
    if section.space != "plane_strain":
        raise ModelError(f"space {section.space!r} of the section; allowed: plane_strain", "space")
    if not 0.0 < height_m < np.inf:
        raise ModelError(f"height_m {height_m}; allowed: a number above 0", "height_m")
    if layers < 1:
        raise ModelError(f"layers {layers}; allowed: 1 or more", "layers")
    z = np.linspace(0.0, height_m, 2 * layers + 1)
    flat = np.tile(section.points, (len(z), 1))
    return _stacked(section, np.insert(flat, 2, np.repeat(z, len(section.points)), axis=1), layers)


def revolved_mesh(section: Mesh, pieces: int, angle_rad: float = 2.0 * np.pi) -> Mesh:
    """Return a solid of hex8 from quad4, or of hex20 from quad8: a section about z, from the plane y = 0.

    The polygon of a circle, of parabolas with hex20, lies partly outside it, so that the volume is that of
    the ring (exactly where the edges of the section are straight).

    Parameters
    ----------
    section : Mesh
        Axisymmetric, away from the axis, on which elements would degenerate to wedges.
    pieces : int
        Number of elements around, of at most 120 degrees each.
    angle_rad : float
        Of the revolution, by default a whole turn; a quarter, pi / 2, ends in planes of symmetry.

    Raises
    ------
    ModelError
        If it is no such section, or pieces or angle make no solid.
    """
    if section.space != "axisymmetric":
        raise ModelError(f"space {section.space!r} of the section; allowed: axisymmetric", "space")
    if not 0.0 < angle_rad <= 2.0 * np.pi:
        raise ModelError(f"angle_rad {angle_rad}; allowed: above 0, to 2 pi", "angle_rad")
    least = int(np.ceil(angle_rad / (2.0 * np.pi / 3.0) - 1e-9))
    if pieces < least:
        raise ModelError(f"pieces {pieces}; allowed: {least} or more of this angle", "pieces")
    if section.points[:, 0].min() <= 1e-9 * section.points[:, 0].max():
        raise ModelError(
            "points of the section on the axis, where hexahedra are wedges; allowed: r > 0, or the section"
            " itself as an axisymmetric part",
            "points",
        )
    angle = np.linspace(0.0, angle_rad, 2 * pieces + 1)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # In a plane of symmetry a place is exactly 0.
    around[np.abs(around) < 1e-15] = 0.0
    is_whole = angle_rad == 2.0 * np.pi
    r, z = section.points.T
    flat = _swelling(section.kind, angle_rad / pieces) * r[None, :, None] * around[:, None]
    places = np.concatenate([flat, np.broadcast_to(z[None, :, None], (*flat.shape[:2], 1))], axis=2)
    return _stacked(section, (places[:-1] if is_whole else places).reshape(-1, 3), pieces)


def _swelling(kind: str, step: float) -> float:
    """Radius of the nodes over that of a circle of the same area, `step` rad between corners."""
    triangle = 0.5 * np.sin(step)
    # Of hex20 with the parabola through the middle: two thirds of its height over the chord.
    segment = 2.0 / 3.0 * 2.0 * np.sin(0.5 * step) * (1.0 - np.cos(0.5 * step))
    return float(np.sqrt(0.5 * step / (triangle + (segment if kind == "quad8" else 0.0))))


def _stacked(section: Mesh, points: Array, layers: int) -> Mesh:
    """The solid between copies of a section: `points` of them, one at each end and middle of a layer.

    Where the last copy is missing the first one takes its place.
    """
    kind, n = _SOLID_OF[section.kind], len(section.points)
    flat, solid = element(section.kind).nodes, element(kind).nodes
    # Each node of a solid lies on a copy, at a node of the section.
    at = [int(np.flatnonzero((flat == node[:2]).all(axis=1))[0]) for node in solid]
    up = (solid[:, 2] + 1.0).astype(np.int64)
    first = section.cells[:, at] + n * up
    cells = [(first + 2 * n * layer) % len(points) for layer in range(layers)]
    used, numbers = np.unique(np.concatenate(cells), return_inverse=True)
    return make_mesh(kind, "solid", points[used], numbers.reshape(-1, len(solid)))
