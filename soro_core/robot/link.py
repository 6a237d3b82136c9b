"""What a link is: strains, stiffness, losses; frozen and checked. SI units throughout."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator

from soro_core.config import Floats, Strict
from soro_core.robot.chamber import Chamber
from soro_core.robot.strain import DEFAULT_STRAINS, STRAINS, StrainField, coordinate_names
from soro_core.robot.vectors import Vector3

# Elongation at which a link has collapsed, where its file names none: a hundredth of its length is left.
LEAST_ELONGATION = -0.99


# Densities [kg/m^3] of a material, from a light foam to a heavy metal.
LIGHTEST, DENSEST = 20.0, 20e3


class Material(Strict):
    """Linear elastic, linear viscous material of a solid round section, docs/model.md (16), (20)."""

    youngs_modulus: float = Field(gt=0, description="Pa")
    shear_modulus: float = Field(gt=0, description="Pa")
    viscosity: float = Field(0.0, ge=0, description="Pa s")
    shear_factor: float = Field(1.0, gt=0, le=2, description="alpha in alpha G A")
    shear_correction: bool | None = Field(
        None,
        description="one factor on EI for the shear left out; default: where the shear strains are left out",
    )


class Creep(Strict):
    """One Maxwell branch a coordinate: lambda' = -lambda/tau - qd, force -stiffness * lambda on the left."""

    tau: Annotated[Floats, BeforeValidator(lambda v: _one_or_more(v))] = Field(
        description="relaxation time [s]: one a coordinate, or one for all"
    )
    stiffness: Floats = Field(
        description="one a coordinate, in units of the generalised force over the coordinate"
    )

    @field_validator("tau")
    @classmethod
    def _tau(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        return _all(value, lambda x: x > 0, "relaxation times above 0 s")

    @field_validator("stiffness")
    @classmethod
    def _stiffness(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        return _all(value, lambda x: x >= 0, "stiffnesses of 0 or more")


class Hysteresis(Strict):
    """One Dahl element a coordinate: z' = qd - |qd| z / range, force stiffness * z on the left [D68]."""

    stiffness: Floats = Field(
        description="one a coordinate, in units of the generalised force over the coordinate"
    )
    range: Floats = Field(description="one a coordinate, in units of the coordinate")

    @field_validator("stiffness")
    @classmethod
    def _stiffness(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        return _all(value, lambda x: x >= 0, "stiffnesses of 0 or more")

    @field_validator("range")
    @classmethod
    def _range(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        return _all(value, lambda x: x > 0, "ranges above 0")


class Link(Strict):
    """One link, of round solid section, with a field for each strain that it carries."""

    length: float = Field(gt=0, description="undeformed length [m]")
    radius: float = Field(gt=0, description="radius of the section [m]")
    density: float | None = Field(None, gt=0, description="[kg/m^3], instead of mass")
    mass: float = Field(0.0, ge=0, description="[kg]", validate_default=True)
    strains: dict[str, StrainField] = Field(
        default_factory=lambda: dict.fromkeys(DEFAULT_STRAINS, StrainField()),
        description="the strains that are carried, in the order of the coordinates",
    )
    material: Material | None = Field(
        None, description="elastic and viscous constants, instead of k_e and k_b"
    )
    k_e: Vector3 | None = Field(
        None, description="a1, a2 [N/m], a3 [1/m] of the axial law", validate_default=True
    )
    k_b: Vector3 | None = Field(
        None, description="a4, a5 [N m/rad], a6 [1/rad] of the bending law", validate_default=True
    )
    least_elongation: float | None = Field(
        None,
        ge=LEAST_ELONGATION,
        lt=0,
        description="elongation at which its walls or coils touch: towards it compression stiffens beyond all"
        " bounds, docs/model.md (52); default: it does not",
    )
    damping: Floats | None = Field(
        None, description="viscous damping of each coordinate, added to that of the material; default 0"
    )
    creep: Annotated[tuple[Creep, ...], Field(strict=False)] = ()
    hysteresis: Annotated[tuple[Hysteresis, ...], Field(strict=False)] = ()
    chambers: Annotated[tuple[Chamber, ...], Field(strict=False)] = ()

    @field_validator("mass", mode="before")
    @classmethod
    def _mass(cls, value: Any, info: ValidationInfo) -> Any:
        """Mass from density, where that is given; the density is kept for the record (see `_resolved`)."""
        data = info.data
        if "density" not in data:
            return value
        if data["density"] is not None and "length" in data and "radius" in data:
            volume = math.pi * data["radius"] ** 2 * data["length"]
            from_density = data["density"] * volume
            # A described robot that is read back carries both, equal.
            if value not in (0.0, None) and value != from_density:
                raise ValueError("either mass or density, not both")
            return from_density
        return value

    @field_validator("mass")
    @classmethod
    def _massive(cls, value: float) -> float:
        if value <= 0:
            raise ValueError("mass [kg] or density [kg/m^3] above 0")
        return value

    @field_validator("strains", mode="before")
    @classmethod
    def _strains(cls, value: Any) -> Any:
        if not isinstance(value, Mapping) or not value or not all(name in STRAINS for name in value):
            raise ValueError(f"a mapping with at least one of {', '.join(STRAINS)}")
        return value

    @field_validator("k_e")
    @classmethod
    def _axial(cls, value: tuple[float, ...] | None, info: ValidationInfo) -> tuple[float, ...] | None:
        return _law(value, info, "a1 > a2 and a1 > 0, so that the axial stiffness is positive at rest")

    @field_validator("k_b")
    @classmethod
    def _bending(cls, value: tuple[float, ...] | None, info: ValidationInfo) -> tuple[float, ...] | None:
        return _law(value, info, "a4 > a5 and a4 > 0, so that the bending stiffness is positive at rest")

    @field_validator("least_elongation")
    @classmethod
    def _least(cls, value: float | None, info: ValidationInfo) -> float | None:
        data = info.data
        if value is not None and (
            data.get("material") or "elongation" not in data.get("strains", DEFAULT_STRAINS)
        ):
            raise ValueError("none with a material, and none where elongation is not carried")
        return value

    @field_validator("damping")
    @classmethod
    def _damping(cls, value: tuple[float, ...] | None, info: ValidationInfo) -> tuple[float, ...] | None:
        if value is not None and "strains" in info.data:
            names = coordinate_names(info.data["strains"])
            if len(value) != len(names) or min(value, default=0.0) < 0:
                raise ValueError(f"{len(names)} values of 0 or more, one for each of {', '.join(names)}")
        return value

    @field_validator("creep", "hysteresis")
    @classmethod
    def _branches(cls, value: tuple[Any, ...], info: ValidationInfo) -> tuple[Any, ...]:
        names = coordinate_names(info.data.get("strains", {}))
        n = len(names)
        for branch in value:
            for key, entry in branch:
                if n and len(entry) != n and not (key == "tau" and len(entry) == 1):
                    raise ValueError(f"{key} with {n} values, one for each of {', '.join(names)}")
        return value

    @field_validator("hysteresis")
    @classmethod
    def _uniform(cls, value: tuple[Hysteresis, ...], info: ValidationInfo) -> tuple[Hysteresis, ...]:
        """Each piece of a link slips by its own strain: no element on a coefficient adds up to that."""
        fields: Mapping[str, StrainField] = info.data.get("strains", {})
        varying = {name for name, field in fields.items() if not field.is_uniform}
        of = [name for name, field in fields.items() for _ in range(field.size)]
        for element in value:
            for name, stiffness in zip(of, element.stiffness, strict=False):
                if name in varying and stiffness > 0.0:
                    raise ValueError(f"stiffness 0 for {name}: hysteresis acts on constant strain only")
        return value

    @property
    def n_q(self) -> int:
        """Number of coordinates."""
        return sum(field.size for field in self.strains.values())

    @property
    def varies(self) -> bool:
        """Whether a strain can vary along it."""
        return any(field.varies for field in self.strains.values())

    @property
    def splits(self) -> bool:
        """Whether parts of it can have the shape functions of all its strains."""
        return all(field.shape_functions.splits for field in self.strains.values())

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates, in order: ``bending_x`` of a constant field, else ``bending_x_0``, ..."""
        return coordinate_names(self.strains)


def _one_or_more(value: Any) -> Any:
    return (value,) if isinstance(value, int | float) and not isinstance(value, bool) else value


def _all(values: tuple[float, ...], good: Any, allowed: str) -> tuple[float, ...]:
    if not values or not all(good(value) for value in values):
        raise ValueError(allowed)
    return values


def _law(value: tuple[float, ...] | None, info: ValidationInfo, allowed: str) -> tuple[float, ...] | None:
    """Check one of k_e, k_b against the material, the strains and the sign of the stiffness."""
    data = info.data
    if "material" not in data or "strains" not in data:
        return value
    if data["material"] is not None:
        if value is not None:
            raise ValueError("either material, or k_e and k_b")
        return value
    odd = [name for name in data["strains"] if name in ("torsion", "shear_x", "shear_y")]
    if odd:
        raise ValueError(f"a material instead of k_e and k_b where {odd[0]} is carried")
    if value is None:
        raise ValueError("three values, or a material")
    if not (value[0] > value[1] and value[0] > 0):
        raise ValueError(allowed)
    return value
