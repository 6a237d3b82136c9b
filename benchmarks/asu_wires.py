"""Draw wires of the ASU arm against the distances of its plates: whether a tracker had moved on some day."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.report import table
from soro_core.arrays import Array

# By the authors of the recordings: a metre of wire is 5 V. Two wires run to the middle plate, two to the tip.
_M_PER_V = 0.2


def wires(files: list[Path]) -> str:
    """Return a table of runs: by how much the wires of each segment are longer than it, beside all runs."""
    found = {file.stem: _longer(file) for file in files}
    usual = np.median([row[:2] for row in found.values()], axis=0)
    rows = [
        [name, *(f"{1e3 * (row[k] - usual[k]):+.1f} ({1e3 * row[2 + k]:.1f})" for k in (0, 1))]
        for name, row in found.items()
    ]
    off = 1e3 * np.max(np.abs([row[:2] - usual for row in found.values()]), axis=0)
    return (
        "Draw wires, an independent witness of the plates: length of the wires of a segment minus the "
        "distance of its plates, less what it is in the median run "
        f"({1e3 * usual[0]:.1f} and {1e3 * usual[1]:.1f} mm, "
        "where the wires begin and end); median of the run in mm, in brackets its deviation. Largest: "
        f"{off[0]:.1f} and {off[1]:.1f} mm.\n\n"
    ) + table(("run", "segment 0", "segment 1"), rows)


def _longer(file: Path) -> Array:
    """Return the medians (2,) of wire minus plates [m] of both segments, and their deviations (2,)."""
    data = np.genfromtxt(file, delimiter=",", names=True)
    plates = [np.column_stack([data[f"rb{k}_{axis}"] for axis in "xyz"]) for k in (1, 2, 3)]
    seen = np.all([data[f"rb{k}_qok"] == 1.0 for k in (1, 2, 3)], axis=0)
    wire = [_M_PER_V * 0.5 * (data[f"enc{k}_V"] + data[f"enc{k + 1}_V"]) for k in (1, 3)]
    upper = wire[0] - np.linalg.norm(plates[1] - plates[0], axis=1)
    lower = wire[1] - wire[0] - np.linalg.norm(plates[2] - plates[1], axis=1)
    both = np.column_stack([upper, lower])[seen]
    return np.concatenate([np.nanmedian(both, axis=0), np.nanstd(both, axis=0)])
