"""Meshes of other programs: what meshio reads; STEP and STL by netgen (extras `design`, `mesh`).

Triangles and tetrahedra with corners alone lock. `refined` makes three quadrilaterals of a triangle, one at
each corner, and gives a tetrahedron nodes in the middles of its edges (docs/adr/0078-tetrahedra.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError
from soro_core.extras import named_packages
from soro_core.files.stl import read_stl
from soro_design.fem.elements.mesh import Mesh, Space, make_mesh
from soro_design.fem.meshes.foreign_mesh import read_foreign
from soro_design.fem.meshes.named_sets import named_sets
from soro_design.fem.meshes.surface import is_closed, volume

# Nodes of the new elements by the corners of which each is the middle, and the orders of corners, of the same
# sense, that give one of them each: three quad4, or one tet10.
_QUAD = ((0,), (0, 1), (0, 1, 2), (0, 2))
_TET = ((0,), (1,), (2,), (3,), (0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
_REFINED = {3: (_QUAD, ((0, 1, 2), (1, 2, 0), (2, 0, 1))), 4: (_TET, ((0, 1, 2, 3),))}


def refined(points: Array, simplices: Integers) -> tuple[Array, Integers, list[Integers]]:
    """Return points, and three quad4 of each triangle or the tet10 of each tetrahedron.

    Third come the corners of which the new points are the middles, in their order: of edges (m, 2), then of
    triangles (m, 3).

    Parameters
    ----------
    points : ndarray, (n, d)
        Places of the corners.
    simplices : ndarray of int, (s, d + 1)
        Corners of each, numbered in the sense of VTK.
    """
    count = simplices.shape[1]
    nodes, turns = _REFINED[count]
    found: dict[tuple[int, ...], Integers] = {(k,): simplices[:, k] for k in range(count)}
    places, middles, first = [points], [], len(points)
    for size in range(2, max(len(node) for node in nodes) + 1):
        these = list(combinations(range(count), size))
        corners = np.concatenate([np.sort(simplices[:, one], axis=1) for one in these])
        # What several elements share has one middle.
        shared, inverse = np.unique(corners, axis=0, return_inverse=True)
        found |= dict(zip(these, np.split(first + inverse.ravel(), len(these)), strict=True))
        places.append(points[shared].mean(axis=1))
        middles.append(shared)
        first += len(shared)
    cells = [
        np.stack([found[tuple(sorted(turn[k] for k in node))] for node in nodes], axis=1) for turn in turns
    ]
    return np.concatenate(places), np.concatenate(cells).astype(np.int64), middles


# Faces of triangles and of tetrahedra, by the number of corners, turned outwards.
_FACES = {3: ((0, 1), (1, 2), (2, 0)), 4: ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))}


def in_one_sense(points: Array, simplices: Integers) -> Integers:
    """Return triangles or tetrahedra of which a program has numbered some in the other sense, in one.

    Those that lie on each other are folded, not numbered otherwise: the simplices are returned as they are.

    Parameters
    ----------
    points : ndarray, (n, d)
        Places of the corners.
    simplices : ndarray of int, (s, d + 1)
        Corners of each.
    """
    count = simplices.shape[1]
    turned, other = simplices.copy(), np.linalg.det(np.diff(points[simplices], axis=1)) < 0.0
    turned[other, :2] = simplices[other, 1::-1]
    faces = np.concatenate([turned[:, one] for one in _FACES[count]])
    order = sum(faces[:, i] > faces[:, k] for i, k in combinations(range(count - 1), 2)) % 2
    # Neighbours are on both sides of a face, so that they go around it in both senses.
    _, there = np.unique(np.column_stack([np.sort(faces, axis=1), order]), axis=0, return_counts=True)
    return simplices if (there > 1).any() else turned


# Kinds of meshio by ours, the best first; simplices with corners alone are refined.
_KINDS = {
    "hex20": "hexahedron20",
    "hex8": "hexahedron",
    "tet10": "tetra10",
    "quad8": "quad8",
    "quad4": "quad",
}
_SIMPLICES = {"tetra": "tet10", "triangle": "quad4"}
# Of a flat mesh, its extent in z over that in x or y.
_FLAT = 1e-6
_SOLID = ("hexahedron20", "hexahedron", "tetra10", "tetra")
# Least and greatest volume of the mesh of an STL over that inside it.
_VOLUME_OF_STL = (0.95, 1.05)


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh of a file.

    Attributes
    ----------
    mesh : Mesh
        The mesh.
    groups : dict of str to ndarray of bool, (n,)
        Nodes of the named sets of the file (`named_sets`).
    """

    mesh: Mesh
    groups: dict[str, NDArray[np.bool_]]


