"""The folder of a run: a VTU file and a row of a table for each state, written as they come.

A .pvd file has the states of a sweep as a series.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_design.fem import EquilibriumState, LoadSolution
from soro_design.fem.meshes.vtu import write_pvd, write_vtu
from soro_design.fem.stress import Strained, strained
from soro_design.parts.file import LoadSweep, PartFile
from soro_design.parts.mesh_specimen import MeshSpecimen
from soro_design.parts.specimen import RodSpecimen, Specimen
from soro_design.parts.sweeps import Backbone, backbone

TABLE, BACKBONE, PART = "table.csv", "backbone.npz", "part.json"
STRETCH = "greatest_stretch"
_COLUMNS = ("sweep", "load", "pressures_pa", "force_n", "held_out", "poses")


@dataclass
class SweepFolder:
    """What a run writes, as it comes: a VTU file and a row of the table for each state.

    Attributes
    ----------
    folder : Path
        Where to.
    specimen : Specimen
        The part.
    rows : list of dict
        Of the table.
    backbones : list of Backbone
        Of a rod.
    shapes : dict of str to ndarray, (n, d)
        Last displacements of each sweep.
    """

    folder: Path
    specimen: Specimen
    rows: list[dict[str, Any]] = field(default_factory=list)
    backbones: list[Backbone] = field(default_factory=list)
    shapes: dict[str, Array] = field(default_factory=dict)

    def keep(self, sweep: LoadSweep, state: EquilibriumState) -> None:
        """Take in a state in equilibrium; one at a load of the sweep becomes files."""
        self.shapes[sweep.name] = state.u
        if state.load not in sweep.loads:
            return
        names = {load: f"{sweep.name}_{k + 1:02d}" for k, load in enumerate(sweep.loads)}
        found = self._write_shape(names[state.load], state.u)[1]
        pressures = sweep.pressures_pa or (0.0,) * self.specimen.chambers
        row: dict[str, Any] = {"sweep": sweep.name, "load": state.load}
        row |= {f"pressure_{c}_pa": state.load * p for c, p in enumerate(pressures)}
        if isinstance(self.specimen, RodSpecimen):
            row |= {f"force_{axis}_n": state.load * f for axis, f in zip("xyz", sweep.force_n, strict=True)}
            self.backbones.append(backbone(self.specimen, sweep, state))
        if isinstance(self.specimen, MeshSpecimen) and self.specimen.forced.size:
            axes = "xyz"[: self.specimen.part.mesh.points.shape[1]]
            row |= {f"force_{axis}_n": state.load * f for axis, f in zip(axes, sweep.force_n, strict=False)}
        tensions = sweep.tensions_n or (0.0,) * len(self.specimen.tendons)
        row |= {f"tension_{c}_n": state.load * t for c, t in enumerate(tensions)}
        row |= self.specimen.measured(state) | {"energy_j": state.energy, STRETCH: float(found.stretch.max())}
        self.rows.append(row)
        loads = [one["load"] for one in self.rows if one["sweep"] == sweep.name]
        write_pvd(self.folder / f"{sweep.name}.pvd", {load: f"{names[load]}.vtu" for load in loads})
        with (self.folder / TABLE).open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, list(row), restval="", lineterminator="\n")
            writer.writeheader()
            writer.writerows(self.rows)
        if self.backbones and isinstance(self.specimen, RodSpecimen):
            save_backbones(self.folder / BACKBONE, self.specimen.z, self.backbones)

    def keep_all(self, sweep: LoadSweep, found: LoadSolution) -> None:
        """Take in the states of a sweep that another process has followed."""
        for state in found.states:
            self.keep(sweep, state)
        if found.steps:
            self.shapes[sweep.name] = found.last.u

    def keep_last(self, sweep: LoadSweep) -> Path | None:
        """Write the last state of a sweep that ended early; None if it did not leave the undeformed state."""
        if sweep.name not in self.shapes:
            return None
        return self._write_shape(f"{sweep.name}_last", self.shapes[sweep.name])[0]

    def _write_shape(self, name: str, u: Array) -> tuple[Path, Strained]:
        path = self.folder / f"{name}.vtu"
        part = self.specimen.part
        found = strained(part, u)
        in_elements = {"von_mises_pa": found.von_mises_pa, "stretch": found.stretch}
        write_vtu(path, part.mesh, {"displacement": u}, in_elements)
        return path, found


def greatest_stretch(folder: Path) -> tuple[str, float]:
    """Return the greatest stretch of an element in the table of a run, and the sweep; 0 where it has none."""
    with (folder / TABLE).open(newline="", encoding="utf-8") as stream:
        rows = [(row["sweep"], float(row.get(STRETCH) or 0.0)) for row in csv.DictReader(stream)]
    return max(rows, key=lambda row: row[1], default=("", 0.0))


def save_backbones(path: Path, z: Array, backbones: list[Backbone]) -> None:
    """Write backbones as one file of arrays.

    Parameters
    ----------
    path : Path
        File to write, .npz.
    z : ndarray, (s,)
        Places of the sections [m].
    backbones : list of Backbone
    """
    columns: dict[str, Any] = {name: np.array([getattr(one, name) for one in backbones]) for name in _COLUMNS}
    np.savez_compressed(path, z=z, **columns)


def load_backbones(folder: Path, part: PartFile) -> tuple[Array, list[Backbone]]:
    """Return places of sections (s,) [m] and backbones of a folder of `soro fem run`.

    Raises
    ------
    ConfigError
        If the folder has none, is of another part, or lacks a sweep, or a file of it is damaged.
    """
    path = folder / BACKBONE
    absent = [name for name in (BACKBONE, PART) if not (folder / name).is_file()]
    if absent:
        raise ConfigError(str(folder), "", f"no {absent[0]}", "a folder that `soro fem run` made of a rod")
    try:
        kept = PartFile.model_validate_json((folder / PART).read_text(encoding="utf-8"))
    except ValueError:
        allowed = "the part file that `soro fem run` has written"
        raise ConfigError(str(folder / PART), "", "no part", allowed) from None
    if kept != part:
        raise ConfigError(
            str(folder), "", f"another part or other sweeps than {part.name}", "those of this file"
        )
    try:
        with path.open("rb") as file, np.load(file) as data:
            columns, z = [data[name] for name in _COLUMNS], np.asarray(data["z"])
    except (OSError, ValueError, KeyError, BadZipFile):
        allowed = "backbones that `soro fem run` has written to its end"
        raise ConfigError(str(path), "", "no backbones", allowed) from None
    rows = zip(*columns, strict=True)
    found = [Backbone(str(row[0]), float(row[1]), row[2], row[3], bool(row[4]), row[5]) for row in rows]
    missing = [sweep.name for sweep in part.sweeps if sweep.name not in {one.sweep for one in found}]
    if missing:
        raise ConfigError(
            str(folder), "", f"no state of sweep {missing[0]}", "a run that was not interrupted"
        )
    return z, found
