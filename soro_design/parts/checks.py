"""Rules of a part file across its keys: dimensions, regions, loads that a part does not take."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from soro_core.errors import ConfigError, ModelError
from soro_design.fem.elements.material import Hyperelastic, load_material
from soro_design.parts.geometry import BellowsGeometry, Geometry, RodGeometry
from soro_design.parts.mesh_geometry import AXES, MeshGeometry

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
    space = "solid" if isinstance(geometry, RodGeometry) else getattr(geometry, "space", "axisymmetric")
    if part.tendons and space != "solid":
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
        if isinstance(geometry, RodGeometry | BellowsGeometry):
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
    if geometry.is_step and geometry.largest_m is None:
        allowed = "the greatest edge of a tetrahedron [m]; a STEP file needs it"
        raise ConfigError(where, "geometry.largest_m", None, allowed)
    if geometry.is_step and geometry.space != "solid":
        raise ConfigError(where, "geometry.space", geometry.space, "solid; a STEP file is one")
    for key, name in geometry.named().items():
        if name not in geometry.regions:
            allowed = f"a region: {', '.join(geometry.regions) or 'none is stated'}"
            raise ConfigError(where, f"geometry.{key}", name, allowed)
    axes = AXES[geometry.space]
    for key, directions in geometry.directions().items():
        if set(directions) - set(axes):
            allowed = f"{' and '.join(axes)} alone, {geometry.space}"
            raise ConfigError(where, f"geometry.{key}", directions, allowed)


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
    if sweep.extension_m and isinstance(geometry, RodGeometry):
        raise ConfigError(where, f"{key}.extension_m", sweep.extension_m, "0 of a rod: state force_n")
    if sweep.extension_m and isinstance(geometry, MeshGeometry) and geometry.moved is None:
        allowed = "0 where geometry.moved is not stated"
        raise ConfigError(where, f"{key}.extension_m", sweep.extension_m, allowed)
    if not (any(sweep.pressures_pa) or any(sweep.force_n) or any(sweep.tensions_n) or sweep.extension_m):
        raise ConfigError(where, key, "no load", "pressures_pa, force_n, tensions_n or extension_m")


def _check_force(sweep: LoadSweep, geometry: Geometry, where: str, key: str) -> None:
    """Of a force that is not 0."""
    if isinstance(geometry, RodGeometry):
        return
    allowed = "0 of a part about an axis: state extension_m, the force is computed"
    if isinstance(geometry, MeshGeometry):
        if geometry.forced and (geometry.space == "solid" or not sweep.force_n[2]):
            return
        allowed = "0 along z of a section" if geometry.forced else "0 where geometry.forced is not stated"
    raise ConfigError(where, key, list(sweep.force_n), allowed)
