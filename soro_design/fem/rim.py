"""Whether a pressure acts on a closed cavity: the rim of its faces and what holds it, docs/design.md (9)."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from soro_core.arrays import Integers
from soro_core.errors import ModelError
from soro_design.fem.elements.mesh import Mesh
from soro_design.fem.loads import Loads
from soro_design.fem.meshes.surface import edges_of

# A rim whose tangent leaves a plane of symmetry by less than this share lies in it.
LEVEL = 1e-6


def check_closed(mesh: Mesh, loads: Loads) -> None:
    """Refuse a pressure whose faces neither close nor end at a rim that is held.

    The work of a follower pressure depends on the way, and its stiffness is not symmetric, unless
    (du x dv) . t = 0 on the rim with tangent t, for all motions du, dv that the supports allow.

    Raises
    ------
    ModelError
        One line that says which pressure, where its rim is open, and what to do.
    """
    sides = [one for one in loads.pressures if one.pressure_pa != 0.0 and not one.is_patch]
    # Two face sets at one pressure may close each other.
    for pressure in sorted({one.pressure_pa for one in sides}):
        faces = np.concatenate([one.faces for one in sides if one.pressure_pa == pressure])
        rims = rim(faces, mesh.points.shape[1])
        is_open = ~_is_held(mesh, loads, rims)
        if is_open.any():
            first = rims[np.flatnonzero(is_open)[0]]
            place = ", ".join(f"{x:.4g}" for x in mesh.points[first[:2]].mean(axis=0))
            raise ModelError(
                f"faces of the pressure {pressure:g} Pa: the cavity is open at ({place}) m, one of"
                f" {is_open.sum()} such places of its rim; allowed: a closed cavity, a rim held there or in a"
                " plane of symmetry, or press(..., is_patch=True) for a pressure on an open surface",
                "faces",
            )


def rim(faces: Integers, d: int) -> Integers:
    """Return the nodes of each place where faces end, (r, k): the node of a section, or the edge of a solid.

    Parameters
    ----------
    faces : ndarray of int, (f, m)
        Faces of a boundary.
    d : int
        2 for a section, 3 for a solid.
    """
    edges = edges_of(faces, d)
    edges = edges.reshape(-1, edges.shape[2])
    _, index, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(edges[np.sort(index[count == 1])])


def _is_held(mesh: Mesh, loads: Loads, rims: Integers) -> NDArray[np.bool_]:
    """Whether the supports make (du x dv) . t vanish on each place of a rim, (r,) of bool."""
    held = np.asarray(np.isfinite(loads.held)[rims].all(axis=1))
    if mesh.points.shape[1] == 2:
        # Out of the plane, along its tangent, nothing depends on what is held.
        held = np.concatenate([held, np.zeros((len(rims), 1), dtype=bool)], axis=1)
        tangent = np.broadcast_to([0.0, 0.0, 1.0], held.shape)
    else:
        tangent = mesh.points[rims[:, 1]] - mesh.points[rims[:, 0]]
    is_level = np.abs(tangent) <= LEVEL * np.linalg.norm(tangent, axis=1, keepdims=True)
    kept = np.ones(len(rims), dtype=bool)
    for i, j in combinations(range(3), 2):
        kept &= held[:, i] | held[:, j] | is_level[:, 3 - i - j]
    return kept
