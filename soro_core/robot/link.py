"""What a link is: strains, stiffness, losses; frozen and checked. SI units throughout."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator

from soro_core.config import Floats, Strict
from soro_core.robot.chamber import Chamber
from soro_core.robot.strain import DEFAULT_STRAINS, STRAINS, StrainField, coordinate_names
from soro_core.robot.vectors import Vector2, Vector3

# Elongation at which a link has collapsed, where its file names none: a hundredth of its length is left.
LEAST_ELONGATION = -0.99
# Of a link's length: round-off of the place of a section.
CLOSE = 1e-9


# Densities [kg/m^3] of a material, from a light foam to a heavy metal.
LIGHTEST, DENSEST = 20.0, 20e3
# Length [m] and mass [kg] of a link that no soft arm has: they tell mm from m, and g from kg.
LONGEST, HEAVIEST = 10.0, 100.0


class Material(Strict):
    """Linear elastic, linear viscous material of a solid round section, docs/model.md (16), (20)."""

    youngs_modulus: float = Field(gt=0, description="Young's modulus [Pa]")
    shear_modulus: float = Field(
        gt=0,
        description="shear modulus [Pa]: youngs_modulus / (2 + 2 Poisson's ratio),"
        " of rubber youngs_modulus / 3",
    )
    viscosity: float = Field(0.0, ge=0, description="of stretching [Pa s]")
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


class LinkSection(Strict):
    """What a link is at one place, docs/model_terms.md; from place to place each value changes linearly."""

    place: float = Field(ge=0, description="metres of undeformed length from the base of the link")
    radius: float | None = Field(None, gt=0, description="radius of the section [m]")
    mass_per_m: float | None = Field(None, gt=0, description="[kg/m], instead of mass or density of the link")
    stiffness: float | None = Field(
        None, gt=0, description="factor on the moduli of the material, or on k_e and k_b; default 1"
    )
    rest_curvature_per_m: Vector2 | None = Field(None, description="as of the link, at this place")
    rest_torsion_per_m: float | None = Field(None, description="as of the link, at this place")


class Link(Strict):
    """One link, of round solid section, with a field for each strain that it carries."""

    length: float = Field(gt=0, description="undeformed length [m]")
    sections: Annotated[tuple[LinkSection, ...], Field(strict=False)] = Field(
        (), description="values that change along the link, at two or more places from 0 to its length"
    )
    radius: float = Field(
        0.0,
        gt=0,
        description="radius of the section [m]; where sections give it, the largest",
        validate_default=True,
    )
    rest_curvature_per_m: Vector2 | None = Field(
        None, description="bending_x, bending_y at rest [1/m], where q is 0; default straight"
    )
    rest_torsion_per_m: float | None = Field(None, description="torsion at rest [rad/m]; default 0")
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
    creep: Annotated[tuple[Creep, ...], Field(strict=False)] = Field(
        (), description="branches of slow deformation under a constant force"
    )
    hysteresis: Annotated[tuple[Hysteresis, ...], Field(strict=False)] = Field(
        (), description="branches of a force that depends on the way"
    )
    chambers: Annotated[tuple[Chamber, ...], Field(strict=False)] = Field(
        (), description="chambers along it, in the order of the pressures"
    )

    @field_validator("sections")
    @classmethod
    def _places(cls, value: tuple[LinkSection, ...], info: ValidationInfo) -> tuple[LinkSection, ...]:
        if not value or "length" not in info.data:
            return value
        places, length = [row.place for row in value], info.data["length"]
        reaches = places[0] == 0.0 and abs(places[-1] - length) <= CLOSE * length
        if not (reaches and all(a < b for a, b in pairwise(places))):
            raise ValueError(f"two or more places that grow from 0 to the length of the link, {length:.6g} m")
        given = [{key for key, entry in row if entry is not None} for row in value]
        if any(keys != given[0] for keys in given) or len(given[0]) == 1:
            raise ValueError("one or more values besides the place, the same ones in each of them")
        return value

    @field_validator("radius", mode="before")
    @classmethod
    def _radius(cls, value: Any, info: ValidationInfo) -> Any:
        radii = _column(info, "radius")
        # A described robot that is read back carries both, equal.
        if radii and value not in (0.0, max(radii)):
            raise ValueError("either one radius, or that of each of the sections")
        if not radii and value == 0.0:
            raise ValueError("a radius [m] greater than 0, here or in each of the sections")
        return max(radii) if radii else value

    @field_validator("rest_curvature_per_m", "rest_torsion_per_m")
    @classmethod
    def _rest(cls, value: Any, info: ValidationInfo) -> Any:
        if value is not None and _column(info, str(info.field_name)):
            raise ValueError("either of the link, or of each of the sections")
        return value

    @field_validator("mass", mode="before")
    @classmethod
    def _mass(cls, value: Any, info: ValidationInfo) -> Any:
        """Mass from density or sections, where these give it; the density is kept for the record."""
        data = info.data
        if "density" not in data or not {"length", "sections", "radius"} <= data.keys():
            return value
        each = _column(info, "mass_per_m")
        if data["density"] is not None:
            found, given = (
                data["density"] * _volume(data["length"], data["radius"], data["sections"]),
                "density",
            )
        elif each:
            found, given = _sum(data["sections"], [0.5 * (a + b) for a, b in pairwise(each)]), "mass_per_m"
        else:
            return value
        # A described robot that is read back carries both, equal.
        if value not in (0.0, None, found) or (each and given == "density"):
            other = "mass_per_m" if each and given == "density" else given
            raise ValueError(f"either {'density' if other != given else 'mass'} or {other}, not both")
        return found

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
    def volume(self) -> float:
        """Of its round outside [m^3]."""
        return _volume(self.length, self.radius, self.sections)

    @property
    def n_q(self) -> int:
        """Number of coordinates."""
        return sum(field.size for field in self.strains.values())

    @property
    def varies(self) -> bool:
        """Whether a strain can vary along it."""
        return any(field.varies for field in self.strains.values())

    @property
    def varies_at_rest(self) -> bool:
        """Whether the strain at rest varies along it."""
        keys = ("rest_curvature_per_m", "rest_torsion_per_m")
        return any(getattr(row, key) is not None for row in self.sections for key in keys)

    @property
    def splits(self) -> bool:
        """Whether parts of it can have the shape functions of all its strains."""
        return all(field.shape_functions.splits for field in self.strains.values())

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates, in order: ``bending_x`` of a constant field, else ``bending_x_0``, ..."""
        return coordinate_names(self.strains)


def _column(info: ValidationInfo, key: str) -> list[Any]:
    """Values of a key of the sections; empty where they do not have it, or are refused."""
    values = [getattr(row, key) for row in info.data.get("sections", ())]
    return [] if None in values else values


def _sum(rows: tuple[LinkSection, ...], means: list[float]) -> float:
    """Integral along a link of what has these means between its sections."""
    return sum((b.place - a.place) * mean for (a, b), mean in zip(pairwise(rows), means, strict=True))


def _volume(length: float, radius: float, rows: tuple[LinkSection, ...]) -> float:
    radii = [row.radius for row in rows if row.radius is not None]
    if not radii:
        return math.pi * radius**2 * length
    return math.pi * _sum(rows, [(a * a + a * b + b * b) / 3.0 for a, b in pairwise(radii)])


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
