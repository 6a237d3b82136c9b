"""Pictures of a run of topology optimisation: the iterations as a film, the final part as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

from soro_core.arrays import Array
from soro_design.topology.check import FinalPart, Reanalysis
from soro_design.topology.domain import Domain
from soro_design.topology.state import TONES, OptimiserState

WIDTH_PIXELS = 480
GREYS = 32
FRAME_MS, LAST_MS = 120, 2000


def whole(domain: Domain, values: Array) -> Array:
    """Return values of elements (e,) as rows from the top, with the mirror images; of a box at z = 0."""
    rows = domain.grid.as_rows(values)
    if "x" in domain.task.mirrors:
        rows = np.hstack([rows[:, ::-1], rows])
    if "y" in domain.task.mirrors:
        rows = np.vstack([rows[::-1], rows])
    return rows[::-1]


def film(domain: Domain, state: OptimiserState, path: Path) -> None:
    """Write the densities of all iterations as a GIF.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    state : State
        After the last iteration.
    path : Path
        GIF to write.
    """
    first = whole(domain, state.frames[0])
    edge = domain.grid.edge_m
    height = round(WIDTH_PIXELS * first.shape[0] * edge[1] / (first.shape[1] * edge[0]))
    pictures = [
        Image.fromarray(TONES - whole(domain, frame))
        .resize((WIDTH_PIXELS, height), Image.Resampling.NEAREST)
        .quantize(GREYS)
        for frame in state.frames
    ]
    lasts = [FRAME_MS] * (len(pictures) - 1) + [LAST_MS]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=lasts, loop=0)


def picture(
    domain: Domain, state: OptimiserState, found: FinalPart | None, moved: Reanalysis | None, path: Path
) -> None:
    """Draw densities, pressures, the course of the goal, and the final part at rest and under pressure.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    state : State
        After the last iteration.
    found : FinalPart or None
        The final part, if there is one.
    moved : Reanalysis or None
        How it moves, if the goal is a motion.
    path : Path
        PNG to write.
    """
    figure = Figure(figsize=(13.0, 7.0), layout="constrained")
    is_solid = domain.task.space == "solid"
    top = [figure.add_subplot(2, 3, k) for k in (1, 2, 3)]
    kind = {"projection": "3d"} if is_solid else {}
    bottom = [figure.add_subplot(2, 3, k, **kind) for k in (4, 5, 6)]
    x, y = (1e3 * side for side in domain.task.size_m[:2])
    extent = (0.0, x, 0.0, y)
    rows = domain.grid.as_rows(state.density)
    top[0].imshow(rows, origin="lower", extent=extent, cmap="gray_r", vmin=0.0, vmax=1.0)
    where, second = ", at z = 0" if is_solid else "", ""
    if len(state.stiff):
        stiff = domain.grid.as_rows(state.stiff * state.density)
        top[0].imshow(stiff, origin="lower", extent=extent, cmap="Oranges", vmin=0.0, vmax=1.5, alpha=stiff)
        second = ", stiffer material orange"
    top[0].set_title(f"density{where}{second}")
    counts = [count + 1 for count in domain.grid.counts]
    air = 1e-3 * state.pressure.reshape(*counts[:2], -1)[:, :, 0].T
    shown = top[1].imshow(air, origin="lower", extent=extent, cmap="viridis")
    figure.colorbar(shown, ax=top[1], label="kPa", shrink=0.7)
    top[1].set_title(f"pressure{where}")
    iterations = [row.iteration for row in state.rows]
    top[2].plot(iterations, [row.objective / abs(state.rows[-1].objective) for row in state.rows])
    top[2].set(title="goal, of the last", xlabel="iteration")
    other = top[2].twinx()
    other.plot(iterations, [row.greyness for row in state.rows], color="tab:gray", ls="--")
    other.set_ylabel("greyness (dashed)")
    for axes, u, title in zip(
        bottom,
        (0.0, moved.u if moved else None, moved.free_u if moved else None),
        ("part: wet red, open blue", "under pressure, with spring", "under pressure, without spring"),
        strict=True,
    ):
        if found is None or u is None:
            axes.axis("off")
            continue
        axes.set_title(title)
        _solid(axes, domain, found, u) if is_solid else _part(axes, found, u)
    for axes in (top[0], top[1], *bottom):
        axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    figure.savefig(path, dpi=90)


def _solid(axes: Any, domain: Domain, found: FinalPart, u: Array | float) -> None:
    """Draw the faces of a solid, seen from its planes of symmetry: what is inside is open to the view."""
    mesh = found.mesh
    kinds = ((found.wet, "tab:red"), (found.outer, "tab:blue"), (mesh.boundary(), "0.75"))
    at = 1e3 * (mesh.points + u)
    drawn: set[tuple[int, ...]] = set()
    for faces, colour in kinds:
        rest = [face for face in faces[:, :3].tolist() if tuple(sorted(face)) not in drawn]
        drawn |= {tuple(sorted(face)) for face in rest}
        shown = Poly3DCollection(
            list(at[np.array(rest, dtype=int).reshape(-1, 3)]), shade=True, facecolors=colour
        )
        axes.add_collection3d(shown)
    low, high = np.zeros(3), 1.4e3 * np.array(domain.task.size_m)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]), zlabel="z [mm]")
    axes.view_init(elev=-25.0, azim=-120.0)


def _part(axes: Any, found: FinalPart, u: Array | float) -> None:
    at = 1e3 * (found.mesh.points + u)
    colours = "0.75" if found.is_stiff is None else np.where(found.is_stiff, "tab:orange", "0.75")
    axes.add_collection(
        PolyCollection(list(at[found.mesh.cells]), facecolor=colours, edgecolor="face", lw=0.3)
    )
    for faces, colour in ((found.wet, "tab:red"), (found.outer, "tab:blue")):
        axes.add_collection(LineCollection(list(at[faces]), color=colour, lw=1.2))
    axes.autoscale_view()
