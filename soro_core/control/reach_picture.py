"""The picture of `soro reach`: places of the tip at rest, from the side and from above."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from soro_core.control.reachable import Reachable, shape
from soro_core.model import SoftArm


def draw(path: Path, arm: SoftArm, found: Reachable, title: str) -> None:
    """Write the picture as PNG.

    Parameters
    ----------
    path : Path
    arm : SoftArm
        Model, for the shapes at the farthest places.
    found : Reachable
    title : str
    """
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    side, above = figure.subplots(1, 2)
    mean_kpa = 1e-3 * found.pressure_pa.mean(axis=1)
    order = np.argsort(mean_kpa)
    tips = found.tip_m
    farthest = {int(k) for k in (*tips.argmin(axis=0), *tips.argmax(axis=0))}
    for axes, (i, j) in ((side, (0, 2)), (above, (0, 1))):
        for k in sorted(farthest):
            x = 1e3 * shape(arm, found.q[k])
            axes.plot(x[:, i], x[:, j], color="0.75", lw=2, zorder=1)
        dots = axes.scatter(
            1e3 * found.tip_m[order, i], 1e3 * found.tip_m[order, j], c=mean_kpa[order], s=8, zorder=2
        )
        axes.plot(1e3 * found.rest_m[i], 1e3 * found.rest_m[j], "k+", ms=10, zorder=3)
        axes.set_xlabel(f"{'xyz'[i]}, mm")
        axes.set_ylabel(f"{'xyz'[j]}, mm")
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(True, alpha=0.3)
    side.set_title("from the side; grey: shapes at the farthest places", fontsize=9)
    above.set_title("from above; +: lowest pressures", fontsize=9)
    figure.colorbar(dots, ax=above, label="mean pressure, kPa")
    figure.suptitle(title)
    figure.savefig(path, dpi=120)
