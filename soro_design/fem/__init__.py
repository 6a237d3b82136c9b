"""Nonlinear finite elements of soft parts: materials, meshes, loads and equilibrium (docs/design.md)."""

from soro_design.fem.backbone import section_poses, section_strains
from soro_design.fem.contact import Contact, Obstacle
from soro_design.fem.elements.fibres import Fibres, fibres, pieces_of
from soro_design.fem.elements.material import (
    Hyperelastic,
    SaintVenant,
    drucker_modulus,
    first_unstable,
    load_material,
    material_from_dict,
    nominal_stress,
)
from soro_design.fem.elements.mesh import Mesh, make_mesh
from soro_design.fem.loads import Loads, Pressure, no_loads, spread_spring, traction
from soro_design.fem.meshes.bellows import Bellows, bellows_mesh
from soro_design.fem.meshes.blocks import block, mapped, revolved_tube, sphere, tube
from soro_design.fem.meshes.hexahedra import extruded_mesh, revolved_mesh
from soro_design.fem.meshes.mesh_files import MeshFile, mesh_step, mesh_stl, read_mesh, write_mesh
from soro_design.fem.meshes.rod import Rod, RodCounts, RodShape, rod_mesh
from soro_design.fem.meshes.stl import read_stl, write_stl
from soro_design.fem.meshes.surface import extruded, revolved, solid_surface
from soro_design.fem.meshes.vtu import write_pvd, write_vtu
from soro_design.fem.part import Balance, Part, make_part
from soro_design.fem.solve.arc import follow
from soro_design.fem.solve.dynamics import DynamicsResult, Moving, march
from soro_design.fem.solve.mass import VibrationModes, modes
from soro_design.fem.solve.newton import solve
from soro_design.fem.solve.states import EquilibriumState, LoadSolution, SolverSettings
from soro_design.fem.stress import Strained, strained

__all__ = [
    "Balance",
    "Bellows",
    "Contact",
    "DynamicsResult",
    "EquilibriumState",
    "Fibres",
    "Hyperelastic",
    "LoadSolution",
    "Loads",
    "Mesh",
    "MeshFile",
    "Moving",
    "Obstacle",
    "Part",
    "Pressure",
    "Rod",
    "RodCounts",
    "RodShape",
    "SaintVenant",
    "SolverSettings",
    "Strained",
    "VibrationModes",
    "bellows_mesh",
    "block",
    "drucker_modulus",
    "extruded",
    "extruded_mesh",
    "fibres",
    "first_unstable",
    "follow",
    "load_material",
    "make_mesh",
    "make_part",
    "mapped",
    "march",
    "material_from_dict",
    "mesh_step",
    "mesh_stl",
    "modes",
    "no_loads",
    "nominal_stress",
    "pieces_of",
    "read_mesh",
    "read_stl",
    "revolved",
    "revolved_mesh",
    "revolved_tube",
    "rod_mesh",
    "section_poses",
    "section_strains",
    "solid_surface",
    "solve",
    "sphere",
    "spread_spring",
    "strained",
    "traction",
    "tube",
    "write_mesh",
    "write_pvd",
    "write_stl",
    "write_vtu",
]
