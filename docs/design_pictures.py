"""Draw the pictures of docs/design.md: bellows, paths beyond limit points, a fold that closes, shipped tasks.

python -m docs.design_pictures [--folder docs/images] [--only disc] [--runs runs]

A task is run if the folder of runs does not hold it: minutes for each.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from soro_design.fem import Contact, Mesh, bellows_mesh, make_part, no_loads, solve
from soro_design.parts.picture import section_faces
from soro_design.topology import (
    Domain,
    OptimiserState,
    load_state,
    load_task,
    make_domain,
    optimise,
    reanalyse,
    save,
    shape,
)
from soro_design.topology.goals import Farthest
from soro_design.topology.pictures import picture
from soro_design.topology.state import STATE
from tests.soro_design.fem import moving_parts as moving
from tests.soro_design.fem.three_bellow import MATERIAL, SHAPE, THESIS

SHOWN_MM = (0.0, 10.0, 20.0)


def section(axes: Any, mesh: Mesh, u: np.ndarray, shift: float) -> None:
    """Draw the deformed wall on both sides of the axis, coloured by its movement."""
    faces, far = section_faces(mesh, u)
    drawn = PolyCollection(1e3 * faces + [shift, 0.0], array=1e3 * far, cmap="viridis", lw=0.1)
    drawn.set_clim(0.0, 20.0)
    drawn.set_edgecolor("white")
    axes.add_collection(drawn)


def picture_of_bellows(path: Path) -> None:
    """Shape at some extensions, and force against extension beside that of the thesis."""
    mesh = bellows_mesh("quad8", SHAPE, 2, (6, 8, 4, 2))
    z = mesh.points[:, 1]
    bottom, top = z < 1e-9, z > z.max() - 1e-9
    loads = no_loads(mesh).hold(bottom | top, 0).hold(bottom, 1).hold(top, 1, 20e-3)
    part = make_part(mesh, MATERIAL, loads)
    done = solve(part, [x / 20.0 for x in np.arange(1.0, 21.0)])
    states = {20.0 * state.load: state for state in done.states}
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, x in enumerate(SHOWN_MM):
        section(left, mesh, states[x].u if x else np.zeros_like(mesh.points), 32.0 * k)
        left.text(32.0 * k, -5.0, f"{x:g} mm", ha="center")
    left.set(xlim=(-16, 80), ylim=(-8, 88), aspect="equal", xlabel="r [mm]", ylabel="z [mm]", xticks=[])
    x = np.array([0.0, *states])
    force = [0.0, *(3.0 * state.reaction[top, 1].sum() for state in states.values())]
    right.plot(x, force, label="soro_design.fem, both ends clamped")
    right.plot(list(THESIS), list(THESIS.values()), "o", color="tab:red", label="thesis")
    right.set(xlabel="extension [mm]", ylabel="force of three bellows [N]", xlim=(0, None), ylim=(0, None))
    right.grid(alpha=0.3)
    right.legend()
    figure.savefig(path, dpi=110)


def picture_of_paths(path: Path) -> None:
    """Load against displacement of the balloon and of the arch, beside their closed forms."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    stretch, load = moving.inflated()
    at = np.linspace(1.0, 3.0, 400)
    left.plot(at, moving.pressure_of(at), color="tab:gray", label="closed form, incompressible")
    left.plot(stretch, load, "o", ms=4, label="steps of an arc length")
    left.set(xlabel="stretch of the inner radius", ylabel="pressure / shear modulus", ylim=(0, None))
    _, _, rise, force, peak = moving.snapped()
    at = np.linspace(moving.RISE, rise.min(), 400)
    right.plot(at / moving.RISE, moving.shallow(at) / peak, color="tab:gray", label="closed form")
    right.plot(rise / moving.RISE, force / peak, "o", ms=4, label="steps of an arc length")
    right.set(xlabel="rise of the crown / at rest", ylabel="load / limit load")
    right.invert_xaxis()
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend()
    figure.savefig(path, dpi=110)


def picture_of_fold(path: Path) -> None:
    """A fold under vacuum: at rest, with contact, and without."""
    figure = Figure(figsize=(9.0, 2.4), layout="constrained")
    free, _, part = moving.folded(None)
    kept, _, _ = moving.folded(Contact(1e-4))
    shown = {"at rest": 0.0 * free.last.u, "contact, 800 Pa": kept.last.u, "no contact, 800 Pa": free.last.u}
    for axes, (name, u) in zip(figure.subplots(1, 3, sharey=True), shown.items(), strict=True):
        corners = 1e3 * (part.mesh.points + u)[part.mesh.cells]
        drawn = PolyCollection(corners, facecolor="tab:blue", edgecolor="white", lw=0.3, alpha=0.6)
        axes.add_collection(drawn)
        axes.set(xlim=(0, 14), ylim=(-0.5, 7.5), aspect="equal", xlabel="r [mm]", title=name)
    figure.axes[0].set_ylabel("z [mm]")
    figure.savefig(path, dpi=110)


def run_of(name: str, runs: Path) -> tuple[Domain, OptimiserState]:
    """Return a shipped task with its last state, of a run that is there or of one made now."""
    task, folder = load_task(name), runs / f"{name}_design"
    domain = make_domain(task)
    if (folder / STATE).exists():
        return domain, load_state(folder, domain)
    state = optimise(task)
    folder.mkdir(parents=True, exist_ok=True)
    save(state, folder)
    return domain, state


def picture_of_task(domain: Domain, state: OptimiserState, path: Path) -> None:
    """What `soro design run` draws."""
    found = shape(domain, state)
    moved = reanalyse(domain, found) if isinstance(domain.task.goal, Farthest) else None
    picture(domain, state, found, moved, path)


PARTS = {
    "bellows": picture_of_bellows,
    "paths": picture_of_paths,
    "fold": picture_of_fold,
}
TASKS = ("arch", "bellow", "bellow_folds", "bender", "disc", "gripper", "muscle", "pneunet", "rotary")


def main() -> None:
    """Draw them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, default=Path("docs/images"))
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="where runs of tasks are, or go")
    parser.add_argument("--only", nargs="+", choices=(*PARTS, *TASKS), help="default: all")
    options = parser.parse_args()
    for name in options.only or (*PARTS, *TASKS):
        path = options.folder / f"design_{name}.png"
        if name in PARTS:
            PARTS[name](path)
            continue
        domain, state = run_of(name, options.runs)
        picture_of_task(domain, state, path)


if __name__ == "__main__":
    main()
