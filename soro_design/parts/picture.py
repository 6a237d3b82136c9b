"""Pictures of a run: the part at the end of each sweep, and what is measured over the load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from soro_core.arrays import Array
from soro_design.fem import Mesh
from soro_design.parts.mesh_specimen import MeshSpecimen
from soro_design.parts.specimen import RodSpecimen, Specimen

# Order of the nodes of a quadrilateral or a triangle around it: corners and middles of edges in turn.
_AROUND = {4: [0, 1, 2, 3], 6: [0, 3, 1, 4, 2, 5], 8: [0, 4, 1, 5, 2, 6, 3, 7]}
MOST = 12


def draw_shapes(path: Path, shapes: Mapping[str, tuple[Specimen, Array]]) -> None:
    """Draw deformed parts, as at the ends of sweeps, at most 12, coloured by how far their points have moved.

    Obstacles of a section are black lines, where they are near it.

    Parameters
    ----------
    path : Path
        PNG.
    shapes : mapping of str to tuple of Specimen and ndarray, (n, d)
        Parts and their displacements [m] by title.
    """
    shown = list(shapes.items())[:MOST]
    columns = min(len(shown), 4)
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(2.6 * columns, 3.4 * rows), layout="constrained")
    for k, (name, (specimen, u)) in enumerate(shown):
        axes = figure.add_subplot(rows, columns, k + 1, aspect="equal")
        faces, far = _solid_faces(specimen, u) if u.shape[1] == 3 else section_faces(specimen.part.mesh, u)
        drawn = PolyCollection(list(1e3 * faces), array=1e3 * far, cmap="viridis", lw=0.15, edgecolor="white")
        axes.add_collection(drawn)
        axes.autoscale_view()
        obstacles = LineCollection(list(1e3 * obstacle_lines(specimen)), color="black", lw=1.0)
        axes.add_collection(obstacles, autolim=False)
        axes.set_title(name, fontsize=9)
        axes.tick_params(labelsize=7)
        figure.colorbar(drawn, ax=axes, shrink=0.5, label="mm").ax.tick_params(labelsize=7)
    figure.savefig(path, dpi=110)


def draw_curves(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Draw every measured number but the energy over the load factor, a line for each sweep.

    Parameters
    ----------
    path : Path
        PNG.
    rows : sequence of mapping
        Of the table of a run.
    """
    first = list(rows[0])
    stated = ("sweep", "load", "energy_j")
    names = [
        n
        for n in first
        if n not in stated and not n.startswith(("pressure_", "force_x", "force_y", "force_z"))
    ]
    figure = Figure(figsize=(9.0, 2.6 * (-(-len(names) // 3))), layout="constrained")
    for k, name in enumerate(names):
        axes = figure.add_subplot(-(-len(names) // 3), 3, k + 1)
        for sweep in dict.fromkeys(row["sweep"] for row in rows):
            own = [row for row in rows if row["sweep"] == sweep]
            axes.plot([row["load"] for row in own], [row[name] for row in own], ".-", label=sweep)
        axes.set_xlabel("load factor", fontsize=8)
        axes.set_ylabel(name, fontsize=8)
        axes.tick_params(labelsize=7)
        axes.grid(alpha=0.3)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize=7)
    figure.savefig(path, dpi=110)


def obstacle_lines(specimen: Specimen) -> Array:
    """Return the obstacles of a section (l, 2, 2) [m], about an axis on both sides; none of a solid."""
    mesh, contact = specimen.part.mesh, specimen.part.contact
    if contact is None or mesh.space == "solid":
        return np.empty((0, 2, 2))
    lines = np.concatenate([np.empty((0, 2, 2)), *(one.points[one.pieces] for one in contact.obstacles)])
    return np.concatenate([lines, lines * [-1.0, 1.0]]) if mesh.space == "axisymmetric" else lines


def _solid_faces(specimen: Specimen, u: Array) -> tuple[Array, Array]:
    """Outside of a solid seen across the plane of its bend, far faces first; (f, m, 2) and (f,)."""
    mesh = specimen.part.mesh
    pressed, end = [], np.arange(len(mesh.points))
    if isinstance(specimen, RodSpecimen):
        pressed, end = list(specimen.rod.chambers), specimen.rod.tip
    elif isinstance(specimen, MeshSpecimen):
        pressed, end = [faces for faces, is_open in specimen.pressed if not is_open], specimen.watched
    inside = {tuple(sorted(face)) for faces in pressed for face in faces.tolist()}
    faces = np.array([face for face in mesh.boundary().tolist() if tuple(sorted(face)) not in inside])
    faces = faces[:, _AROUND[faces.shape[1]]]
    moved = u[end].mean(axis=0)
    side = np.array([moved[0], moved[1], 0.0])
    length = float(np.linalg.norm(side))
    side = side / length if length > 1e-6 * np.ptp(mesh.points) else np.array([1.0, 0.0, 0.0])
    places = (mesh.points + u)[faces]
    depth = places.mean(axis=1) @ np.cross(side, [0.0, 0.0, 1.0])
    order = np.argsort(-depth)
    seen = np.stack([places @ side, places[:, :, 2]], axis=2)
    return seen[order], np.linalg.norm(u[faces].mean(axis=1), axis=1)[order]


def section_faces(mesh: Mesh, u: Array) -> tuple[Array, Array]:
    """Return the deformed elements of a section, about an axis both sides, and how far they have moved.

    Parameters
    ----------
    mesh : Mesh
        The section, of e elements with m nodes each.
    u : ndarray, (n, 2)
        Displacements [m].

    Returns
    -------
    faces : ndarray, (e or 2 e, m, 2)
        Corners [m], in order.
    far : ndarray, (e or 2 e,)
        Length of the mean displacement of an element [m].
    """
    around = mesh.cells[:, _AROUND[mesh.cells.shape[1]]]
    right = (mesh.points + u)[around]
    far = np.linalg.norm(u[around].mean(axis=1), axis=1)
    if mesh.space == "plane_strain":
        return right, far
    return np.concatenate([right, right * [-1.0, 1.0]]), np.concatenate([far, far])
