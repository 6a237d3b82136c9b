"""A part: a mesh of a material under loads; its forces and its stiffness at a displacement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from soro_core.errors import ModelError
from soro_core.fem.element import element
from soro_core.fem.fibres import add_fibres
from soro_core.fem.follower import add_pressure
from soro_core.fem.loads import Loads
from soro_core.fem.material import Hyperelastic, Material
from soro_core.fem.mesh import Mesh
from soro_core.fem.pattern import Pattern, make_pattern
from soro_core.fem.response import Array, Indices
from soro_core.fem.solid import assemble

_NO_DATA = np.empty(0)


@dataclass(frozen=True, eq=False)
class Balance:
    """Forces of a part at a displacement.

    Attributes
    ----------
    inverted : int
        First element with J <= 0, or -1; if there is one, nothing else here has a meaning.
    energy : float
        Strain energy [J]; in plane strain per thickness [J/m].
    size : float
        The greater norm of the forces of stresses and fibres and of those of the springs [N].
    unbalanced : ndarray, (n, d)
        Forces of stresses, fibres and springs minus those of the loads [N]; at held nodes, of the support.
    data : ndarray
        Entries of d(unbalanced)/d(displacement) in the pattern of the part, or none.
    """

    inverted: int
    energy: float
    size: float
    unbalanced: Array
    data: Array


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh of a material under loads; make one with `make_part`.

    Attributes
    ----------
    mesh : Mesh
        The undeformed part.
    material : Material
        Of all its elements.
    loads : Loads
        At load factor 1.
    is_averaged : bool
        Whether each element has one volume ratio, which keeps quad4 and hex8 from locking.
    pattern : Pattern
        Of the stiffness.
    slope, hoop, volume : ndarray, (e, g, a, d), (e, g, a) and (e, g)
        Derivatives of the shape functions [1/m], N / R [1/m] and volume [m3] at the points of integration;
        plane strain is 1 m thick, and about an axis the part is a whole ring.
    """

    mesh: Mesh
    material: Material
    loads: Loads
    is_averaged: bool
    pattern: Pattern
    slope: Array
    hoop: Array
    volume: Array
    _faces: tuple[Indices, ...]
    _pieces: tuple[Indices, ...]

    def under(self, loads: Loads) -> Part:
        """Return the part under other loads."""
        faces = tuple(self.pattern.entries(one.faces) for one in loads.pressures)
        pieces = tuple(self.pattern.entries(one.pieces) for one in loads.fibres)
        return replace(self, loads=loads, _faces=faces, _pieces=pieces)

    def balance(self, u: Array, load: float, with_stiffness: bool = True) -> Balance:
        """Return the forces of the part.

        Parameters
        ----------
        u : ndarray, (n, d)
            Displacements of the nodes [m].
        load : float
            Factor of pressures and forces.
        with_stiffness : bool
            Whether to compute the stiffness too.
        """
        data = np.zeros(len(self.pattern.keys)) if with_stiffness else _NO_DATA
        inner = np.zeros_like(u)
        mesh = self.mesh
        energy, inverted = assemble(
            self.material.law,
            self.is_averaged,
            mesh.cells,
            self.slope,
            self.hoop,
            self.volume,
            self.pattern.cells,
            u,
            inner,
            data,
        )
        for fibre, entries in zip(self.loads.fibres, self._pieces, strict=True):
            stretched = (mesh.points, mesh.points + u, entries, inner, data)
            energy += add_fibres(fibre.pieces, fibre.stiffness_n, load * fibre.tension_n, *stretched)
        by_springs = self.loads.springs * u
        size = max(float(np.linalg.norm(inner)), float(np.linalg.norm(by_springs)))
        unbalanced = inner + by_springs - load * self.loads.force
        if inverted < 0:
            face = element(mesh.element.face)
            for one, entries in zip(self.loads.pressures, self._faces, strict=True):
                add_pressure(
                    load * one.pressure_pa,
                    mesh.space == "axisymmetric",
                    one.faces,
                    face.shape,
                    face.slope,
                    face.weight,
                    entries,
                    mesh.points + u,
                    unbalanced,
                    data,
                )
            if with_stiffness:
                data[self.pattern.diagonal()] += self.loads.springs.ravel()
        return Balance(int(inverted), float(energy), size, unbalanced, data)

    def stiffness(self, u: Array, load: float) -> Any:
        """Return d(unbalanced)/d(displacement) as a sparse matrix (n d, n d), parameters as in `balance`."""
        return self.pattern.matrix(self.balance(u, load).data)

    def weight(self, gravity: ArrayLike) -> Array:
        """Return the forces (n, d) [N] of gravity (d,) [m/s2] on the undeformed mass, for `Loads.pull`."""
        each = self.material.density_kg_per_m3 * self.volume @ self.mesh.element.shape
        total = np.zeros_like(self.mesh.points)
        np.add.at(total, self.mesh.cells, each[:, :, None] * np.asarray(gravity, dtype=float))
        return total


def make_part(mesh: Mesh, material: Material, loads: Loads, is_averaged: bool | None = None) -> Part:
    """Return a part.

    Parameters
    ----------
    mesh : Mesh
        The undeformed part.
    material : Material
        Of all its elements.
    loads : Loads
        At load factor 1.
    is_averaged : bool, optional
        Whether each element has one volume ratio; by default quad4 and hex8 of a hyperelastic material do.
    """
    can_average = isinstance(material, Hyperelastic)
    if is_averaged is None:
        is_averaged = can_average and mesh.kind in ("quad4", "hex8")
    if is_averaged and not can_average:
        raise ModelError("is_averaged of St. Venant-Kirchhoff; allowed: of a hyperelastic law", "is_averaged")
    one = mesh.element
    at = mesh.points[mesh.cells]
    by_xi = np.einsum("ead,gak->egdk", at, one.slope)
    slope = np.einsum("gak,egkd->egad", one.slope, np.linalg.inv(by_xi))
    volume = np.linalg.det(by_xi) * one.weight
    hoop = np.zeros(slope.shape[:3])
    if mesh.space == "axisymmetric":
        radius = at[:, :, 0] @ one.shape.T
        hoop = one.shape[None] / radius[:, :, None]
        volume = volume * 2.0 * np.pi * radius
    pattern = make_pattern(mesh.cells, *mesh.points.shape)
    part = Part(
        mesh, material, loads, is_averaged, pattern, np.ascontiguousarray(slope), hoop, volume, (), ()
    )
    return part.under(loads)
