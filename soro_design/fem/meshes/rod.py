"""Meshes of rods with chambers: a section of hexahedra around round holes, extruded, maybe tapered.

The section is made of one block, half of the sector of a chamber: from half the rim of the hole to the
outside and to the plane between two chambers. All others are its mirror images, turned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError
from soro_design.fem.elements.fibres import pieces_of
from soro_design.fem.elements.mesh import Mesh, make_mesh

# Diagonal of the square in the middle of a plug, over the diameter of the hole.
SQUARE = 0.6


@dataclass(frozen=True)
class RodShape:
    """A round rod with round chambers along it, closed by plugs at both ends.

    Attributes
    ----------
    length_m, radius_m : float
        Of the rod [m].
    chambers : int
        Number of chambers, the first towards x, counter-clockwise.
    chamber_radius_m, chamber_offset_m : float
        Radius of a chamber, and distance of its axis from that of the rod [m].
    plug_m : float
        Length of the solid part at each end [m].
    taper : float
        Size of the section at the tip over that at the base; it changes evenly along the rod.
    """

    length_m: float
    radius_m: float
    chambers: int
    chamber_radius_m: float
    chamber_offset_m: float
    plug_m: float
    taper: float = 1.0

    def __post_init__(self) -> None:
        is_counted = 2 <= self.chambers <= 12
        offset = self.chamber_offset_m
        most = min(offset * np.sin(np.pi / self.chambers), self.radius_m - offset) if is_counted else 0.0
        rules = {
            "length_m": (0.0 < self.length_m < np.inf, "above 0"),
            "radius_m": (0.0 < self.radius_m < np.inf, "above 0"),
            "chambers": (is_counted, "2 to 12"),
            "chamber_offset_m": (0.0 < offset < self.radius_m, f"above 0, below radius_m, {self.radius_m:g}"),
            "chamber_radius_m": (
                0.0 < self.chamber_radius_m < most,
                f"above 0, below {most:.4g}, so that there are walls to the neighbours and to the outside",
            ),
            "plug_m": (
                0.0 < 2.0 * self.plug_m < self.length_m,
                f"above 0, below half of length_m, {0.5 * self.length_m:g}",
            ),
            "taper": (0.1 <= self.taper <= 10.0, "0.1 to 10"),
        }
        for key, (is_kept, allowed) in rules.items():
            if not is_kept:
                raise ModelError(f"{key} {getattr(self, key)}; allowed: {allowed}", key)


@dataclass(frozen=True)
class RodCounts:
    """Numbers of elements."""

    around: int = 4
    """Around a quarter of a chamber."""
    across: int = 2
    """Across a wall."""
    along: int = 18
    """Along the chambers."""
    plug: int = 1
    """Along a plug."""

    def __post_init__(self) -> None:
        for key, least in (("around", 2), ("across", 1), ("along", 1), ("plug", 1)):
            if getattr(self, key) < least:
                raise ModelError(f"{key} {getattr(self, key)}; allowed: {least} or more", key)


@dataclass(frozen=True, eq=False)
class Rod:
    """The mesh of a rod, or of a PneuNet, and what lies where.

    Attributes
    ----------
    mesh : Mesh
        hex8, upright from z = 0.
    sections : ndarray of int, (s, n)
        Nodes of the sections across the wall, of a PneuNet across its layer, from the base to the tip.
    share : ndarray, (n,)
        Undeformed area of each of these nodes [m2], in a section of full size.
    base, tip : ndarray of int
        Nodes of the end faces.
    chambers : tuple of ndarray of int, (f, 4)
        Faces of each chamber, turned out of the material, that is into the chamber.
    hoops : ndarray of int, (m, 2)
        Pieces of rings around the chambers, at each section along them.
    hoop_spacing_m : ndarray, (m,)
        Length of rod that a ring stands for [m].
    """

    mesh: Mesh
    sections: Integers
    share: Array
    base: Integers
    tip: Integers
    chambers: tuple[Integers, ...]
    hoops: Integers
    hoop_spacing_m: Array


def rod_mesh(shape: RodShape, counts: RodCounts) -> Rod:
    """Return the mesh of a rod.

    Rims are polygons of the area of their circles: a polygon between points of the circle is smaller, by
    2.6 % with 16 corners.
    """
    plane, walls, plugs = _section(shape, counts)
    n_plane = len(plane)
    z = np.concatenate(
        [
            np.linspace(0.0, shape.plug_m, counts.plug, endpoint=False),
            np.linspace(shape.plug_m, shape.length_m - shape.plug_m, counts.along, endpoint=False),
            np.linspace(shape.length_m - shape.plug_m, shape.length_m, counts.plug + 1),
        ]
    )
    size = 1.0 + (shape.taper - 1.0) * z / shape.length_m
    points = np.empty((len(z), n_plane, 3))
    points[:, :, :2] = size[:, None, None] * plane
    points[:, :, 2] = z[:, None]
    first, last = counts.plug, counts.plug + counts.along
    cells = []
    for k in range(len(z) - 1):
        flat = walls if first <= k < last else np.concatenate([walls, plugs])
        cells.append(np.concatenate([flat + k * n_plane, flat + (k + 1) * n_plane], axis=1))
    used, numbered = np.unique(np.concatenate(cells), return_inverse=True)
    number = np.full(len(z) * n_plane, -1)
    number[used] = np.arange(len(used))
    mesh = make_mesh("hex8", "solid", points.reshape(-1, 3)[used], numbered.reshape(-1, 8))
    layers = number.reshape(len(z), n_plane)

    share = np.zeros(n_plane)
    np.add.at(share, walls, 0.25 * np.abs(_areas(plane[walls]))[:, None])
    across = np.flatnonzero(share)
    faces, hoops = [], []
    for c in range(shape.chambers):
        inside = np.zeros(len(used), dtype=bool)
        rim = _rim(plane, shape, c, counts)
        inside[layers[first : last + 1, rim]] = True
        disc = np.hypot(*(plane - _centre(shape, c)).T) < shape.chamber_radius_m
        inside[layers[[first, last]][:, disc]] = True
        faces.append(mesh.faces_at(inside))
        hoops += [np.append(layers[k, rim], layers[k, rim[0]]) for k in range(first, last + 1)]
    gap = (shape.length_m - 2.0 * shape.plug_m) / counts.along
    spacing = np.full((shape.chambers, counts.along + 1), gap)
    spacing[:, [0, -1]] *= 0.5
    return Rod(
        mesh,
        layers[:, across],
        share[across],
        layers[0][layers[0] >= 0],
        layers[-1][layers[-1] >= 0],
        tuple(faces),
        pieces_of([list(hoop) for hoop in hoops]),
        np.repeat(spacing.ravel(), 4 * counts.around),
    )


def _section(shape: RodShape, counts: RodCounts) -> tuple[Array, Integers, Integers]:
    """Points (n, 2) of a section, elements of its wall and those of the plugs (e, 4), counter-clockwise."""
    half = _half_sector(shape, counts)
    quads = _quads(half)
    sector = np.concatenate([quads, quads * [1.0, -1.0]])
    hole = np.concatenate([_quads(patch) for patch in _disc(shape, counts)])
    turns = [2.0 * np.pi * c / shape.chambers for c in range(shape.chambers)]
    wall = np.concatenate([_turned(sector, turn) for turn in turns])
    plug = np.concatenate([_turned(hole, turn) for turn in turns])
    corners = np.concatenate([wall, plug])
    clockwise = _areas(corners) < 0.0
    corners[clockwise] = corners[clockwise, ::-1]
    points, cells = _joined(corners, 1e-7 * shape.radius_m)
    return points, cells[: len(wall)], cells[len(wall) :]


def _half_sector(shape: RodShape, counts: RodCounts) -> Array:
    """Places (2 m + 1, across + 1, 2) between half the rim of the first hole and the edge of its sector."""
    m = counts.around
    rim = _polygon_radius(shape.chamber_radius_m, 4 * m) * _circle(np.linspace(0.0, np.pi, 2 * m + 1))
    rim += [shape.chamber_offset_m, 0.0]
    angle = np.pi / shape.chambers
    radius = _polygon_radius(shape.radius_m, 2 * m * shape.chambers)
    arc = radius * _circle(np.linspace(0.0, angle, m + 1))
    between = np.linspace(1.0, 0.0, m + 1)[1:, None] * arc[-1]
    edge = np.concatenate([arc, between])
    across = np.linspace(0.0, 1.0, counts.across + 1)[None, :, None]
    return np.asarray(rim[:, None] + across * (edge - rim)[:, None])


def _disc(shape: RodShape, counts: RodCounts) -> list[Array]:
    """Grids of places that fill the first hole: a square on its corner and a ring in four patches."""
    m = counts.around
    radius = _polygon_radius(shape.chamber_radius_m, 4 * m)
    corner = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    share = np.linspace(0.0, 1.0, m + 1)
    a, b = np.meshgrid(share, share, indexing="ij")
    square = (1.0 - a)[..., None] * ((1.0 - b)[..., None] * corner[0] + b[..., None] * corner[1])
    square += a[..., None] * ((1.0 - b)[..., None] * corner[3] + b[..., None] * corner[2])
    patches = [SQUARE * square]
    for k in range(4):
        side = SQUARE * (corner[k] + share[:, None] * (corner[(k + 1) % 4] - corner[k]))
        patches.append(np.stack([side, _circle(0.5 * np.pi * (k + share))], axis=1))
    return [radius * patch + [shape.chamber_offset_m, 0.0] for patch in patches]


def _rim(plane: Array, shape: RodShape, c: int, counts: RodCounts) -> Integers:
    """Points of the rim of a chamber, in turn."""
    away = plane - _centre(shape, c)
    radius = _polygon_radius(shape.chamber_radius_m, 4 * counts.around)
    found = np.flatnonzero(np.abs(np.hypot(*away.T) - radius) < 1e-6 * radius)
    return found[np.argsort(np.arctan2(away[found, 1], away[found, 0]))]


def _centre(shape: RodShape, c: int) -> Array:
    return np.asarray(shape.chamber_offset_m * _circle(np.array([2.0 * np.pi * c / shape.chambers]))[0])


def _polygon_radius(radius: float, corners: int) -> float:
    """Radius of the corners of a regular polygon that has the area of a circle."""
    each = 2.0 * np.pi / corners
    return float(radius * np.sqrt(each / np.sin(each)))


def _circle(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _turned(places: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(places @ np.array([[c, s], [-s, c]]))


def _quads(grid: Array) -> Array:
    """Corners (e, 4, 2) of the elements of a grid of places."""
    return np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2).reshape(-1, 4, 2)


def _areas(corners: Array) -> Array:
    """Signed areas of quadrilaterals (e, 4, 2)."""
    a, b = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    return np.asarray(0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))


def _joined(corners: Array, tolerance: float) -> tuple[Array, Integers]:
    """Points (n, 2) and elements (e, 4) of quadrilaterals whose corners coincide."""
    places = corners.reshape(-1, 2)
    first = np.arange(len(places))
    pairs = cKDTree(places).query_pairs(tolerance, output_type="ndarray")
    np.minimum.at(first, pairs.max(axis=1), pairs.min(axis=1))
    kept, cells = np.unique(first, return_inverse=True)
    return places[kept], cells.reshape(-1, 4).astype(np.int64)
