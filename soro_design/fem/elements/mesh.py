"""Meshes of one kind of element, checked when they are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError
from soro_design.fem.elements.element import SOLIDS, Element, element, shapes

Space = Literal["plane_strain", "axisymmetric", "solid"]

# Least ratio of the least to the greatest volume scale in an element.
FLATTEST = 1e-3
# Least ratio of its volume scale to its size: rounding makes that of flat elements.
_ROUNDED = 1e-12


@dataclass(frozen=True, eq=False)
class Mesh:
    """Points and the elements between them; make one with `make_mesh`.

    Attributes
    ----------
    kind : str
        quad4, quad8, hex8, hex20 or tet10.
    space : str
        plane_strain (x, y; of unit thickness), axisymmetric (r, z about the axis r = 0) or solid (x, y, z).
    points : ndarray, (n, d)
        Places of the nodes [m].
    cells : ndarray of int, (e, nodes)
        Nodes of each element, in the order of VTK, counter-clockwise.
    """

    kind: str
    space: Space
    points: Array
    cells: Integers

    @property
    def element(self) -> Element:
        """Tables of its kind."""
        return element(self.kind)

    def boundary(self) -> Integers:
        """Return the faces that belong to one element alone (f, m), turned outwards."""
        faces = self.cells[:, self.element.faces]
        faces = faces.reshape(-1, faces.shape[2])
        _, index, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        return np.asarray(faces[np.sort(index[count == 1])])

    def faces_at(self, inside: ArrayLike) -> Integers:
        """Return the boundary faces (f, m) whose nodes are all marked in `inside`, (n,) of bool.

        Raises
        ------
        ModelError
            If there is none.
        """
        faces = self.boundary()
        found = faces[np.asarray(inside, dtype=bool)[faces].all(axis=1)]
        if len(found) == 0:
            raise ModelError("no face of the boundary lies there; allowed: nodes of whole faces", "faces")
        return found


def make_mesh(kind: str, space: Space, points: ArrayLike, cells: ArrayLike) -> Mesh:
    """Return a checked mesh; one whose elements are all numbered clockwise is numbered the other way round.

    Parameters
    ----------
    kind : str
        quad4, quad8, hex8, hex20 or tet10.
    space : str
        plane_strain, axisymmetric or solid.
    points : array_like, (n, 2 or 3)
        Places of the nodes [m].
    cells : array_like of int, (e, nodes)
        Nodes of each element.

    Raises
    ------
    ModelError
        One line that names the element that is inverted, degenerate or there twice, or what else is wrong.
    """
    if kind not in SOLIDS:
        why = ", which locks without nodes in the middles of edges" if kind == "tet4" else ""
        raise ModelError(f"kind {kind!r}{why}; allowed: {', '.join(SOLIDS)}", "kind")
    places = np.array(points, dtype=float)
    if np.asarray(cells).dtype.kind not in "iu":
        raise ModelError(f"cells of type {np.asarray(cells).dtype}; allowed: whole numbers", "cells")
    nodes = np.array(cells, dtype=np.int64)
    size, d = element(kind).nodes.shape
    if space not in (("solid",) if d == 3 else ("plane_strain", "axisymmetric")):
        raise ModelError(
            f"space {space!r} of {kind}; allowed: solid for hexahedra and tetrahedra, else plane", "space"
        )
    if places.ndim != 2 or places.shape[1] != d or not np.isfinite(places).all():
        raise ModelError(f"points of shape {places.shape}; allowed: finite numbers, (n, {d})", "points")
    if nodes.ndim != 2 or nodes.shape[1] != size or len(nodes) == 0:
        raise ModelError(f"cells of shape {nodes.shape}; allowed: (elements, {size})", "cells")
    if nodes.min() < 0 or nodes.max() >= len(places):
        raise ModelError(f"cells name node {nodes.max()}; allowed: 0 to {len(places) - 1}", "cells")
    if space == "axisymmetric" and places[:, 0].min() < -1e-12 * np.ptp(places):
        raise ModelError(f"axisymmetric points at r = {places[:, 0].min():.6g} m; allowed: r >= 0", "points")
    unused = len(places) - len(np.unique(nodes))
    if unused:
        raise ModelError(f"{unused} points belong to no element; allowed: points of elements", "points")
    first, count = np.unique(np.sort(nodes, axis=1), axis=0, return_index=True, return_counts=True)[1:]
    if (count > 1).any():
        raise ModelError(f"cells: element {first[count > 1][0]} is there twice; allowed: once", "cells")
    return Mesh(kind, space, *_frozen(places, _turned(kind, places, nodes)))


def volume_scale(kind: str, points: Array, cells: Integers) -> Array:
    """Return det dX/dxi at the points of integration and at the nodes, (e, g + n).

    Parameters
    ----------
    kind : str
        Of the element.
    points : ndarray, (n, d)
        Places of the nodes.
    cells : ndarray of int, (e, nodes)
        Elements.
    """
    one = element(kind)
    slope = np.concatenate([one.slope, shapes(one.nodes, one.nodes)[1]])
    return np.asarray(np.linalg.det(np.einsum("ead,gak->egdk", points[cells], slope)))


def _turned(kind: str, points: Array, cells: Integers) -> Integers:
    """Cells with a positive volume everywhere, or an error that names the first one that has none."""
    scale = volume_scale(kind, points, cells)
    if (scale < 0.0).all():
        one = element(kind)
        mirrored = one.nodes[:, [1, 0, 2][: one.nodes.shape[1]]]
        order = [int(np.flatnonzero((one.nodes == place).all(axis=1))[0]) for place in mirrored]
        cells, scale = cells[:, order], -scale
    low, high = scale.min(axis=1), np.abs(scale).max(axis=1)
    size = np.ptp(points[cells], axis=1).max(axis=1) ** points.shape[1]
    is_flat = high <= _ROUNDED * size
    wrong = np.flatnonzero(~(low > FLATTEST * high) | is_flat)
    if len(wrong):
        e = wrong[0]
        is_inverted = bool(low[e] < -FLATTEST * high[e]) and not is_flat[e]
        place = ", ".join(f"{x:.4g}" for x in points[cells[e]].mean(axis=0))
        what = "inverted" if is_inverted else "degenerate"
        raise ModelError(
            f"cells: {len(wrong)} wrong, element {e} {what} at ({place}) m; allowed: corners in one sense,"
            " angles below 180 degrees",
            "cells",
        )
    return cells


def _frozen(points: Array, cells: Integers) -> tuple[Array, Integers]:
    cells = np.ascontiguousarray(cells)
    points.flags.writeable = cells.flags.writeable = False
    return points, cells
