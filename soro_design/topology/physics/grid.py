"""Regular grids of rectangles and boxes, and the integrals that all their elements share.

Elements of a section or a box are all alike; those of a ring are alike in each column. So every integral is
computed once for a kind of element: one kind, or about an axis one for each column.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix

from soro_core.arrays import Array, Flags, Integers
from soro_design.fem import Mesh
from soro_design.fem.elements.mesh import Space
from soro_design.fem.elements.pattern import Pattern, make_pattern
from soro_design.fem.elements.solid import tables
from soro_design.fem.meshes.blocks import block
from soro_design.fem.solve.dissection import rows_dissected


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A goal and its gradient.

    Attributes
    ----------
    objective : float
        To be made small.
    gradient : ndarray, (e,) or (2 e,)
        Its derivative by the densities, and by the shares of a second material.
    motion_m : float
        Of the output [m], NaN without one.
    u : ndarray, (n, d)
        Displacements [m].
    pressure : ndarray, (n,)
        Of the nodes [Pa].
    residual : float
        Unbalanced force over the force of the air, as norms.
    share : float
        Of the pressure that was asked for: below 1 where there is no equilibrium under all of it.
    """

    objective: float
    gradient: Array
    motion_m: float
    u: Array
    pressure: Array
    residual: float
    share: float = 1.0


@dataclass(frozen=True, eq=False)
class Grid:
    """A rectangle divided into equal quad4, or a box into equal hex8; make one with `make_grid`.

    Attributes
    ----------
    mesh : Mesh
        Elements and nodes are numbered along the last direction first: i + counts[1] k in column k.
    counts : tuple of int
        Elements along each direction.
    edge_m : tuple of float
        Lengths of an element along each direction [m].
    kind : ndarray of int, (e,)
        Kind of each element.
    shape : ndarray, (g, a)
        Shape functions at the points of integration.
    slope : ndarray, (kinds, g, a, d)
    hoop : ndarray, (kinds, g, a)
    volume : ndarray, (kinds, g)
        Those of `soro_design.fem.elements.solid.tables`.
    diffusion, mass : ndarray, (kinds, a, a)
        int dN_a/dX . dN_b/dX dV [m] and int N_a N_b dV [m3].
    scalars, vectors : Pattern
        Of matrices of one number a node, and of one for each direction.
    order : ndarray of int, (d n,)
        Rows of `vectors` in an order for elimination.
    """

    mesh: Mesh
    counts: tuple[int, ...]
    edge_m: tuple[float, ...]
    kind: Integers
    shape: Array
    slope: Array
    hoop: Array
    volume: Array
    diffusion: Array
    mass: Array
    scalars: Pattern
    vectors: Pattern
    order: Integers

    @property
    def centres(self) -> Array:
        """Middles of the elements, (e, d) [m]."""
        return np.asarray(self.mesh.points[self.mesh.cells].mean(axis=1))

    @property
    def volumes(self) -> Array:
        """Volumes of the elements, (e,) [m3]."""
        return np.asarray(self.volume.sum(axis=1)[self.kind])

    def gathered(self, of_cells: Array) -> Array:
        """Return the sums at the nodes (n,) of what elements give to theirs (e, a)."""
        given = np.bincount(self.mesh.cells.ravel(), of_cells.ravel(), len(self.mesh.points))
        return np.asarray(given, dtype=float)

    def as_rows(self, values: Array) -> Array:
        """Return values of elements (e,) as an array (y, x), those of a box at its side z = 0."""
        return np.asarray(values).reshape((*self.counts, 1))[:, :, 0].reshape(self.counts[:2]).T


def place_text(place_m: Array) -> str:
    """Return a place (d,) in words."""
    return f"({', '.join(f'{1e3 * x:.4g}' for x in place_m)}) mm"


def assembled(pattern: Pattern, of_cells: Array) -> Any:
    """Return the sparse matrix of matrices of elements (e, m, m)."""
    data = np.bincount(pattern.cells.ravel(), of_cells.ravel(), len(pattern.keys))
    return pattern.matrix(np.asarray(data, dtype=float))


def between_free(pattern: Pattern, is_held: Flags) -> tuple[Integers, Integers, Any]:
    """Return the numbers of free rows, the entries of `pattern` between them, and a matrix (csc) for these.

    Parameters
    ----------
    pattern : Pattern
        Of all rows.
    is_held : ndarray of bool, (n, d)
        Rows to leave out.
    """
    is_free = ~is_held.ravel()
    column = np.repeat(np.arange(pattern.n), np.diff(pattern.start))
    number = np.cumsum(is_free) - 1
    kept = np.flatnonzero(is_free[pattern.row] & is_free[column])
    n = int(is_free.sum())
    start = np.searchsorted(number[column[kept]], np.arange(n + 1)).astype(np.int32)
    rows = number[pattern.row[kept]].astype(np.int32)
    return np.flatnonzero(is_free), kept, csc_matrix((np.zeros(len(kept)), rows, start), shape=(n, n))


def make_grid(space: Space, size_m: tuple[float, ...], counts: tuple[int, ...]) -> Grid:
    """Return the grid of a rectangle or box with a corner at the origin.

    Parameters
    ----------
    space : str
        plane_strain, axisymmetric, about x = 0, or solid.
    size_m : tuple of float
        Lengths along x, y and, of a solid, z [m].
    counts : tuple of int
        Elements along each of them.
    """
    mesh = block("hex8" if space == "solid" else "quad4", space, counts, size_m)
    is_ring = space == "axisymmetric"
    kind = (
        np.repeat(np.arange(counts[0]), counts[1]) if is_ring else np.zeros(len(mesh.cells), dtype=np.int64)
    )
    slope, hoop, volume = tables(mesh, mesh.cells[:: counts[1]] if is_ring else mesh.cells[:1])
    shape = mesh.element.shape
    diffusion = np.einsum("eg,egad,egbd->eab", volume, slope, slope)
    mass = np.einsum("eg,ga,gb->eab", volume, shape, shape)
    edge = tuple(size / count for size, count in zip(size_m, counts, strict=True))
    scalars, vectors = (make_pattern(mesh.cells, len(mesh.points), d) for d in (1, len(counts)))
    order = rows_dissected(mesh.points, vectors)
    return Grid(
        mesh, counts, edge, kind, shape, slope, hoop, volume, diffusion, mass, scalars, vectors, order
    )
