"""Meshes of PneuNets: a row of thin chambers on a layer, joined by a channel in it; upright from z = 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.errors import ModelError
from soro_design.fem.elements.mesh import make_mesh
from soro_design.fem.meshes.rod import Rod


@dataclass(frozen=True)
class PneunetShape:
    """A bending actuator of chambers on a layer, towards +x of it; each has four walls and a roof.

    Attributes
    ----------
    chambers : int
        Number of chambers.
    pitch_m, gap_m : float
        From one chamber to the next, and the air between them [m].
    height_m, width_m : float
        Of the whole, along x and y [m].
    wall_m, layer_m : float
        Thickness of walls and roofs, and of the layer below the air [m].
    channel_m : float
        Height and width of the channel from chamber to chamber [m].
    end_m : float
        Length of the solid part at each end [m].
    """

    chambers: int
    pitch_m: float
    gap_m: float
    height_m: float
    width_m: float
    wall_m: float
    layer_m: float
    channel_m: float
    end_m: float

    def __post_init__(self) -> None:
        inner_width = self.width_m - 2.0 * self.wall_m
        most_gap = self.pitch_m - 2.0 * self.wall_m
        most_channel = min(inner_width, self.height_m - self.layer_m - 2.0 * self.wall_m)
        rules = {
            "chambers": (1 <= self.chambers <= 50, "1 to 50"),
            "wall_m": (self.wall_m > 0.0, "above 0"),
            "layer_m": (self.layer_m > 0.0, "above 0"),
            "end_m": (self.end_m > 0.0, "above 0"),
            "gap_m": (0.0 < self.gap_m < most_gap, f"above 0, below pitch_m less two walls, {most_gap:g}"),
            "channel_m": (
                0.0 < self.channel_m < most_channel,
                f"above 0, below width_m less two walls and height_m less all layers, {most_channel:g}",
            ),
            "height_m": (np.isfinite(self.height_m), "a finite number"),
            "width_m": (np.isfinite(self.width_m), "a finite number"),
            "pitch_m": (np.isfinite(self.pitch_m), "a finite number"),
        }
        for key, (is_kept, allowed) in rules.items():
            if not is_kept:
                raise ModelError(f"{key} {getattr(self, key)}; allowed: {allowed}", key)

    @property
    def length_m(self) -> float:
        """Of the whole [m]."""
        return self.chambers * self.pitch_m - self.gap_m + 2.0 * self.end_m

    @property
    def chamber_area_m2(self) -> float:
        """Of the air across the axis [m2]."""
        return (self.height_m - self.layer_m - self.wall_m) * (self.width_m - 2.0 * self.wall_m)


def pneunet_mesh(shape: PneunetShape, across: int = 1, between: int = 2) -> Rod:
    """Return the mesh of a PneuNet: bricks between planes, of which some are air.

    Its axis, x = y = 0, lies in the middle of the layer, which nothing but the channel weakens: its sections
    are those of the layer.

    Parameters
    ----------
    shape : PneunetShape
    across : int
        Number of elements across a wall, the layer, the channel and a gap.
    between : int
        Number of elements between the walls, in each direction; up the chambers twice as many.
    """
    thin, wide = across, between
    inner = shape.pitch_m - shape.gap_m - 2.0 * shape.wall_m
    side = 0.5 * (shape.width_m - shape.channel_m) - shape.wall_m
    up = shape.height_m - shape.layer_m - shape.channel_m - 2.0 * shape.wall_m
    # Name, length and number of elements of the bricks in each direction.
    row = [("wall", shape.wall_m, thin), ("air", inner, wide), ("wall", shape.wall_m, thin)]
    rows = row + (shape.chambers - 1) * [("gap", shape.gap_m, thin), *row]
    bricks = (
        [
            ("layer", shape.layer_m, thin),
            ("channel", shape.channel_m, thin),
            ("lid", shape.wall_m, thin),  # of the channel in a gap
            ("up", up, 2 * wide),
            ("roof", shape.wall_m, thin),
        ],
        [
            ("wall", shape.wall_m, thin),
            ("side", side, wide),
            ("middle", shape.channel_m, wide),
            ("side", side, wide),
            ("wall", shape.wall_m, thin),
        ],
        [("end", shape.end_m, thin), *rows, ("end", shape.end_m, thin)],
    )
    planes, names = [], []
    for direction in bricks:
        steps = np.concatenate([np.full(count, length / count) for _, length, count in direction])
        planes.append(np.concatenate([[0.0], np.cumsum(steps)]))
        names.append(np.repeat([name for name, _, _ in direction], [count for *_, count in direction]))
    planes[0] -= 0.5 * shape.layer_m
    planes[1] -= 0.5 * shape.width_m
    level, lateral, along = np.meshgrid(*names, indexing="ij")
    is_inside = (along == "air") & (lateral != "wall") & ~np.isin(level, ("layer", "roof"))
    is_tunnel = (level == "channel") & (lateral == "middle") & (along != "end")
    is_air = is_inside | is_tunnel
    is_outside = np.isin(along, ("end", "gap")) & np.isin(level, ("up", "roof"))

    number = np.arange(np.prod([len(one) for one in planes])).reshape([len(one) for one in planes])
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    nx, ny, nz = is_air.shape
    bottom = [(i, j, k) for k in (0, 1) for i, j in corners]
    cells = np.stack([number[i : i + nx, j : j + ny, k : k + nz] for i, j, k in bottom], axis=-1)
    used, numbered = np.unique(cells[~is_air & ~is_outside], return_inverse=True)
    points = np.stack(np.meshgrid(*planes, indexing="ij"), axis=-1).reshape(-1, 3)[used]
    mesh = make_mesh("hex8", "solid", points, numbered.reshape(-1, 8))
    chamber = mesh.faces_at(np.isin(used, cells[is_air]))
    layer = number[: thin + 1].transpose(2, 0, 1).reshape(len(planes[2]), -1)
    sections = np.searchsorted(used, layer)
    edges = [np.diff(one, prepend=one[0], append=one[-1]) for one in (planes[0][: thin + 1], planes[1])]
    share = np.outer(*(0.5 * (one[1:] + one[:-1]) for one in edges)).ravel()
    base, tip = (np.flatnonzero(points[:, 2] == plane) for plane in (planes[2][0], planes[2][-1]))
    return Rod(mesh, sections, share, base, tip, (chamber,), np.empty((0, 2), dtype=np.int64), np.empty(0))
