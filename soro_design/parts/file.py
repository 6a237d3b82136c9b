"""Part files: geometry, mesh, material and sweeps of a part, frozen and checked; SI units."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, field_validator

from soro_core.config import Floats, Strict, find_config, parse, read_yaml, with_changes
from soro_core.errors import ConfigError, ModelError
from soro_core.robot.vectors import Quaternion
from soro_design.fem.contact import Contact, Obstacle
from soro_design.fem.elements.material import Hyperelastic, Material, load_material
from soro_design.fem.elements.mesh import Space
from soro_design.parts.geometry import Geometry, PneunetGeometry, RodGeometry, TubeGeometry
from soro_design.parts.mesh_geometry import AXES, MeshGeometry, Region
from soro_design.parts.tendons import PartTendon


class RigidPlane(Strict):
    """A rigid plane that does not move; of a section, a line."""

    through_m: Annotated[Floats, Field(description="its middle; of a section two numbers, else three")]
    normal: Annotated[Floats, Field(description="across it, of any length")]
    size_m: Annotated[float, Field(gt=0.0, description="length of its edges")]

    @field_validator("normal")
    @classmethod
    def _direction(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not any(value):
            raise ValueError("numbers that are not all 0")
        return value

    def obstacle(self) -> Obstacle:
        """Return it as a line or as two triangles."""
        middle, normal = np.array(self.through_m), np.array(self.normal)
        # The rows behind the first are at right angles to the normal.
        across = 0.5 * self.size_m * np.linalg.svd(normal[None])[2][1:]
        if len(middle) == 2:
            return Obstacle(middle + np.array([-across[0], across[0]]), np.array([[0, 1]]))
        corners = [a * across[0] + b * across[1] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return Obstacle(middle + corners, np.array([[0, 1, 2], [0, 2, 3]]))


class ContactKeys(Strict):
    """Contact of surfaces with each other and with planes (extra `design`)."""

    distance_m: Annotated[
        float, Field(gt=0.0, description="at which surfaces begin to push; well below walls and elements")
    ]
    stiffness_pa: Annotated[
        float | None, Field(gt=0.0, description="of the barrier; default: the shear modulus")
    ] = None
    planes: Annotated[tuple[RigidPlane, ...], Field(strict=False, description="that the part may meet")] = ()

    @property
    def contact(self) -> Contact:
        """For `make_part`."""
        return Contact(self.distance_m, self.stiffness_pa, tuple(plane.obstacle() for plane in self.planes))


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
        tuple[PartTendon, ...], Field(strict=False, description="of a rod or of a solid mesh")
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
        part = with_changes(part, geometry=part.geometry.beside(path))
    check_part(part, where)
    return part


def material_of(part: PartFile) -> Material:
    """Return the material of a part file, with its ratio of moduli: nu = (3 K/mu - 2) / (2 (3 K/mu + 1))."""
    material = load_material(part.material)
    if part.bulk_over_shear is None:
        return material
    ratio = part.bulk_over_shear
    return with_changes(material, poisson_ratio=(3.0 * ratio - 2.0) / (2.0 * (3.0 * ratio + 1.0)))


if TYPE_CHECKING:
    from soro_design.parts.file import LoadSweep, PartFile


def check_part(part: PartFile, where: str) -> None:
    """Refuse a part file that breaks a rule across its keys.

    Parameters
    ----------
    part : PartFile
        The part.
    where : str
        Its file.

    Raises
    ------
    ConfigError
        One line with file, key, what was found and what is allowed.
    """
    geometry = part.geometry
    if isinstance(geometry, MeshGeometry):
        _check_mesh(geometry, where)
    else:
        _check_shape(geometry, where)
    space = geometry.space
    if part.tendons and (space != "solid" or isinstance(geometry, PneunetGeometry)):
        raise ConfigError(where, "tendons", len(part.tendons), "none of a section: of a rod or a solid mesh")
    for i, plane in enumerate(part.contact.planes if part.contact is not None else ()):
        for key in ("through_m", "normal"):
            if len(getattr(plane, key)) != len(AXES[space]):
                got, allowed = list(getattr(plane, key)), f"{len(AXES[space])} numbers, {space}"
                raise ConfigError(where, f"contact.planes[{i}].{key}", got, allowed)
    for i, sweep in enumerate(part.sweeps):
        _check_sweep(sweep, part, where, f"sweeps[{i}]")
    if part.bulk_over_shear is not None and not isinstance(load_material(part.material), Hyperelastic):
        allowed = f"none with {part.material}, which is St. Venant-Kirchhoff"
        raise ConfigError(where, "bulk_over_shear", part.bulk_over_shear, allowed)


def _check_shape(geometry: Geometry, where: str) -> None:
    try:
        if not isinstance(geometry, TubeGeometry | MeshGeometry):
            _ = geometry.shape
        if isinstance(geometry, RodGeometry):
            _ = geometry.counts
    except ModelError as error:
        key = error.key if error.key in type(geometry).model_fields else f"{error.key}_m"
        allowed = str(error).split("allowed: ")[-1]
        raise ConfigError(where, f"geometry.{key}", getattr(geometry, key), allowed) from None


def _check_mesh(geometry: MeshGeometry, where: str) -> None:
    if not Path(geometry.file).is_file():
        raise ConfigError(where, "geometry.file", geometry.file, "a file that exists, beside the part file")
    if (geometry.is_step or geometry.is_surface) and geometry.largest_m is None:
        allowed = "the greatest edge of a tetrahedron [m]; a STEP or STL file needs it"
        raise ConfigError(where, "geometry.largest_m", None, allowed)
    if geometry.is_step and geometry.space != "solid":
        raise ConfigError(where, "geometry.space", geometry.space, "solid; a STEP file is one")
    for key, name in geometry.named().items():
        if name not in geometry.regions:
            allowed = f"a region: {', '.join(geometry.regions) or 'none is stated'}"
            raise ConfigError(where, f"geometry.{key}", name, allowed)
    axes = AXES[geometry.space]
    for name, region in geometry.regions.items():
        _check_surface(region, geometry.space, where, f"geometry.regions.{name}")
    for key, directions in geometry.directions().items():
        if set(directions) - set(axes):
            allowed = f"{' and '.join(axes)} alone, {geometry.space}"
            raise ConfigError(where, f"geometry.{key}", directions, allowed)


def _check_surface(region: Region, space: Space, where: str, key: str) -> None:
    """Of what a region states about closed surfaces."""
    if region.around_m is not None and len(region.around_m) != len(AXES[space]):
        allowed = f"{len(AXES[space])} numbers, {space}"
        raise ConfigError(where, f"{key}.around_m", list(region.around_m), allowed)
    if region.stl and space != "solid":
        raise ConfigError(where, f"{key}.stl", region.stl, f"none of a section: {space}")
    if region.stl and not Path(region.stl).is_file():
        raise ConfigError(where, f"{key}.stl", region.stl, "a file that exists, beside the part file")


def _check_sweep(sweep: LoadSweep, part: PartFile, where: str, key: str) -> None:
    geometry = part.geometry
    chambers = 1
    if isinstance(geometry, RodGeometry):
        chambers = geometry.chambers
    elif isinstance(geometry, MeshGeometry):
        chambers = len(geometry.pressed)
    for name, values, count in (
        ("pressures_pa", sweep.pressures_pa, chambers),
        ("tensions_n", sweep.tensions_n, len(part.tendons)),
    ):
        if len(values) not in (0, count):
            allowed = f"{count} of this part, or none"
            raise ConfigError(where, f"{key}.{name}", list(values), allowed)
    if any(sweep.force_n):
        _check_force(sweep, geometry, where, f"{key}.force_n")
    if sweep.extension_m and isinstance(geometry, RodGeometry | PneunetGeometry):
        allowed = "0 of a rod or a PneuNet: state force_n"
        raise ConfigError(where, f"{key}.extension_m", sweep.extension_m, allowed)
    if sweep.extension_m and isinstance(geometry, MeshGeometry) and geometry.moved is None:
        allowed = "0 where geometry.moved is not stated"
        raise ConfigError(where, f"{key}.extension_m", sweep.extension_m, allowed)
    if not (any(sweep.pressures_pa) or any(sweep.force_n) or any(sweep.tensions_n) or sweep.extension_m):
        raise ConfigError(where, key, "no load", "pressures_pa, force_n, tensions_n or extension_m")


def _check_force(sweep: LoadSweep, geometry: Geometry, where: str, key: str) -> None:
    """Of a force that is not 0."""
    if isinstance(geometry, RodGeometry | PneunetGeometry):
        return
    allowed = "0 of a part about an axis: state extension_m, the force is computed"
    if isinstance(geometry, MeshGeometry):
        if geometry.forced and (geometry.space == "solid" or not sweep.force_n[2]):
            return
        allowed = "0 along z of a section" if geometry.forced else "0 where geometry.forced is not stated"
    raise ConfigError(where, key, list(sweep.force_n), allowed)
