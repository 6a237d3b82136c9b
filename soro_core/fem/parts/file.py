"""Part files: geometry, mesh, material and sweeps of a part, frozen and checked; SI units."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator

from soro_core.config import Strict, changed, find_config, parse, read_yaml
from soro_core.errors import ConfigError, ModelError
from soro_core.fem.bellows import Bellows
from soro_core.fem.material import Hyperelastic, Material, load_material
from soro_core.fem.rod import RodCounts, RodShape

Positive = Annotated[float, Field(gt=0.0)]
Count = Annotated[int, Field(ge=1)]


class Hoops(Strict):
    """Fibres wound around the chambers, as rings."""

    stiffness_n: Annotated[float, Field(ge=0.0, description="EA of the fibre [N]")]
    spacing_m: Annotated[float, Field(gt=0.0, description="distance between turns [m]")]


class RodGeometry(Strict):
    """A round rod with chambers (`RodShape`), of hex8, and hoops around the chambers."""

    kind: Literal["rod_with_chambers"]
    length_m: Annotated[float, Field(description="of the rod")]
    radius_m: Annotated[float, Field(description="of the rod")]
    chambers: Annotated[int, Field(description="the first towards x, counter-clockwise")] = 3
    chamber_radius_m: Annotated[float, Field(description="of a chamber")]
    chamber_offset_m: Annotated[float, Field(description="of the axis of a chamber from that of the rod")]
    plug_m: Annotated[float, Field(description="length of the solid part at each end")]
    taper: Annotated[float, Field(description="size of the section at the tip over that at the base")] = 1.0
    hoops: Hoops | None = None
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


class BellowsGeometry(Strict):
    """Bellows about an axis (`Bellows`), whose ends keep their planes."""

    kind: Literal["bellows"]
    lobes: Annotated[int, Field(description="1 or more")]
    pitch_m: Annotated[float, Field(description="length of a lobe with its neck")]
    lobe_width_m: Annotated[float, Field(description="length of a lobe alone")]
    outer_radius_m: Annotated[float, Field(description="greatest radius of the outline")]
    neck_radius_m: Annotated[float, Field(description="least radius of the outline")]
    fillet_m: Annotated[float, Field(description="radius at the outer edges of a lobe")]
    wall_m: Annotated[float, Field(description="thickness, laid inwards")]
    end_m: Annotated[float, Field(description="length of a tube as wide as a neck at each end")] = 0.0
    element: Literal["quad4", "quad8"] = "quad8"
    across: Count = 2
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


class TubeGeometry(Strict):
    """A round tube about an axis, whose ends keep their planes."""

    kind: Literal["tube"]
    length_m: Positive
    inner_radius_m: Positive
    outer_radius_m: Positive
    element: Literal["quad4", "quad8"] = "quad4"
    across: Count = 4
    along: Count = 12

    @field_validator("outer_radius_m")
    @classmethod
    def _wall(cls, value: float, info: object) -> float:
        inner = getattr(info, "data", {}).get("inner_radius_m")
        if inner is not None and not value > inner:
            raise ValueError(f"above inner_radius_m, {inner:g}")
        return value


Geometry = Annotated[RodGeometry | BellowsGeometry | TubeGeometry, Field(discriminator="kind")]


class Sweep(Strict):
    """Loads that rise together from nothing."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$", description="begins the names of its files")]
    pressures_pa: Annotated[
        tuple[float, ...], Field(strict=False, description="one a chamber, gauge; default: none")
    ] = ()
    force_n: Annotated[
        tuple[float, float, float],
        Field(strict=False, description="on the end face of a rod, of constant direction"),
    ] = (0.0, 0.0, 0.0)
    extension_m: Annotated[float, Field(description="of a tube or bellows, held")] = 0.0
    states: Annotated[int, Field(ge=1, le=1000, description="evenly spaced states that are written")] = 8
    held_out: Annotated[bool, Field(description="of identify-fem: judges it and is not fitted")] = False

    @property
    def loads(self) -> tuple[float, ...]:
        """Load factors of its states."""
        return tuple((k + 1) / self.states for k in range(self.states))