def read_mesh(path: str | Path, space: Space, unit_m: float = 1.0) -> MeshFile:
    """Read a mesh, of .msh for example; triangles and tetrahedra with corners alone are `refined`.

    Those may be numbered in either sense (`in_one_sense`).

    Parameters
    ----------
    path : str or Path
        File; what is in it states its format, else its ending.
    space : str
        plane_strain, axisymmetric (x is the radius) or solid.
    unit_m : float
        Unit of the file [m].

    Raises
    ------
    ModelError
        If the file cannot be read, has no elements that are known, or they make no mesh.
    MissingPackageError
        If meshio is not installed.
    """
    found = read_foreign(Path(path))
    known = (*_KINDS.values(), *_SIMPLICES)
    fitting = [kind for kind in known if (kind in _SOLID) == (space == "solid")]
    d = 3 if space == "solid" else 2
    kinds = {block.type for block in found.cells if len(block.data) and block.dim == d}
    wanted = [kind for kind in fitting if kind in kinds]
    if not wanted:
        held = ", ".join(sorted({block.type for block in found.cells if len(block.data)})) or "none"
        allowed = f"{', '.join(fitting)} ({space})"
        if space == "solid" and held == "triangle":
            allowed += "; or this surface as .stl, if it is closed: netgen meshes its inside (soro[mesh])"
        raise ModelError(f"path {path}: elements {held}; allowed: {allowed}", "path")
    if len(kinds) > 1:
        held = " and ".join([*wanted, *sorted(kinds.difference(wanted))])
        raise ModelError(f"path {path}: elements {held}; allowed: one kind of {', '.join(fitting)}", "path")
    places = np.asarray(found.points, dtype=float)
    cells = np.asarray(found.get_cells_type(wanted[0]), dtype=np.int64)
    spans = np.ptp(places[np.unique(cells)], axis=0)
    if d == 2 and (spans[2:] > _FLAT * spans[:2].max()).any():
        raise ModelError(f"path {path}: points off a plane of z; allowed: a flat mesh ({space})", "path")
    points = places[:, :d] * unit_m
    return _file(points, cells, wanted[0], space, named_sets(found))


def write_mesh(path: str | Path, mesh: Mesh, at_nodes: Mapping[str, ArrayLike] | None = None) -> None:
    """Write a mesh in a format of meshio, .msh for example; VTU needs no extra (`write_vtu`).

    Parameters
    ----------
    path : str or Path
        File, whose ending states its format, which is replaced.
    mesh : Mesh
        The mesh; a section lies in the plane z = 0.
    at_nodes : mapping of str to array_like, (n,) or (n, d)
        Fields by name.

    Raises
    ------
    ModelError
        If the file cannot be written.
    MissingPackageError
        If meshio is not installed.
    """
    with named_packages():
        import meshio
    points = mesh.points if mesh.points.shape[1] == 3 else np.insert(mesh.points, 2, 0.0, axis=1)
    fields = {name: np.asarray(values, dtype=float) for name, values in (at_nodes or {}).items()}
    try:
        # Two programs have files with the ending .msh.
        form = "gmsh" if Path(path).suffix == ".msh" else None
        meshio.Mesh(points, [(_KINDS[mesh.kind], mesh.cells)], point_data=fields).write(path, form)
    except (Exception, SystemExit) as error:
        line = " ".join(str(error).split())
        raise ModelError(f"path {path}: {line}; allowed: a file that meshio writes", "path") from None


