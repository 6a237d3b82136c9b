"""Contact of surfaces with each other and with obstacles, by barriers of ipctk, docs/design.md (12).

Surfaces meet as polygons or triangles through their nodes. They cannot cross: the barrier grows beyond all
bounds as a distance falls to 0, and no step of Newton's method goes past the first touch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError
from soro_core.extras import named_packages
from soro_design.fem.elements.mesh import Mesh
from soro_design.fem.meshes.surface import pieces


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A rigid surface that does not move.

    Attributes
    ----------
    points : ndarray, (n, d)
        Corners [m].
    pieces : ndarray of int, (p, d)
        Corners of each line of a section, or of each triangle of a solid.
    """

    points: Array
    pieces: Integers


@dataclass(frozen=True, eq=False)
class Contact:
    """What keeps off what, and how near.

    Attributes
    ----------
    distance_m : float
        At which surfaces begin to push; well below the edges of elements and the walls of the part.
    stiffness_pa : float, optional
        Of the barrier: about the pressure of surfaces at .3 of that distance; by default the shear modulus.
    obstacles : tuple of Obstacle
        What the part may meet besides itself.
    """

    distance_m: float
    stiffness_pa: float | None = None
    obstacles: tuple[Obstacle, ...] = ()

    def __post_init__(self) -> None:
        for key, value in (("distance_m", self.distance_m), ("stiffness_pa", self.stiffness_pa)):
            if value is not None and not 0.0 < value < np.inf:
                raise ModelError(f"{key} {value}; allowed: a number above 0", key)


class Barrier:
    """The potential between the surface of a mesh, itself and obstacles; make one with `make_barrier`.

    Parameters
    ----------
    mesh : Mesh
        The undeformed part.
    contact : Contact
        Distance, stiffness and obstacles.
    stiffness_pa : float
        Of the barrier where the contact states none.

    Attributes
    ----------
    obstacles : tuple of Obstacle
    """

    def __init__(self, mesh: Mesh, contact: Contact, stiffness_pa: float) -> None:
        with named_packages():
            import ipctk
        self._ipc = ipctk
        d = mesh.points.shape[1]
        faces, is_revolved = mesh.boundary(), mesh.space == "axisymmetric"
        if is_revolved:
            # The axis is no surface.
            faces = faces[(mesh.points[faces, 0] > 0.0).any(axis=1)]
        own = pieces(faces)
        self.nodes, inverse = np.unique(own, return_inverse=True)
        points, all_pieces = [mesh.points[self.nodes]], [inverse.reshape(own.shape)]
        for one in contact.obstacles:
            all_pieces.append(np.asarray(one.pieces) + sum(len(these) for these in points))
            points.append(np.asarray(one.points, dtype=float))
        self._at_rest = np.asfortranarray(np.concatenate(points))
        joined = np.asfortranarray(np.concatenate(all_pieces).astype(np.int32))
        edges = joined if d == 2 else ipctk.edges(joined)
        triangles = np.empty((0, 3), np.int32, order="F") if d == 2 else joined
        self._surfaces = ipctk.CollisionMesh(self._at_rest, edges, triangles)
        self._surfaces.can_collide = ipctk.make_static_obstacle_filter(len(self.nodes))
        self.distance_m, self.obstacles = contact.distance_m, contact.obstacles
        self._potential = ipctk.BarrierPotential(
            contact.distance_m, contact.stiffness_pa or stiffness_pa, use_physical_barrier=True
        )
        self._around = _around(self._at_rest, np.asarray(edges, dtype=np.int64)) if is_revolved else None
        # The default takes seconds where points move far along a face.
        self._first_touch = ipctk.AdditiveCCD()
        self._shape = mesh.points.shape
        self._row = (self.nodes[:, None] * d + np.arange(d)).ravel()

    def places(self, u: Array) -> Array:
        """Deformed places of the surfaces [m]."""
        x = self._at_rest.copy(order="F")
        x[: len(self.nodes)] += u[self.nodes]
        return x

    def pairs(self, x: Array) -> Any:
        """Return what is near each other, weighted by its undeformed area, about an axis that of the ring."""
        near = self._ipc.NormalCollisions()
        near.use_area_weighting = True
        near.build(self._surfaces, x, self.distance_m)
        if self._around is not None:
            edges, triangles = self._surfaces.edges, self._surfaces.faces
            for k in range(len(near)):
                ids = near[k].vertex_ids(edges, triangles)
                # A node beside a line, or two nodes; no triangles in a section.
                of = ids[:1] if near.is_edge_vertex(k) else ids[:2]
                near[k].weight *= float(self._around[list(of)].mean())
        return near

    def add(self, u: Array, force: Array, with_stiffness: bool) -> Any:
        """Add the forces of the barrier to those of the part; return its stiffness, or None.

        Parameters
        ----------
        u : ndarray, (n, d)
            Displacements of the nodes [m].
        force : ndarray, (n, d)
            Forces of the part [N], which grow by those of the barrier.
        with_stiffness : bool
            Whether to return a sparse matrix (n d, n d) where surfaces are near each other.
        """
        x = self.places(u)
        near = self.pairs(x)
        if len(near) == 0:
            return None
        own = len(self._row)
        gradient = self._potential.gradient(near, self._surfaces, x)[:own]
        force[self.nodes] += gradient.reshape(len(self.nodes), -1)
        if not with_stiffness:
            return None
        found = self._potential.hessian(near, self._surfaces, x).tocoo()
        kept = (found.row < own) & (found.col < own)
        places = (self._row[found.row[kept]], self._row[found.col[kept]])
        size = self._shape[0] * self._shape[1]
        return coo_array((found.data[kept], places), shape=(size, size)).tocsc()

    def energy(self, u: Array) -> float:
        """Potential of the barrier at u [J]."""
        x = self.places(u)
        return float(self._potential(self.pairs(x), self._surfaces, x))

    def distance(self, u: Array) -> float:
        """Least distance of surfaces at u [m]; infinite where none are as near as `distance_m`."""
        x = self.places(u)
        return float(np.sqrt(self.pairs(x).compute_minimum_distance(self._surfaces, x)))

    def reach(self, u: Array, v: Array) -> float:
        """Return how much of the way from u to v surfaces can go before they meet, 0 to 1."""
        start, end = self.places(u), self.places(v)
        return float(
            self._ipc.compute_collision_free_stepsize(
                self._surfaces, start, end, narrow_phase_ccd=self._first_touch
            )
        )

    def is_crossed(self, u: Array) -> bool:
        """Whether surfaces cross at u."""
        return bool(self._ipc.has_intersections(self._surfaces, self.places(u)))


