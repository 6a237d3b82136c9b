"""Draw the picture of docs/design.md: the bellows of the three-bellow part as it is pulled.

python -m docs.design_pictures [--folder docs/images]
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from soro_core.fem import Mesh, bellows_mesh, make_part, no_loads, solve
from tests.fem.three_bellow import MATERIAL, SHAPE, THESIS

SHOWN_MM = (0.0, 10.0, 20.0)


def section(axes: Any, mesh: Mesh, u: np.ndarray, shift: float) -> None:
    """Draw the deformed wall on both sides of the axis, coloured by its movement along the axis."""
    # Corners and middles of edges in turn.
    around = mesh.cells[:, [0, 4, 1, 5, 2, 6, 3, 7]]
    for side in (-1.0, 1.0):
        corners = 1e3 * (mesh.points + u)[around] * [side, 1.0] + [shift, 0.0]
        drawn = PolyCollection(corners, array=1e3 * u[mesh.cells, 1].mean(axis=1), cmap="viridis", lw=0.1)
        drawn.set_clim(0.0, 20.0)
        drawn.set_edgecolor("white")
        axes.add_collection(drawn)


def picture_of_bellows(path: Path) -> None:
    """Shape at some extensions, and force against extension beside that of the thesis."""
    mesh = bellows_mesh("quad8", SHAPE, 2, (6, 8, 4, 2))
    z = mesh.points[:, 1]
    bottom, top = z < 1e-9, z > z.max() - 1e-9
    part = make_part(mesh, MATERIAL, no_loads(mesh).hold(bottom, 1).hold(top, 1, 20e-3))
    done = solve(part, [x / 20.0 for x in np.arange(1.0, 21.0)])
    states = {20.0 * state.load: state for state in done.states}
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, x in enumerate(SHOWN_MM):
        section(left, mesh, states[x].u if x else np.zeros_like(mesh.points), 32.0 * k)
        left.text(32.0 * k, -5.0, f"{x:g} mm", ha="center")
    left.set(xlim=(-16, 80), ylim=(-8, 80), aspect="equal", xlabel="r [mm]", ylabel="z [mm]", xticks=[])
    x = np.array([0.0, *states])
    force = [0.0, *(3.0 * state.reaction[top, 1].sum() for state in states.values())]
    right.plot(x, force, label="soro_core.fem, ends free to widen")
    right.plot(list(THESIS), list(THESIS.values()), "o", color="tab:red", label="thesis")
    right.set(xlabel="extension [mm]", ylabel="force of three bellows [N]", xlim=(0, None), ylim=(0, None))
    right.grid(alpha=0.3)
    right.legend()
    figure.savefig(path, dpi=110)


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, default=Path("docs/images"))
    picture_of_bellows(parser.parse_args().folder / "design_bellows.png")


if __name__ == "__main__":
    main()