def mesh_step(path: str | Path, largest_m: float) -> Mesh:
    """Mesh the solid of a STEP file with tet10, whose edges are straight.

    Parameters
    ----------
    path : str or Path
        File; netgen turns its units into millimetres.
    largest_m : float
        Greatest edge of a tetrahedron.

    Raises
    ------
    ModelError
        If the file cannot be read or meshed.
    MissingPackageError
        If netgen is not installed.
    """
    with named_packages():
        from netgen.occ import OCCGeometry
    return _by_netgen(OCCGeometry, path, largest_m, 1e-3, "a STEP file of a solid")


def mesh_stl(path: str | Path, largest_m: float, unit_m: float = 1e-3) -> Mesh:
    """Mesh the inside of the surfaces of an STL file with tet10, whose edges are straight.

    Parameters
    ----------
    path : str or Path
        File; a surface inside another one, turned inwards, is the wall of a cavity.
    largest_m : float
        Greatest edge of a tetrahedron.
    unit_m : float
        Unit of the file [m].

    Raises
    ------
    ModelError
        If the file cannot be read or meshed, its surface is open, or the mesh has another volume.
    MissingPackageError
        If netgen is not installed.
    """
    with named_packages():
        from netgen.stl import STLGeometry
    corners, triangles = read_stl(path, unit_m)
    inside = volume(corners, triangles)
    if not is_closed(triangles) or inside <= 0.0:
        is_open = "turned inside out" if is_closed(triangles) else "open, or its triangles differ in sense"
        raise ModelError(f"path {path}: a surface that is {is_open}; allowed: closed, outwards", "path")
    allowed = "a closed surface without triangles that cross, and a small largest_m"
    mesh = _by_netgen(STLGeometry, path, largest_m, unit_m, allowed)
    share = float(np.linalg.det(np.diff(mesh.points[mesh.cells[:, :4]], axis=1)).sum()) / 6.0 / inside
    if not _VOLUME_OF_STL[0] <= share <= _VOLUME_OF_STL[1]:
        raise ModelError(f"path {path}: a mesh of {share:.0%} of its volume; allowed: {allowed}", "path")
    return mesh


def _by_netgen(reader: Any, path: str | Path, largest_m: float, unit_m: float, allowed: str) -> Mesh:
    """The tet10 of what a class of netgen reads, in a unit of the mesh [m]."""
    if not Path(path).is_file():
        raise ModelError(f"path {path}: no such file; allowed: {allowed}", "path")
    if not 0.0 < largest_m < np.inf:
        raise ModelError(f"largest_m {largest_m}; allowed: a number above 0", "largest_m")
    try:
        # Its threads wait busily for each other: with fewer cores than threads it takes ten times longer.
        found = reader(str(path)).GenerateMesh(maxh=largest_m / unit_m, parallel_meshing=False)
    except Exception as error:
        line = " ".join(str(error).split())
        raise ModelError(f"path {path}: {line}; allowed: {allowed}", "path") from None
    cells = np.array([[node.nr - 1 for node in cell.vertices] for cell in found.Elements3D()], dtype=np.int64)
    if len(cells) == 0:
        raise ModelError(f"path {path}: no mesh of a solid by netgen; allowed: {allowed}", "path")
    return _file(unit_m * np.asarray(found.Coordinates()), cells, "tetra", "solid", {}).mesh


def _file(points: Array, cells: Integers, kind: str, space: Space, groups: dict[str, Integers]) -> MeshFile:
    """A mesh of the points that its elements use, with groups of nodes by name."""
    used, numbers = np.unique(cells, return_inverse=True)
    points, cells = points[used], numbers.reshape(cells.shape)
    is_in = {name: np.isin(used, nodes) for name, nodes in groups.items()}
    ours = next((one for one, other in _KINDS.items() if other == kind), "")
    if ours:
        return MeshFile(make_mesh(ours, space, points, cells), is_in)
    points, cells, middles = refined(points, in_one_sense(points, cells))
    # The middle of an edge or a face is in a group if all its corners are.
    for name, inside in is_in.items():
        is_in[name] = np.concatenate([inside, *(inside[corners].all(axis=1) for corners in middles)])
    return MeshFile(make_mesh(_SIMPLICES[kind], space, points, cells), is_in)
