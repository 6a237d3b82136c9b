"""Sections as solids: mirror images, and lids that close the ends of a part in plane strain.

Of a part with lids half is meshed, from the plane z = 0 in the middle of its height, as layers of the
section: those of the chamber hold its solid, those of the lid also the void that the air of the inlet
reaches. What the chamber leaves out of the lid's layers is wet.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from soro_core.arrays import Array, Flags, Integers
from soro_core.config import with_changes
from soro_core.errors import ConfigError, ModelError
from soro_design.fem import Mesh, extruded, make_mesh, revolved
from soro_design.fem.elements.mesh import Space
from soro_design.fem.meshes.hexahedra import extruded_mesh
from soro_design.fem.meshes.surface import solid_surface
from soro_design.topology.check import Reanalysis, final_part, moved_output, reanalyse
from soro_design.topology.domain import NEAR, Domain, make_domain, output_at
from soro_design.topology.flood import flood
from soro_design.topology.goals import Farthest
from soro_design.topology.shape import Contour, contour_level, cut_quads, joined_with_output, snapped
from soro_design.topology.task import Task

# Elements of the grids that the section of the solid is tried on, and how near its motion in plane strain has
# to come to that on the mesh of its own.
CELLS, NEAR_ENOUGH = (200, 400, 800), 0.05


def mirrored(mesh: Mesh, axes: tuple[str, ...], space: Space = "plane_strain") -> Mesh:
    """Return a section (quad4) with its mirror images.

    Parameters
    ----------
    mesh : Mesh
    axes : tuple of str
        "x" for an image behind x = 0, "y" for one behind y = 0.
    space : Space
        Of the mesh that is returned: "plane_strain", or "axisymmetric" about x = 0.
    """
    points, cells = mesh.points, mesh.cells
    for axis in axes:
        k = "xy".index(axis)
        is_shared = points[:, k] == 0.0
        number = np.where(is_shared, np.arange(len(points)), len(points) + np.cumsum(~is_shared) - 1)
        image = points[~is_shared] * np.where(np.arange(2) == k, -1.0, 1.0)
        points = np.concatenate([points, image])
        cells = np.concatenate([cells, number[cells][:, ::-1]])
    return make_mesh("quad4", space, points, cells)


def piece(mesh: Mesh, is_there: Flags) -> Mesh:
    """Return the mesh of some elements of one; what touches at a node or edge alone shares no node.

    Parameters
    ----------
    mesh : Mesh
    is_there : ndarray of bool, (c,)
        The elements.
    """
    cells, faces = mesh.cells[is_there], mesh.element.faces
    # Nodes of each element (c m of them), of which those of a face are one in both its elements.
    n, own = cells.size, np.arange(cells.size).reshape(cells.shape)[:, faces].reshape(-1, faces.shape[1])
    nodes = cells.ravel()[own]
    turn = np.argsort(nodes, axis=1)
    own, nodes = (np.take_along_axis(one, turn, axis=1) for one in (own, nodes))
    order = np.lexsort(nodes.T)
    own, nodes = own[order], nodes[order]
    is_shared = (nodes[1:] == nodes[:-1]).all(axis=1)
    pairs = own[:-1][is_shared].ravel(), own[1:][is_shared].ravel()
    links = coo_matrix((np.ones(len(pairs[0])), pairs), shape=(n, n))
    number = connected_components(links, directed=False)[1]
    places = np.empty((number.max(initial=-1) + 1, mesh.points.shape[1]))
    places[number] = mesh.points[cells.ravel()]
    return make_mesh(mesh.kind, mesh.space, places, number.reshape(cells.shape))


def mirrored_surface(points: Array, triangles: Integers, axes: tuple[str, ...]) -> tuple[Array, Integers]:
    """Return corners (n, 3) [m] and triangles (t, 3) of a solid with its mirror images, open between none.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Corners [m].
    triangles : ndarray of int, (t, 3)
        Turned outwards.
    axes : tuple of str
        Directions in which the part goes on behind 0.
    """
    for axis in axes:
        k = "xyz".index(axis)
        is_shared = points[:, k] == 0.0
        triangles = triangles[~is_shared[triangles].all(axis=1)]
        number = np.where(is_shared, np.arange(len(points)), len(points) + np.cumsum(~is_shared) - 1)
        points = np.concatenate([points, points[~is_shared] * np.where(np.arange(3) == k, -1.0, 1.0)])
        triangles = np.concatenate([triangles, number[triangles][:, ::-1]])
    used, numbers = np.unique(triangles, return_inverse=True)
    return points[used], numbers.reshape(triangles.shape)


def final_surface(task: Task, mesh: Mesh, height_m: float, pieces: int) -> tuple[Array, Integers]:
    """Return the surface of a part with its mirror images: corners (n, 3) [m], triangles (t, 3).

    Parameters
    ----------
    task : Task
    mesh : Mesh
        Of its solid.
    height_m : float
        Along z [m], in plane strain.
    pieces : int
        Of a revolution about an axis.
    """
    if task.space == "solid":
        return mirrored_surface(*solid_surface(mesh), task.mirrors)
    if task.space == "axisymmetric":
        return revolved(mirrored(mesh, tuple({*task.mirrors} - {"x"}), "axisymmetric"), pieces)
    return extruded(mirrored(mesh, task.mirrors), height_m)


class Layers(NamedTuple):
    """Elements along z of half a part.

    Attributes
    ----------
    kind : str
        quad4 or quad8, of the section.
    chamber, lid : int
        Of the half chamber and of the lid.
    """

    kind: str
    chamber: int
    lid: int


def lidded_mesh(domain: Domain, cut: Contour, layers: Layers) -> tuple[Mesh, Integers]:
    """Return the upper half of a part with lids (hex8 or hex20), and its faces that air presses on (f, m).

    Parameters
    ----------
    domain : Domain
        A task with `lid_mm`.
    cut : Contour
        Border of the solid of its section.
    layers : Layers
        Elements along z.
    """
    task = domain.task
    points, cells, is_void = cut_quads(domain.grid, cut, flood(domain, cut).is_wet)
    is_chamber = ~is_void
    is_chamber[is_chamber] = joined_with_output(domain, points, cells[is_chamber])
    is_lid = joined_with_output(domain, points, cells)
    used, numbers = np.unique(cells[is_lid], return_inverse=True)
    section = _section(layers.kind, points[used], numbers.reshape(-1, 4))
    half, lid = 0.5 * task.height_m, task.lid_m
    count = layers.chamber + layers.lid
    whole = extruded_mesh(section, half, count)
    # Layers of equal height within the chamber, and within the lid.
    z = np.interp(whole.points[:, 2], (0.0, half * layers.chamber / count, half), (0.0, half - lid, half))
    places = np.insert(whole.points[:, :2], 2, z, axis=1)
    is_solid = np.concatenate(
        [np.tile(is_chamber[is_lid], layers.chamber), np.ones(layers.lid * len(section.cells), bool)]
    )
    used, numbers = np.unique(whole.cells[is_solid], return_inverse=True)
    mesh = make_mesh(whole.kind, "solid", places[used], numbers.reshape(-1, whole.cells.shape[1]))
    # Faces of the boundary that were none before the chamber was taken out.
    faces = mesh.boundary()
    before = np.sort(whole.boundary(), axis=1)
    rows = np.concatenate([np.sort(used[faces], axis=1), before])
    _, first, count_of = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    return mesh, faces[count_of[first.ravel()[: len(faces)]] == 1]


def _section(kind: str, points: Array, cells: Integers) -> Mesh:
    """A section of quad4, or with the middles of their edges of quad8."""
    if kind == "quad4":
        return make_mesh(kind, "plane_strain", points, cells)
    edges = np.sort(np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    shared, numbers = np.unique(edges, axis=0, return_inverse=True)
    middles = len(points) + numbers.reshape(-1, 4)
    places = np.concatenate([points, points[shared].mean(axis=1)])
    return make_mesh(kind, "plane_strain", places, np.concatenate([cells, middles], axis=1))


def coarser(domain: Domain, filtered: Array, cells: int) -> tuple[Domain, Contour]:
    """Return a task on a coarser grid, and the contour of its densities there.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    filtered : ndarray, (e,)
        Densities before their projection.
    cells : int
        Elements of the coarser grid, about; a grid of fewer stays.

    Raises
    ------
    ConfigError
        If no node of the coarser grid lies in a region.
    """
    counts = domain.grid.counts
    sides = [np.linspace(0.0, size, n + 1) for size, n in zip(domain.task.size_m, counts, strict=True)]
    field = RegularGridInterpolator(sides, contour_level(domain, filtered).reshape([n + 1 for n in counts]))
    factor = max(1.0, np.sqrt(np.prod(counts) / cells))
    # The densities have what is given.
    given = {"solid": (), "void": (), "start": ()}
    few = make_domain(
        with_changes(domain.task, cells=tuple(max(2, round(n / factor)) for n in counts), **given)
    )
    return few, snapped(few.grid, field(few.grid.mesh.points))


# Of the half part along z, of second order.
SOLID = Layers("quad8", 2, 1)


class LiddedMotion(NamedTuple):
    """How a part with lids moves against its spring.

    Attributes
    ----------
    mesh : Mesh
        Of half the part, hex20.
    moved : Reanalysis
        Of it; without the spring it is not computed.
    middle_m : float
        Mean motion of the output in the middle of the height [m].
    section_m : float
        That of the section in plane strain, on a mesh of the same size of elements [m].
    """

    mesh: Mesh
    moved: Reanalysis
    middle_m: float
    section_m: float


def reanalyse_with_lids(domain: Domain, filtered: Array, motion_m: float) -> LiddedMotion:
    """Return how a task with `lid_mm` moves as a solid.

    Parameters
    ----------
    domain : Domain
        The task on its grid.
    filtered : ndarray, (e,)
        Densities before their projection.
    motion_m : float
        That of its section in plane strain, on a fine mesh [m].

    Raises
    ------
    ModelError
        If no coarser grid resolves its walls.
    """
    found, cause = None, ""
    for cells in CELLS:
        try:
            few, cut = coarser(domain, filtered, cells)
            section = final_part(few, cut)
        except (ConfigError, ModelError) as error:  # nothing of a region, or of the part, is left
            cause = str(error)
            continue
        cause = section.leak
        if not cause:
            found = few, cut, reanalyse(few, section).motion_m
            if abs(found[2] / motion_m - 1.0) <= NEAR_ENOUGH:
                break
    if found is None:
        raise ModelError(f"with lids, on a grid of {cells} elements: {cause}", "lid_mm")
    few, cut, section_m = found
    mesh, wet = lidded_mesh(few, cut, SOLID)
    moved = moved_output(few, mesh, wet, 0.5 * few.task.height_m)
    middle = np.nan if moved.cause else _in_the_middle(few, mesh, moved.u)
    return LiddedMotion(mesh, moved, middle, section_m)


def _in_the_middle(domain: Domain, mesh: Mesh, u: Array) -> float:
    """Mean motion [m] of the edges of the output in the plane z = 0, of hex20 displaced by u (n, 3) [m]."""
    goal = domain.task.goal
    assert isinstance(goal, Farthest)
    is_there, along = output_at(goal, mesh.points, NEAR * min(domain.grid.edge_m))
    faces = mesh.faces_at(is_there)
    is_low = mesh.points[faces][..., 2] == 0.0
    faces, is_low = faces[is_low.any(axis=1)], is_low[is_low.any(axis=1)]
    ends = mesh.points[faces[:, :4][is_low[:, :4]].reshape(-1, 2)]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    middles = faces[:, 4:][is_low[:, 4:]]
    return float(length @ (u[middles] * along[middles]).sum(axis=1) / length.sum())


def lidded_surface(domain: Domain, cut: Contour) -> tuple[Array, Integers]:
    """Return the surface of a part with lids and mirror images: corners (n, 3) [m], triangles (t, 3)."""
    mesh, _ = lidded_mesh(domain, cut, Layers("quad4", 1, 1))
    points, triangles = mirrored_surface(*solid_surface(mesh), (*domain.task.mirrors, "z"))
    return points + np.array([0.0, 0.0, 0.5 * domain.task.height_m]), triangles
