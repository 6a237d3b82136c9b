"""`soro design export` of a part file: its solid as STEP, the surface of its mesh as STL."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from soro_core.errors import ConfigError, ModelError

if TYPE_CHECKING:
    from soro_core.arrays import Array, Integers


def export_part(source: str, stl: Path | None, step: Path | None, pieces: int) -> None:
    """Write the files that are asked for, and print a line of each.

    Parameters
    ----------
    source : str
        Part file, or the name of a shipped one.
    stl, step : Path or None
        Files to write.
    pieces : int
        Flat pieces of a revolution, of the STL file.

    Raises
    ------
    ConfigError
        If none is asked for, there is no such part, or it has no such solid.
    ModelError
        If a file cannot be written.
    """
    from soro_core.config import find_config
    from soro_design.fem.meshes.surface import revolved, solid_surface
    from soro_design.parts.file import load_part
    from soro_design.parts.geometry import PneunetGeometry
    from soro_design.parts.mesh_geometry import MeshGeometry
    from soro_design.parts.specimen import make_specimen
    from soro_design.parts.step import write_step

    if stl is None and step is None:
        raise ConfigError("soro design export", "", source, "--step FILE or --stl FILE of a part file")
    try:
        path = find_config(source, "parts")
    except ConfigError as error:
        raise ConfigError("soro design export", "", source, f"a folder of a run, {error.allowed}") from None
    file = load_part(path)
    if step is not None:
        if isinstance(file.geometry, MeshGeometry | PneunetGeometry):
            allowed = "a rod, bellows or a tube, for --step"
            raise ConfigError(str(path), "geometry.kind", file.geometry.kind, allowed)
        typer.echo(f"{step}: a solid of {1e9 * write_step(step, file.geometry):.6g} mm3")
    if stl is not None:
        mesh = make_specimen(file).part.mesh
        if mesh.space == "plane_strain":
            raise ConfigError(str(path), "geometry.space", mesh.space, "solid or axisymmetric, for --stl")
        write_surfaces({stl: solid_surface(mesh) if mesh.space == "solid" else revolved(mesh, pieces)})


def write_surfaces(surfaces: dict[Path, tuple[Array, Integers]]) -> None:
    """Write surfaces that close, and print a line of each.

    Parameters
    ----------
    surfaces : dict
        Of each file the corners (n, 3) [m] and triangles (t, 3), turned outwards.

    Raises
    ------
    ModelError
        If a surface has open edges (then none is written), or a file cannot be written.
    """
    from soro_design.fem import write_stl
    from soro_design.fem.meshes.surface import is_closed, volume

    for stl, (_, triangles) in surfaces.items():
        if not is_closed(triangles):
            raise ModelError(f"the surface of {stl} has open edges: no solid to export", "stl")
    for stl, (points, triangles) in surfaces.items():
        write_stl(stl, points, triangles)
        size = f"{1e9 * volume(points, triangles):.6g} mm3"
        typer.echo(f"{stl}: {len(triangles)} triangles, {size}, watertight")
