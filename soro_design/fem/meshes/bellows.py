"""Meshes of axisymmetric bellows: a wall of one thickness laid inwards from an outline of round lobes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_design.fem.elements.mesh import Mesh
from soro_design.fem.meshes.blocks import mapped


@dataclass(frozen=True)
class Bellows:
    """Outer outline and wall of a bellows; each end is the bottom of a neck, or a tube from there.

    Parameters
    ----------
    lobes : int
        Number of lobes.
    pitch, lobe_width : float
        Length of a lobe with its neck, and of the lobe alone [m]; a neck is a half circle between lobes.
    outer_radius, neck_radius : float
        Greatest and least radius of the outline [m].
    fillet : float
        Radius at the outer edges of a lobe [m].
    wall : float
        Thickness, laid inwards [m]; below the fillet.
    end : float
        Length of a tube of the least radius at each end [m].

    Raises
    ------
    ModelError
        If the outline would cross itself, or the wall fills a fillet.
    """

    lobes: int
    pitch: float
    lobe_width: float
    outer_radius: float
    neck_radius: float
    fillet: float
    wall: float
    end: float = 0.0

    def __post_init__(self) -> None:
        least = self.neck_radius + self.neck + self.fillet
        rules = {
            "lobes": (self.lobes >= 1, "1 or more"),
            "pitch": (0.0 < self.pitch < np.inf, "above 0"),
            "fillet": (0.0 < self.fillet < np.inf, "above 0"),
            "lobe_width": (
                2.0 * self.fillet < self.lobe_width < self.pitch,
                f"above two fillets, {2.0 * self.fillet:g}, and below the pitch, {self.pitch:g}",
            ),
            "wall": (0.0 < self.wall < self.fillet, f"above 0, below the fillet, {self.fillet:g}"),
            "neck_radius": (
                self.wall < self.neck_radius < np.inf,
                f"above the wall, {self.wall:g}, which lies inside",
            ),
            "outer_radius": (
                least < self.outer_radius < np.inf,
                f"above neck_radius + (pitch - lobe_width) / 2 + fillet, {least:g}",
            ),
            "end": (0.0 <= self.end < np.inf, "0 or more"),
        }
        for key, (is_kept, allowed) in rules.items():
            if not is_kept:
                raise ModelError(f"{key} {getattr(self, key)}; allowed: {allowed}", key)

    @property
    def neck(self) -> float:
        """Radius of the half circle between two lobes [m]."""
        return 0.5 * (self.pitch - self.lobe_width)

    @property
    def length(self) -> float:
        """Of the whole [m]."""
        return self.lobes * self.pitch + 2.0 * self.end

    def outline(self, piece: Array) -> tuple[Array, Array]:
        """Return places (n, 2) and normals into the wall (n, 2) from the bottom of a neck to half a lobe.

        `piece` (n,) is 0 to 1 along the neck, to 2 along the side, to 3 along the fillet, to 4 on the top.
        """
        part = np.minimum(np.floor(piece), 3.0)
        share = piece - part
        c, s = np.cos(0.5 * np.pi * share), np.sin(0.5 * np.pi * share)
        zero, one = np.zeros_like(share), np.ones_like(share)
        inner, outer = self.neck_radius + self.neck, self.outer_radius - self.fillet
        edge = self.neck + self.fillet
        r = (
            inner - self.neck * c,
            inner + (outer - inner) * share,
            outer + self.fillet * s,
            self.outer_radius * one,
        )
        z = (self.neck * s, self.neck * one, edge - self.fillet * c, edge + (0.5 * self.pitch - edge) * share)
        normal_r, normal_z = (-c, zero, -s, -one), (s, one, c, zero)

        def pick(of: tuple[Array, ...]) -> Array:
            return np.choose(part.astype(int), of)

        return np.stack([pick(r), pick(z)], axis=1), np.stack([pick(normal_r), pick(normal_z)], axis=1)


def bellows_mesh(
    kind: str,
    shape: Bellows,
    across: int = 2,
    along: tuple[int, int, int, int] = (4, 5, 3, 2),
    lobes: float = 0.0,
) -> Mesh:
    """Return the mesh of a bellows, axisymmetric from z = 0.

    Parameters
    ----------
    kind : str
        quad4 or quad8.
    shape : Bellows
        The outline.
    across : int
        Number of elements across the wall.
    along : tuple of int
        Number of elements along half a neck, a side, a fillet, and half the top of a lobe.
        Those of the ends are about as long as those of a neck.
    lobes : float
        Of the outline, in halves, after the end at z = 0; by default, 0, all, and the other end.

    Raises
    ------
    ModelError
        If `lobes` is no number of halves up to those of the shape, or the counts make no mesh.
    """
    halves = round(2.0 * (lobes or shape.lobes)) if np.isfinite(lobes) else 0
    if not (1 <= halves <= 2 * shape.lobes) or (lobes and 2.0 * lobes != halves):
        raise ModelError(f"lobes {lobes}; allowed: halves from 0.5 to {shape.lobes}, or 0 for all", "lobes")
    if min(along) < 1:
        raise ModelError(f"along {along}; allowed: 1 element or more on each piece", "along")
    each = sum(along)
    ends = np.concatenate([[0.0], np.cumsum(along)])
    tube = int(np.ceil(shape.end / (0.5 * np.pi * shape.neck / along[0])))
    count = tube + halves * each + (0 if lobes else tube)

    def place(unit: Array) -> Array:
        # Counted in elements: below 0 in the first end, beyond the lobes in the last.
        along_all = unit[:, 1] * count - tube
        at = np.clip(along_all, 0.0, halves * each)
        half = np.minimum(np.floor(at / each), halves - 1.0)
        rest = at - half * each
        # Every other half runs back from the top of its lobe.
        is_back = half % 2 == 1
        point, normal = shape.outline(np.interp(np.where(is_back, each - rest, rest), ends, np.arange(5.0)))
        point = point + shape.wall * (1.0 - unit[:, :1]) * normal
        base = 0.5 * shape.pitch * (half + is_back)
        z = np.where(is_back, base - point[:, 1], base + point[:, 1])
        z = z + shape.end * (1.0 + (along_all - at) / max(tube, 1))
        return np.stack([point[:, 0], z], axis=1)

    return mapped(kind, "axisymmetric", (across, count), place)
