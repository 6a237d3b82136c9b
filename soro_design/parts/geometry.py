"""The geometry of a part file: what each kind of part is made of, frozen and checked."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Field, field_validator

from soro_core.config import Strict
from soro_design.fem.elements.mesh import Space
from soro_design.fem.meshes.bellows import Bellows
from soro_design.fem.meshes.pneunet import PneunetShape
from soro_design.fem.meshes.rod import RodCounts, RodShape
from soro_design.parts.mesh_geometry import MeshGeometry

Positive = Annotated[float, Field(gt=0.0)]
Count = Annotated[int, Field(ge=1)]


class Hoops(Strict):
    """Fibres wound around the chambers, as rings."""

    stiffness_n: Annotated[float, Field(ge=0.0, description="EA of the fibre [N]")]
    spacing_m: Annotated[float, Field(gt=0.0, description="distance between turns [m]")]


class RodGeometry(Strict):
    """A round rod with chambers (`RodShape`), of hex8, and hoops around the chambers."""

    space: ClassVar[Space] = "solid"
    kind: Literal["rod_with_chambers"]
    length_m: Annotated[float, Field(description="of the rod")]
    radius_m: Annotated[float, Field(description="of the rod")]
    chambers: Annotated[int, Field(description="the first towards x, counter-clockwise")] = 3
    chamber_radius_m: Annotated[float, Field(description="of a chamber")]
    chamber_offset_m: Annotated[float, Field(description="of the axis of a chamber from that of the rod")]
    plug_m: Annotated[float, Field(description="length of the solid part at each end")]
    taper: Annotated[float, Field(description="size of the section at the tip over that at the base")] = 1.0
    hoops: Annotated[Hoops | None, Field(description="default: none")] = None
    around: Annotated[int, Field(description="elements around a quarter of a chamber")] = 4
    across: Annotated[int, Field(description="elements across a wall")] = 2
    along: Annotated[int, Field(description="elements along the chambers")] = 18
    plug: Annotated[int, Field(description="elements along a plug")] = 1

    @property
    def shape(self) -> RodShape:
        """The rod."""
        return RodShape(
            self.length_m,
            self.radius_m,
            self.chambers,
            self.chamber_radius_m,
            self.chamber_offset_m,
            self.plug_m,
            self.taper,
        )

    @property
    def counts(self) -> RodCounts:
        """Its elements."""
        return RodCounts(self.around, self.across, self.along, self.plug)

    @property
    def least_wall_m(self) -> float:
        """Least thickness of a wall or a plug [m]."""
        between = 2.0 * (self.chamber_offset_m * math.sin(math.pi / self.chambers) - self.chamber_radius_m)
        outside = self.radius_m - self.chamber_offset_m - self.chamber_radius_m
        return min(min(1.0, self.taper) * min(between, outside), self.plug_m)


class PneunetGeometry(Strict):
    """A bending actuator of chambers on a layer (`PneunetShape`), of hex8, upright, chambers towards x.

    x = y = 0 is in the middle of the layer, z = 0 at the base.
    """

    space: ClassVar[Space] = "solid"
    kind: Literal["pneunet"]
    chambers: Annotated[int, Field(description="1 to 50, of one pressure")]
    pitch_m: Annotated[float, Field(description="from one chamber to the next")]
    gap_m: Annotated[float, Field(description="air between two chambers")]
    height_m: Annotated[float, Field(description="of the whole, along x")]
    width_m: Annotated[float, Field(description="of the whole, along y")]
    wall_m: Annotated[float, Field(description="thickness of walls and roofs")]
    layer_m: Annotated[float, Field(description="thickness of the layer below the air")]
    channel_m: Annotated[float, Field(description="height and width of the channel between chambers")]
    end_m: Annotated[float, Field(description="length of the solid part at each end")]
    across: Annotated[Count, Field(description="elements across walls, layer, channel and gaps")] = 1
    between: Annotated[Count, Field(description="elements between walls, up a chamber twice as many")] = 2

    @property
    def shape(self) -> PneunetShape:
        """The PneuNet."""
        keys = (field.name for field in fields(PneunetShape))
        return PneunetShape(**{key: getattr(self, key) for key in keys})

    @property
    def least_wall_m(self) -> float:
        """Least thickness of a wall, the layer or an end [m]."""
        return min(self.wall_m, self.layer_m, self.end_m)


class BellowsGeometry(Strict):
    """Bellows about an axis (`Bellows`), whose ends keep their planes."""

    space: ClassVar[Space] = "axisymmetric"
    kind: Literal["bellows"]
    lobes: Annotated[int, Field(description="1 or more")]
    pitch_m: Annotated[float, Field(description="length of a lobe with its neck")]
    lobe_width_m: Annotated[float, Field(description="length of a lobe alone")]
    outer_radius_m: Annotated[float, Field(description="greatest radius of the outline")]
    neck_radius_m: Annotated[float, Field(description="least radius of the outline")]
    fillet_m: Annotated[float, Field(description="radius at the outer edges of a lobe")]
    wall_m: Annotated[float, Field(description="thickness, laid inwards")]
    end_m: Annotated[float, Field(description="length of a tube as wide as a neck at each end")] = 0.0
    element: Annotated[Literal["quad4", "quad8"], Field(description="without middle nodes, or with")] = (
        "quad8"
    )
    across: Annotated[Count, Field(description="elements across the wall")] = 2
    along: Annotated[
        tuple[Count, Count, Count, Count],
        Field(strict=False, description="elements along half a neck, a side, a fillet, half the top"),
    ] = (4, 5, 3, 2)

    @property
    def shape(self) -> Bellows:
        """The bellows."""
        return Bellows(
            self.lobes,
            self.pitch_m,
            self.lobe_width_m,
            self.outer_radius_m,
            self.neck_radius_m,
            self.fillet_m,
            self.wall_m,
            self.end_m,
        )

    @property
    def least_wall_m(self) -> float:
        """Thickness of the wall [m]."""
        return self.wall_m


class TubeGeometry(Strict):
    """A round tube about an axis, whose ends keep their planes."""

    space: ClassVar[Space] = "axisymmetric"
    kind: Literal["tube"]
    length_m: Annotated[Positive, Field(description="along the axis")]
    inner_radius_m: Annotated[Positive, Field(description="of the wall")]
    outer_radius_m: Annotated[Positive, Field(description="of the wall, above the inner one")]
    element: Annotated[Literal["quad4", "quad8"], Field(description="without middle nodes, or with")] = (
        "quad4"
    )
    across: Annotated[Count, Field(description="elements across the wall")] = 4
    along: Annotated[Count, Field(description="elements along the axis")] = 12

    @field_validator("outer_radius_m")
    @classmethod
    def _wall(cls, value: float, info: object) -> float:
        inner = getattr(info, "data", {}).get("inner_radius_m")
        if inner is not None and not value > inner:
            raise ValueError(f"above inner_radius_m, {inner:g}")
        return value

    @property
    def least_wall_m(self) -> float:
        """Thickness of the wall [m]."""
        return self.outer_radius_m - self.inner_radius_m


StatedGeometry: TypeAlias = RodGeometry | PneunetGeometry | BellowsGeometry | TubeGeometry
Geometry = Annotated[StatedGeometry | MeshGeometry, Field(discriminator="kind")]
