"""Nonlinear finite elements of soft parts: materials, meshes, loads and equilibrium (docs/design.md)."""

from soro_core.fem.backbone import section_poses, section_strains
from soro_core.fem.bellows import Bellows, bellows_mesh
from soro_core.fem.blocks import block, mapped, revolved_tube, sphere, tube
from soro_core.fem.fibres import Fibres, fibres, pieces_of
from soro_core.fem.loads import Loads, Pressure, no_loads, spread_spring, traction
from soro_core.fem.material import (
    Hyperelastic,
    SaintVenant,
    drucker_modulus,
    first_unstable,
    load_material,
    material_from_dict,
    nominal_stress,
)
from soro_core.fem.mesh import Mesh, make_mesh
from soro_core.fem.newton import Settings, Solution, State, solve
from soro_core.fem.part import Balance, Part, make_part
from soro_core.fem.rod import Rod, RodCounts, RodShape, rod_mesh
from soro_core.fem.vtu import write_vtu

__all__ = [
    "Balance",
    "Bellows",
    "Fibres",
    "Hyperelastic",
    "Loads",
    "Mesh",
    "Part",
    "Pressure",
    "Rod",
    "RodCounts",
    "RodShape",
    "SaintVenant",
    "Settings",
    "Solution",
    "State",
    "bellows_mesh",
    "block",
    "drucker_modulus",
    "fibres",
    "first_unstable",
    "load_material",
    "make_mesh",
    "make_part",
    "mapped",
    "material_from_dict",
    "no_loads",
    "nominal_stress",
    "pieces_of",
    "revolved_tube",
    "rod_mesh",
    "section_poses",
    "section_strains",
    "solve",
    "sphere",
    "spread_spring",
    "traction",
    "tube",
    "write_vtu",
]