def _around(points: Array, lines: Integers) -> Array:
    """Mean 2 pi r (n,) [m] of the halves of lines beside each point, which is not 0 on the axis."""
    length = np.linalg.norm(points[lines[:, 1]] - points[lines[:, 0]], axis=1)
    total, weighted = np.zeros(len(points)), np.zeros(len(points))
    for one, other in (lines.T, lines.T[::-1]):
        np.add.at(total, one, length)
        np.add.at(weighted, one, length * 2.0 * np.pi * (0.75 * points[one, 0] + 0.25 * points[other, 0]))
    return weighted / total


def make_barrier(mesh: Mesh, contact: Contact, stiffness_pa: float) -> Barrier:
    """Return the barrier of a mesh.

    Parameters
    ----------
    mesh : Mesh
        The undeformed part.
    contact : Contact
        Distance, stiffness and obstacles.
    stiffness_pa : float
        Of the barrier where the contact states none.

    Raises
    ------
    ModelError
        If an obstacle has other dimensions, or surfaces are too near each other before any load.
    MissingPackageError
        If ipctk is not installed.
    """
    d = mesh.points.shape[1]
    for one in contact.obstacles:
        shapes = (np.shape(one.points), np.shape(one.pieces))
        if any(len(shape) != 2 or shape[1] != d for shape in shapes):
            allowed = f"points and pieces (n, {d})"
            raise ModelError(f"obstacles of shapes {shapes}; allowed: {allowed}", "obstacles")
    barrier = Barrier(mesh, contact, stiffness_pa)
    nearest = barrier.distance(np.zeros_like(mesh.points))
    if nearest < contact.distance_m or barrier.is_crossed(np.zeros_like(mesh.points)):
        raise ModelError(
            f"distance_m {contact.distance_m:g}: before any load surfaces, or nodes of one surface, are"
            f" {nearest:.3g} m from each other; allowed: less than that",
            "distance_m",
        )
    return barrier
