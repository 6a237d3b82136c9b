"""Solve public meshes of soft robots with cavities: where to put them, and what comes out.

    python -m benchmarks.public_meshes FOLDER [--pressure-kpa 15] [--material dragonskin_30]

FOLDER holds files of examples of SOFA's plugins SoftRobots and SoftRobots.Inverse; for what is not there a
line says from where to get it. What is held is what their scenes hold, the material is another one.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from benchmarks.report import figure, table
from soro_core.errors import SoroError
from soro_design.fem.meshes.cavities import inner_surfaces
from soro_design.parts.file import load_part
from soro_design.parts.specimen import make_specimen
from soro_design.parts.sweeps import follow

RAW = "https://raw.githubusercontent.com/SofaDefrost"
GRIPPER = "SoftRobots/{}/docs/{}tutorials/PneunetGripper/details/data/mesh/"
SPRING = "SoftRobots/ef8d2dd0c7e4b478581f3fd3149d1dd37d7996a9/docs/examples/component/controller/"
INVERSE = "SoftRobots.Inverse/3aaebeb78c659f0dc2aaac499e82b13087afd566/examples/sofapython3/component/"
BUNNY = "SoftRobots/3f303b83523299e6c1c99f0a7b059f54b463d588/python/softrobots/parts/bunny/mesh/"
# By file: where it is.
ADDRESSES = {
    "pneunetCutCoarse.vtk": GRIPPER.format("96e0b7f86016ea25fc393b89316ac3715f797c13", "sofapython3/"),
    "pneunetCut.vtk": GRIPPER.format("bbc40ddf126175d2c2d1568dfd6bfd1e99dede46", ""),
    "pneunetCavityCut.stl": GRIPPER.format("d44be782b0c982a9aed309698be6f41dd6a69204", ""),
    "PneuNets.vtk": f"{INVERSE}constraint/SurfacePressureActuator/mesh/",
    "PneuNets_Cavity.stl": f"{INVERSE}constraint/SurfacePressureActuator/mesh/",
    "Accordeon_Volumetric.vtk": f"{INVERSE}constraint/SurfacePressureEquality/GeneratedMeshes/",
    "Accordion.vtu": f"{SPRING}DataVariationLimiter/mesh/",
    "Springy.vtk": f"{SPRING}CommunicationController/mesh/",
    "Springy_Cavity.stl": BUNNY,
}


@dataclass(frozen=True)
class Case:
    """A mesh, its unit [m], the bounds [m] of what is held, and the STL of its cavity, if it has one."""

    file: str
    unit_m: float
    base: dict[str, list[float]]
    stl: str = ""

    @property
    def cavity(self) -> dict[str, Any]:
        """The region of its cavity."""
        return {"stl": self.stl} if self.stl else {"inner_surface": 1}


FINGER, SPRUNG = {"x_m": [-0.01, 0.0]}, {"z_m": [0.0, 0.005]}
CASES = (
    Case("pneunetCutCoarse.vtk", 1e-3, FINGER),
    Case("pneunetCutCoarse.vtk", 1e-3, FINGER, "pneunetCavityCut.stl"),
    Case("pneunetCut.vtk", 1e-3, FINGER),
    Case("pneunetCut.vtk", 1e-3, FINGER, "pneunetCavityCut.stl"),
    Case("PneuNets.vtk", 1e-3, FINGER),
    Case("PneuNets.vtk", 1e-3, FINGER, "PneuNets_Cavity.stl"),
    Case("Accordeon_Volumetric.vtk", 1e-3, {"y_m": [-0.004, 0.0]}),
    Case("Accordion.vtu", 1e-2, {"y_m": [0.0, 0.005]}),
    Case("Springy.vtk", 1e-2, SPRUNG),
    Case("Springy.vtk", 1e-2, SPRUNG, "Springy_Cavity.stl"),
)
HEADER = ("mesh", "cavity", "unknowns", "air [mm3]", "farthest node [mm]", "iterations", "s")


def solved(folder: Path, case: Case, pressure_pa: float, material: str) -> tuple[str, ...]:
    """Return the row of a case, or its refusal; its part file stays in the folder."""
    regions = {"base": case.base, "cavity": case.cavity}
    geometry = {"kind": "mesh", "file": case.file, "unit_m": case.unit_m, "regions": regions}
    held = {"held": [{"region": "base", "directions": "xyz"}], "pressed": [{"region": "cavity"}]}
    sweep = {"name": "blown", "pressures_pa": [pressure_pa], "states": 1}
    part = {"geometry": geometry | held, "material": material, "sweeps": [sweep]}
    path = folder / f"{Path(case.file).stem}{'_by_stl' if case.stl else ''}.yaml"
    path.write_text(yaml.safe_dump(part), encoding="utf-8")
    begin = time.perf_counter()
    try:
        file = load_part(path)
        specimen = make_specimen(file)
        done = follow(specimen, file.sweeps[0], lambda state: None)
    except SoroError as error:
        return (case.file, *case.cavity, str(error), *4 * ("",))
    air = sum(one.volume for one in inner_surfaces(specimen.part.mesh)[:1])
    seconds = time.perf_counter() - begin
    moved = (
        figure(1e3 * specimen.measured(done.last)["farthest_m"]) if done.status == "solved" else done.cause
    )
    size, volume = str(specimen.part.mesh.points.size), figure(1e9 * air, 6)
    return (case.file, *case.cavity, size, volume, moved, str(done.iterations), f"{seconds:.1f}")


def main() -> None:
    """Print a table of what is there, and addresses of what is not."""
    parser = argparse.ArgumentParser(description="Solve public meshes of soft robots with cavities.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pressure-kpa", type=float, default=15.0)
    parser.add_argument("--material", default="dragonskin_30")
    given = parser.parse_args()
    there = {name for name in ADDRESSES if (given.folder / name).is_file()}
    cases = [case for case in CASES if {case.file, case.stl} <= {*there, ""}]
    print(
        table(HEADER, [solved(given.folder, one, 1e3 * given.pressure_kpa, given.material) for one in cases])
    )
    for name, place in ADDRESSES.items():
        if name not in there:
            print(f"not in {given.folder}: {RAW}/{place}{name}")


if __name__ == "__main__":
    main()