class PartFile(Strict):
    """A part and what is done to it."""

    name: str = ""
    description: str = ""
    geometry: Geometry
    material: Annotated[str, Field(min_length=1, description="a file of config/materials, or a path")]
    bulk_over_shear: Annotated[
        float | None, Field(gt=1.0, description="K / mu, in place of the material's Poisson ratio")
    ] = None
    viscosity_pa_s: Annotated[
        float,
        Field(ge=0.0, description="[Pa s] damping of the robot file of a rod; 0: to be measured"),
    ] = 0.0
    gravity: Annotated[
        tuple[float, float, float], Field(strict=False, description="of the robot file alone")
    ] = (0.0, 0.0, -9.81)
    base_quaternion: Annotated[
        tuple[float, float, float, float], Field(strict=False, description="of the robot file alone")
    ] = (0.0, 0.0, 0.0, 1.0)
    sweeps: Annotated[tuple[Sweep, ...], Field(strict=False, min_length=1)]

    @field_validator("sweeps")
    @classmethod
    def _names(cls, value: tuple[Sweep, ...]) -> tuple[Sweep, ...]:
        names = [sweep.name for sweep in value]
        if len(set(names)) < len(names):
            raise ValueError(f"different names (here {', '.join(names)})")
        return value


def load_part(name_or_path: str | Path) -> PartFile:
    """Read a part file, or a shipped part by its name (config/parts).

    Raises
    ------
    ConfigError
        One line with file, key, what was found and what is allowed.
    """
    path = find_config(name_or_path, "parts")
    part = parse({"name": path.stem, **read_yaml(path)}, PartFile, str(path))
    _check_shape(part.geometry, str(path))
    for i, sweep in enumerate(part.sweeps):
        _check_sweep(sweep, part.geometry, str(path), f"sweeps[{i}]")
    if part.bulk_over_shear is not None and not isinstance(load_material(part.material), Hyperelastic):
        allowed = f"none with {part.material}, which is St. Venant-Kirchhoff"
        raise ConfigError(str(path), "bulk_over_shear", part.bulk_over_shear, allowed)
    return part


def _check_shape(geometry: RodGeometry | BellowsGeometry | TubeGeometry, where: str) -> None:
    try:
        if not isinstance(geometry, TubeGeometry):
            _ = geometry.shape
        if isinstance(geometry, RodGeometry):
            _ = geometry.counts
    except ModelError as error:
        key = error.key if error.key in type(geometry).model_fields else f"{error.key}_m"
        allowed = str(error).split("allowed: ")[-1]
        raise ConfigError(where, f"geometry.{key}", getattr(geometry, key), allowed) from None


def _check_sweep(
    sweep: Sweep, geometry: RodGeometry | BellowsGeometry | TubeGeometry, where: str, key: str
) -> None:
    is_rod = isinstance(geometry, RodGeometry)
    chambers = geometry.chambers if isinstance(geometry, RodGeometry) else 1
    if len(sweep.pressures_pa) not in (0, chambers):
        allowed = f"{chambers} pressures, or none"
        raise ConfigError(where, f"{key}.pressures_pa", list(sweep.pressures_pa), allowed)
    if is_rod and sweep.extension_m:
        raise ConfigError(where, f"{key}.extension_m", sweep.extension_m, "0 of a rod: state force_n")
    if not is_rod and any(sweep.force_n):
        allowed = "0 of a part about an axis: state extension_m, the force is computed"
        raise ConfigError(where, f"{key}.force_n", list(sweep.force_n), allowed)
    if not (any(sweep.pressures_pa) or any(sweep.force_n) or sweep.extension_m):
        raise ConfigError(where, key, "no load", "pressures_pa, force_n or extension_m")


def material_of(part: PartFile) -> Material:
    """Return the material of a part file, with its ratio of moduli: nu = (3 K/mu - 2) / (2 (3 K/mu + 1))."""
    material = load_material(part.material)
    if part.bulk_over_shear is None:
        return material
    ratio = part.bulk_over_shear
    return changed(material, poisson_ratio=(3.0 * ratio - 2.0) / (2.0 * (3.0 * ratio + 1.0)))
