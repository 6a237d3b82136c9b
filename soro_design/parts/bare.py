"""The part of a mesh and of a part file before any load: its material, its contact, its tendons."""

from __future__ import annotations

from soro_core.errors import ConfigError, ModelError
from soro_design.fem.elements.mesh import Mesh
from soro_design.fem.loads import Loads
from soro_design.fem.part import Part, make_part
from soro_design.parts.file import PartFile, material_of
from soro_design.parts.tendons import Routed, route


def bare_part(file: PartFile, mesh: Mesh, loads: Loads) -> tuple[Part, tuple[Routed, ...]]:
    """Return the part of a mesh with the material and the contact of its file, and its tendons.

    Parameters
    ----------
    file : PartFile
    mesh : Mesh
    loads : Loads
        What is held in all sweeps.

    Raises
    ------
    ConfigError
        If a tendon leaves the mesh, or surfaces are nearer than contact allows before any load.
    MissingPackageError
        If there is contact, and ipctk is not installed.
    """
    tendons = []
    for i, tendon in enumerate(file.tendons):
        try:
            tendons.append((route(mesh, tendon.along_m), tendon.stiffness_n))
        except ModelError as error:
            got, _, allowed = str(error).partition("; allowed: ")
            raise ConfigError(file.name, f"tendons[{i}].along_m", got, allowed) from None
    contact = None if file.contact is None else file.contact.contact
    try:
        return make_part(mesh, material_of(file), loads, contact=contact), tuple(tendons)
    except ModelError as error:
        if error.key != "distance_m" or contact is None:
            raise
        why = str(error).partition(": ")[2].partition("; allowed: ")[0]
        allowed = f"less, because {why}"
        raise ConfigError(file.name, "contact.distance_m", contact.distance_m, allowed) from None
