"""Structured meshes of blocks, tubes and spheres: a grid of the unit square or cube, mapped to the part."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError
from soro_design.fem.elements.element import SOLIDS, element
from soro_design.fem.elements.mesh import Mesh, Space, make_mesh

# Nodes of the six tetrahedra around a diagonal of the cube [-1, 1]^3.
AROUND_DIAGONAL = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
_SHARES = np.insert(element("tet10").nodes, 0, 1.0 - element("tet10").nodes.sum(axis=1), axis=1)
_TETS = _SHARES @ element("hex8").nodes[np.array(AROUND_DIAGONAL)]


def grid(kind: str, counts: tuple[int, ...]) -> tuple[Array, Integers]:
    """Return points in the unit cube (n, d) and elements (e, nodes) of a regular grid.

    Parameters
    ----------
    kind : str
        quad4, quad8, hex8, hex20 or tet10 (six in a cube).
    counts : tuple of int
        Number of elements along each direction.

    Raises
    ------
    ModelError
        If there is no such kind, or `counts` or the places of points make no mesh.
    """
    if kind not in SOLIDS:
        raise ModelError(f"kind {kind!r}; allowed: {', '.join(SOLIDS)}", "kind")
    nodes = _TETS if kind == "tet10" else element(kind).nodes[None]
    if len(counts) != nodes.shape[2] or any(count < 1 for count in counts):
        raise ModelError(f"counts {counts} of {kind}; allowed: {nodes.shape[2]} numbers from 1", "counts")
    # Twice as fine, so that the middles of edges have numbers too.
    fine = np.array([2 * count + 1 for count in counts])
    first = 2 * np.array(list(product(*(range(count) for count in counts)))) + 1
    places = first[:, None, None] + nodes.astype(np.int64)
    number = np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), tuple(fine))
    used, cells = np.unique(number, return_inverse=True)
    points = np.stack(np.unravel_index(used, tuple(fine)), axis=1) / (fine - 1.0)
    return points, cells.reshape(-1, number.shape[2]).astype(np.int64)


def mapped(kind: str, space: Space, counts: tuple[int, ...], place: Callable[[Array], Array]) -> Mesh:
    """Return a grid mapped to a part.

    Parameters
    ----------
    kind : str
        quad4, quad8, hex8, hex20 or tet10 (six in a cube).
    space : str
        plane_strain, axisymmetric or solid.
    counts : tuple of int
        Number of elements along each direction.
    place : callable
        From points of the unit cube (n, d) to places (n, d) [m].

    Raises
    ------
    ModelError
        If there is no such kind, or `counts` or the places of points make no mesh.
    """
    points, cells = grid(kind, counts)
    return make_mesh(kind, space, place(points), cells)


def block(kind: str, space: Space, counts: tuple[int, ...], size: tuple[float, ...]) -> Mesh:
    """Return a block with a corner at the origin; axisymmetric, a disc or a cylinder.

    Parameters
    ----------
    kind : str
        quad4, quad8, hex8, hex20 or tet10 (six in a cube).
    space : str
        plane_strain, axisymmetric or solid.
    counts : tuple of int
        Number of elements along each direction.
    size : tuple of float
        Lengths of the edges [m].

    Raises
    ------
    ModelError
        If there is no such kind, or `counts` or the places of points make no mesh.
    """
    return mapped(kind, space, counts, lambda unit: unit * np.array(size))


def tube(kind: str, counts: tuple[int, ...], radii: tuple[float, float], length: float = 1.0) -> Mesh:
    """Return a quarter of a tube: of its section in plane strain, or a solid of some length along z.

    Parameters
    ----------
    kind : str
        quad4, quad8, hex8, hex20 or tet10 (six in a cube).
    counts : tuple of int
        Number of elements across the wall, around, and of a solid along it.
    radii : tuple of float
        Inner and outer [m].
    length : float
        Of a solid [m].

    Raises
    ------
    ModelError
        If there is no such kind, or `counts` or the places of points make no mesh.
    """
    low, high = radii

    def place(unit: Array) -> Array:
        flat = _quarter(low + (high - low) * unit[:, 0], unit[:, 1])
        return flat if unit.shape[1] == 2 else np.concatenate([flat, length * unit[:, 2:]], axis=1)

    return mapped(kind, "plane_strain" if len(counts) == 2 else "solid", counts, place)


def revolved_tube(kind: str, counts: tuple[int, int], radii: tuple[float, float], length: float) -> Mesh:
    """Return an axisymmetric tube along z.

    Parameters
    ----------
    kind : str
        quad4 or quad8.
    counts : tuple of int
        Number of elements across the wall and along it.
    radii : tuple of float
        Inner and outer [m].
    length : float
        Along the axis [m].

    Raises
    ------
    ModelError
        If there is no such kind, or `counts` or the places of points make no mesh.
    """
    low, high = radii
    return mapped(
        kind, "axisymmetric", counts, lambda unit: unit * [high - low, length] + np.array([low, 0.0])
    )


def sphere(kind: str, counts: tuple[int, int], radii: tuple[float, float]) -> Mesh:
    """Return the upper half of a hollow sphere, axisymmetric; the second direction runs from the equator.

    Parameters
    ----------
    kind : str
        quad4 or quad8.
    counts : tuple of int
        Number of elements across the wall and from the equator to the pole.
    radii : tuple of float
        Inner and outer [m].

    Raises
    ------
    ModelError
        If there is no such kind, or `counts` or the places of points make no mesh.
    """
    low, high = radii

    return mapped(
        kind, "axisymmetric", counts, lambda unit: _quarter(low + (high - low) * unit[:, 0], unit[:, 1])
    )


def _quarter(radius: Array, share: Array) -> Array:
    """Places (n, 2) on a quarter of circles; those on the axis at 0, which cos(pi / 2) is not quite."""
    angle = 0.5 * np.pi * share
    return np.stack([radius * np.where(share == 1.0, 0.0, np.cos(angle)), radius * np.sin(angle)], axis=1)
