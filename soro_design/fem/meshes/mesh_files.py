"""Meshes of other programs: .msh and what else meshio reads; STEP by netgen (extras `design`, `mesh`).

`split` makes quadrilaterals and hexahedra of triangles and tetrahedra, one at each corner: it runs from the
corner over the middles of edges and faces to the middle of the old element. So meshes of programs that know
triangles and tetrahedra alone become ones that do not lock.
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
from soro_design.fem.elements.mesh import Mesh, Space, make_mesh
from soro_design.fem.meshes.foreign_mesh import read_foreign

# Corners whose middle is a node of the new element at corner 0; the others follow by turning the old one.
_QUAD = ((0,), (0, 1), (0, 1, 2), (0, 2))
_HEX = ((0,), (0, 1), (0, 1, 2), (0, 2), (0, 3), (0, 1, 3), (0, 1, 2, 3), (0, 2, 3))
# Corners in an order of the same sense that begins with each.
_TURNS = {3: ((0, 1, 2), (1, 2, 0), (2, 0, 1)), 4: ((0, 1, 2, 3), (1, 0, 3, 2), (2, 3, 0, 1), (3, 2, 1, 0))}


def split(points: Array, simplices: Integers) -> tuple[Array, Integers, list[Integers]]:
    """Return points, and three quad4 of each triangle or four hex8 of each tetrahedron.

    Third come the corners of which the new points are the middles, in their order: of edges (m, 2), of
    triangles (m, 3), of tetrahedra (m, 4).

    Parameters
    ----------
    points : ndarray, (n, d)
        Places of the corners.
    simplices : ndarray of int, (s, d + 1)
        Corners of each, numbered in the sense of VTK.
    """
    count = simplices.shape[1]
    found: dict[tuple[int, ...], Integers] = {(k,): simplices[:, k] for k in range(count)}
    places, middles, first = [points], [], len(points)
    for size in range(2, count + 1):
        these = list(combinations(range(count), size))
        corners = np.concatenate([np.sort(simplices[:, one], axis=1) for one in these])
        # What several elements share has one middle.
        shared, inverse = np.unique(corners, axis=0, return_inverse=True)
        found |= dict(zip(these, np.split(first + inverse.ravel(), len(these)), strict=True))
        places.append(points[shared].mean(axis=1))
        middles.append(shared)
        first += len(shared)
    nodes = _QUAD if count == 3 else _HEX
    cells = [
        np.stack([found[tuple(sorted(turn[k] for k in node))] for node in nodes], axis=1)
        for turn in _TURNS[count]
    ]
    return np.concatenate(places), np.concatenate(cells).astype(np.int64), middles


# Kinds of meshio by ours, the best first; simplices are split.
_KINDS = {"hex20": "hexahedron20", "hex8": "hexahedron", "quad8": "quad8", "quad4": "quad"}
_SIMPLICES = {"tetra": "hex8", "triangle": "quad4"}
# Of a flat mesh, its extent in z over that in x or y.
_FLAT = 1e-6
_SOLID = ("hexahedron20", "hexahedron", "tetra")


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh of a file.

    Attributes
    ----------
    mesh : Mesh
        The mesh.
    groups : dict of str to ndarray of bool, (n,)
        Nodes of the named groups of faces, lines and points (physical groups of .msh).
    """

    mesh: Mesh
    groups: dict[str, NDArray[np.bool_]]


def read_mesh(path: str | Path, space: Space, unit_m: float = 1.0) -> MeshFile:
    """Read a mesh, of .msh for example; triangles and tetrahedra are split into quad4 and hex8.

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
        raise ModelError(f"path {path}: elements {held}; allowed: {', '.join(fitting)} ({space})", "path")
    if len(kinds) > 1:
        held = " and ".join([*wanted, *sorted(kinds.difference(wanted))])
        raise ModelError(f"path {path}: elements {held}; allowed: one kind of {', '.join(fitting)}", "path")
    places = np.asarray(found.points, dtype=float)
    cells = np.asarray(found.get_cells_type(wanted[0]), dtype=np.int64)
    spans = np.ptp(places[np.unique(cells)], axis=0)
    if d == 2 and (spans[2:] > _FLAT * spans[:2].max()).any():
        raise ModelError(f"path {path}: points off a plane of z; allowed: a flat mesh ({space})", "path")
    points = places[:, :d] * unit_m
    return _file(points, cells, wanted[0], space, _groups(found))


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
    """Mesh the solid of a STEP file with tetrahedra, and split them into hex8.

    Parameters
    ----------
    path : str or Path
        File; netgen turns its units into millimetres.
    largest_m : float
        Greatest edge of a tetrahedron, twice that of a hex8.

    Raises
    ------
    ModelError
        If the file cannot be read or meshed.
    MissingPackageError
        If netgen is not installed.
    """
    with named_packages():
        from netgen.occ import OCCGeometry
    if not Path(path).is_file():
        raise ModelError(f"path {path}: no such file; allowed: a STEP file", "path")
    if not 0.0 < largest_m < np.inf:
        raise ModelError(f"largest_m {largest_m}; allowed: a number above 0", "largest_m")
    try:
        # Its threads wait busily for each other: with fewer cores than threads it takes ten times longer.
        found = OCCGeometry(str(path)).GenerateMesh(maxh=1e3 * largest_m, parallel_meshing=False)
    except Exception as error:
        line = " ".join(str(error).split())
        raise ModelError(f"path {path}: {line}; allowed: a STEP file of a solid", "path") from None
    cells = np.array([[node.nr - 1 for node in cell.vertices] for cell in found.Elements3D()], dtype=np.int64)
    if len(cells) == 0:
        raise ModelError(f"path {path}: no solid; allowed: a STEP file of a solid", "path")
    return _file(1e-3 * np.asarray(found.Coordinates()), cells, "tetra", "solid", {}).mesh


def _file(points: Array, cells: Integers, kind: str, space: Space, groups: dict[str, Integers]) -> MeshFile:
    """A mesh of the points that its elements use, with groups of nodes by name."""
    used, numbers = np.unique(cells, return_inverse=True)
    points, cells = points[used], numbers.reshape(cells.shape)
    is_in = {name: np.isin(used, nodes) for name, nodes in groups.items()}
    ours = next((one for one, other in _KINDS.items() if other == kind), "")
    if ours:
        return MeshFile(make_mesh(ours, space, points, cells), is_in)
    points, cells, middles = split(points, cells)
    # The middle of an edge or a face is in a group if all its corners are.
    for name, inside in is_in.items():
        is_in[name] = np.concatenate([inside, *(inside[corners].all(axis=1) for corners in middles)])
    return MeshFile(make_mesh(_SIMPLICES[kind], space, points, cells), is_in)


def _groups(found: Any) -> dict[str, Integers]:
    """Nodes of the physical groups of a mesh of meshio, by name."""
    groups = {}
    for name, (tag, _) in found.field_data.items():
        tags = found.cell_data.get("gmsh:physical", [])
        nodes = [block.data[of == tag].ravel() for block, of in zip(found.cells, tags, strict=False)]
        groups[name] = np.unique(np.concatenate(nodes)).astype(np.int64) if nodes else np.empty(0, np.int64)
    return groups
