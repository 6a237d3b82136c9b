"""Part files: geometry, mesh, material and sweeps of a part, frozen and checked; SI units."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, field_validator

from soro_core.config import Strict, find_config, parse, read_yaml, with_changes
from soro_core.robot.vectors import Quaternion
from soro_design.fem.elements.material import Material, load_material
from soro_design.parts.checks import check_part
from soro_design.parts.contact import ContactKeys
from soro_design.parts.geometry import Geometry
from soro_design.parts.mesh_geometry import MeshGeometry
from soro_design.parts.tendons import Tendon


class LoadSweep(Strict):
    """Loads that rise together from nothing."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$", description="begins the names of its files")]
    pressures_pa: Annotated[
        tuple[float, ...], Field(strict=False, description="one a chamber, gauge; default: none")
    ] = ()
    force_n: Annotated[
        tuple[float, float, float],
        Field(strict=False, description="on the end face of a rod or on `forced`, of constant direction"),
    ] = (0.0, 0.0, 0.0)
    extension_m: Annotated[float, Field(description="of a tube or bellows or of `moved`, held")] = 0.0
    tensions_n: Annotated[
        tuple[Annotated[float, Field(ge=0.0)], ...],
        Field(strict=False, description="one a tendon, whatever its length; default: none"),
    ] = ()
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
    base_quaternion: Annotated[Quaternion, Field(description="of the robot file alone")] = (
        0.0,
        0.0,
        0.0,
        1.0,
    )
    contact: Annotated[
        ContactKeys | None, Field(description="of surfaces with each other and with planes; default: none")
    ] = None
    tendons: Annotated[
        tuple[Tendon, ...], Field(strict=False, description="of a rod or of a solid mesh")
    ] = ()
    sweeps: Annotated[tuple[LoadSweep, ...], Field(strict=False)]

    @field_validator("sweeps")
    @classmethod
    def _names(cls, value: tuple[LoadSweep, ...]) -> tuple[LoadSweep, ...]:
        if not value:
            raise ValueError("one sweep or more, each with a name and a load")
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
    where = str(path)
    part = parse({"name": path.stem, **read_yaml(path)}, PartFile, where)
    if isinstance(part.geometry, MeshGeometry):
        beside = path.parent / part.geometry.file
        part = with_changes(part, geometry=with_changes(part.geometry, file=str(beside.resolve())))
    check_part(part, where)
    return part


def material_of(part: PartFile) -> Material:
    """Return the material of a part file, with its ratio of moduli: nu = (3 K/mu - 2) / (2 (3 K/mu + 1))."""
    material = load_material(part.material)
    if part.bulk_over_shear is None:
        return material
    ratio = part.bulk_over_shear
    return with_changes(material, poisson_ratio=(3.0 * ratio - 2.0) / (2.0 * (3.0 * ratio + 1.0)))
