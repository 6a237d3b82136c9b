"""Regions and goals of tasks of topology optimisation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from soro_core.config import Strict, with_changes
from soro_design.fem.elements.material import Material, load_material, material_from_dict

Positive = Annotated[float, Field(gt=0.0)]
Share = Annotated[float, Field(gt=0.0, lt=1.0)]
Pair = Annotated[tuple[float, float], Field(strict=False)]
# Of a rectangle two numbers, of a box three.
Vector = Annotated[tuple[float, ...], Field(strict=False, min_length=2, max_length=3)]


class Box(Strict):
    """A rectangle, of a solid a box; a side that is left out is that of the whole grid."""

    kind: Literal["box"]
    x_m: Annotated[Pair | None, Field(description="from and to")] = None
    y_m: Annotated[Pair | None, Field(description="from and to")] = None
    z_m: Annotated[Pair | None, Field(description="from and to, of a solid")] = None


class Disc(Strict):
    """What lies within a radius of a point; of a solid a ball."""

    kind: Literal["disc"]
    centre_m: Annotated[Vector, Field(description="the point")]
    radius_m: Positive


Region = Annotated[Box | Disc, Field(discriminator="kind")]
Regions = Annotated[tuple[Region, ...], Field(strict=False)]


def one_or_more(value: object) -> object:
    """Return a region as a list of one."""
    if isinstance(value, Mapping | Box | Disc):
        return (value,)
    if not isinstance(value, list | tuple) or not value:
        raise ValueError("a region, or a list of them")
    return tuple(value)


class Stiffest(Strict):
    """The least work of the pressure on a linear part in plane stress."""

    kind: Literal["stiffest"]
    youngs_modulus_pa: Annotated[float, Field(gt=0.0, description="of the material")]
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5, description="of the material")]


class Stiffening(Strict):
    """A second material: the law of the first one, so many times as stiff."""

    times: Annotated[float, Field(gt=1.0, le=1000.0, description="its stiffness over that of the first")]
    volume_fraction: Annotated[Share, Field(description="greatest share of the volume that it may fill")]


class Farthest(Strict):
    """The greatest motion of a patch against a spring, for its energy: least -u_out / SE^m."""

    kind: Literal["farthest"]
    material: Annotated[
        str | dict[str, Any],
        Field(description="a file of config/materials, a path, or the keys of such a file"),
    ]
    poisson_ratio: Annotated[
        float | None, Field(ge=0.0, lt=0.5, description="in place of that of the material")
    ] = None
    output: Annotated[
        tuple[Box, ...],
        BeforeValidator(one_or_more),
        Field(min_length=1, description="nodes whose mean motion counts; a region, or a list of them"),
    ]
    direction: Annotated[Vector | None, Field(description="wanted; its length plays no part")] = None
    about_m: Annotated[
        Pair | None,
        Field(
            description="in place of direction: a point to turn about, to the left; counted along tangents"
        ),
    ] = None
    spring_pa: Annotated[
        float,
        Field(
            ge=0.0, description="[N/m2] spring per thickness; of a ring or solid that of the whole, in N/m"
        ),
    ]
    energy_exponent: Annotated[float, Field(ge=0.0, le=1.0, description="m: the greater, the stiffer")] = 0.6

    stiff: Annotated[
        Stiffening | None, Field(description="a second, stiffer material, which the iterations place")
    ] = None

    @model_validator(mode="after")
    def _has_a_direction(self) -> Farthest:
        if (self.direction is None) == (self.about_m is None):
            raise ValueError("either direction or about_m")
        return self

    @field_validator("direction")
    @classmethod
    def _leads_somewhere(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None and not any(value):
            raise ValueError("one that is not zero")
        return value

    @field_validator("material", mode="before")
    @classmethod
    def _name_or_keys(cls, value: object) -> object:
        if not isinstance(value, str | Mapping):
            raise ValueError("the name or file of a material, or its keys")
        return value

    def law(self, where: str) -> Material:
        """Return the material; `where` is named in errors."""
        found = self._material(where)
        if self.poisson_ratio is None:
            return found
        return material_from_dict({**found.model_dump(), "poisson_ratio": self.poisson_ratio}, where)

    def _material(self, where: str) -> Material:
        if isinstance(self.material, str):
            return load_material(self.material)
        return material_from_dict(self.material, where)

    def with_keys_of_material(self, where: str) -> Farthest:
        """Return the goal with the keys of its material in place of a name or file."""
        return with_changes(self, material=self._material(where).model_dump(mode="json"))
