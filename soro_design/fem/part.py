"""A part: a mesh of a material under loads; its forces and its stiffness at a displacement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError
from soro_design.fem.contact import Barrier, Contact, make_barrier
from soro_design.fem.elements.element import element
from soro_design.fem.elements.fibres import add_fibres
from soro_design.fem.elements.follower import add_pressure
from soro_design.fem.elements.material import Hyperelastic, Material
from soro_design.fem.elements.mesh import Mesh
from soro_design.fem.elements.pattern import Pattern, make_pattern
from soro_design.fem.elements.response import BULK
from soro_design.fem.elements.solid import assemble, tables
from soro_design.fem.loads import Loads
from soro_design.fem.rim import check_closed

_NO_DATA = np.empty(0)
# Kinds that have one volume ratio where the material allows it (docs/adr/0078-tetrahedra.md).
AVERAGED = ("quad4", "hex8", "tet10")
# Bulk modulus over the shear modulus that acts on J itself in a tet10: with none, one element across a wall
# bends by half too far; with all it locks.
KEPT = 5.0


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
    coupling : sparse matrix or None
        More of it, outside that pattern: of surfaces in contact.
    """

    inverted: int
    energy: float
    size: float
    unbalanced: Array
    data: Array
    coupling: Any = None


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
        Whether each element has one volume ratio, which keeps quad4, hex8 and tet10 from locking.
    pattern : Pattern
        Of the stiffness.
    slope, hoop, volume : ndarray, (e, g, a, d), (e, g, a) and (e, g)
        Derivatives of the shape functions [1/m], N / R [1/m] and volume [m3] at the points of integration;
        plane strain is 1 m thick, and about an axis the part is a whole ring.
    contact : Barrier or None
        Of surfaces that come near each other or obstacles.
    stiffer : ndarray, (e,)
        How many times as stiff as the material each element is.
    """

    mesh: Mesh
    material: Material
    loads: Loads
    is_averaged: bool
    pattern: Pattern
    slope: Array
    hoop: Array
    volume: Array
    _faces: tuple[Integers, ...]
    _pieces: tuple[Integers, ...]
    contact: Barrier | None
    stiffer: Array

    @property
    def shared(self) -> float:
        """Share of the bulk modulus that acts on the one volume ratio of an element, from 0 to 1."""
        if not self.is_averaged:
            return 0.0
        if self.mesh.kind != "tet10":
            return 1.0
        return max(0.0, 1.0 - KEPT * self.material.shear_modulus_pa / float(self.material.law[BULK]))

    def under(self, loads: Loads) -> Part:
        """Return the part under other loads.

        Raises
        ------
        ModelError
            If a pressure acts on what is no face, or on a cavity that is open.
        """
        faces = tuple(self.pattern.entries(one.faces) for one in loads.pressures)
        pieces = tuple(self.pattern.entries(one.pieces) for one in loads.fibres)
        check_closed(self.mesh, loads)
        return replace(self, loads=loads, _faces=faces, _pieces=pieces)

    def balance(
        self, u: Array, load: float, with_stiffness: bool = True, before: Array | None = None
    ) -> Balance:
        """Return the forces of the part.

        Parameters
        ----------
        u : ndarray, (n, d)
            Displacements of the nodes [m].
        load : float
            Factor of pressures and forces.
        with_stiffness : bool
            Whether to compute the stiffness too.
        before : ndarray, (n, d), optional
            Displacements one step of Newton's method before: then its pressures take the stiffness, (10a).
        """
        data = np.zeros(len(self.pattern.keys)) if with_stiffness else _NO_DATA
        inner = np.zeros_like(u)
        mesh = self.mesh
        energy, inverted = assemble(
            (self.material.law, self.shared),
            mesh.cells,
            # Energy, forces and stiffness are all in proportion to the volume.
            (self.slope, self.hoop, self.stiffer[:, None] * self.volume),
            (u, u if before is None else before),
            inner,
            (self.pattern.cells, data),
        )
        for fibre, entries in zip(self.loads.fibres, self._pieces, strict=True):
            of = fibre.pieces, fibre.stiffness_n, load * fibre.tension_n
            energy += add_fibres(of, (mesh.points, mesh.points + u), inner, (entries, data))
        by_springs = self.loads.springs * u
        size = max(float(np.linalg.norm(inner)), float(np.linalg.norm(by_springs)))
        unbalanced, coupling = inner + by_springs, None
        if inverted < 0:
            self._add_loads(load, u, unbalanced, data)
            if with_stiffness:
                data[self.pattern.diagonal()] += self.loads.springs.ravel()
            if self.contact is not None:
                coupling = self.contact.add(u, unbalanced, with_stiffness)
        return Balance(int(inverted), float(energy), size, unbalanced, data, coupling)

    def _add_loads(self, load: float, u: Array, unbalanced: Array, data: Array) -> None:
        """Subtract the forces of the loads at a factor, and add their stiffness unless `data` is empty."""
        unbalanced -= load * self.loads.force
        face, is_revolved = element(self.mesh.element.face), self.mesh.space == "axisymmetric"
        tables = (face.shape, face.slope, face.weight)
        x = self.mesh.points + u
        for one, entries in zip(self.loads.pressures, self._faces, strict=True):
            pressure = load * one.pressure_pa
            add_pressure(pressure, is_revolved, (one.faces, *tables), x, unbalanced, (entries, data))

    def push(self, u: Array) -> Array:
        """Return the forces (n, d) of the loads at load factor 1 [N]; they are proportional to it."""
        against = np.zeros_like(u)
        self._add_loads(1.0, u, against, _NO_DATA)
        places = (self.mesh.points, self.mesh.points + u)
        for fibre, entries in zip(self.loads.fibres, self._pieces, strict=True):
            slack = np.zeros_like(fibre.stiffness_n)  # their stiffness is none of the loads
            add_fibres((fibre.pieces, slack, fibre.tension_n), places, against, (entries, _NO_DATA))
        return -against

    def matrix(self, balance: Balance) -> Any:
        """Return d(unbalanced)/d(displacement) as a sparse matrix (n d, n d)."""
        inner = self.pattern.matrix(balance.data)
        return inner if balance.coupling is None else (inner + balance.coupling).tocsc()

    def stiffness(self, u: Array, load: float) -> Any:
        """Return d(unbalanced)/d(displacement) as a sparse matrix (n d, n d), parameters as in `balance`."""
        return self.matrix(self.balance(u, load))

    def reach(self, u: Array, v: Array) -> float:
        """Return how much of the way between displacements u and v (n, d) no surfaces meet on, 0 to 1."""
        return 1.0 if self.contact is None else self.contact.reach(u, v)

    @property
    def usual_iterations(self) -> int:
        """Iterations that a load step may take: more where surfaces meet."""
        return 12 if self.contact is None else 60

    def weight(self, gravity: ArrayLike) -> Array:
        """Return the forces (n, d) [N] of gravity (d,) [m/s2] on the undeformed mass, for `Loads.pull`."""
        each = self.material.density_kg_per_m3 * self.volume @ self.mesh.element.shape
        total = np.zeros_like(self.mesh.points)
        np.add.at(total, self.mesh.cells, each[:, :, None] * np.asarray(gravity, dtype=float))
        return total


def make_part(
    mesh: Mesh,
    material: Material,
    loads: Loads,
    is_averaged: bool | None = None,
    contact: Contact | None = None,
    stiffer: ArrayLike = 1.0,
) -> Part:
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
        Whether each element has one volume ratio; by default quad4, hex8 and tet10 of a
        hyperelastic material do.
    contact : Contact, optional
        How its surfaces keep off each other and obstacles; needs the extra `design`.
    stiffer : array-like, (e,) or one number
        How many times as stiff as the material each element is; its density is the same.

    Raises
    ------
    ModelError
        If `is_averaged` asks for what the material does not have, a pressure acts on an open cavity, or
        surfaces are nearer than contact allows before any load.
    MissingPackageError
        If there is contact, and ipctk is not installed.
    """
    can_average = isinstance(material, Hyperelastic)
    if is_averaged is None:
        is_averaged = can_average and mesh.kind in AVERAGED
    if is_averaged and not can_average:
        raise ModelError("is_averaged of St. Venant-Kirchhoff; allowed: of a hyperelastic law", "is_averaged")
    pattern = make_pattern(mesh.cells, *mesh.points.shape)
    barrier = None if contact is None else make_barrier(mesh, contact, material.shear_modulus_pa)
    read = tables(mesh, mesh.cells)
    times = np.broadcast_to(np.asarray(stiffer, dtype=float), len(mesh.cells)).copy()
    if not (np.isfinite(times) & (times > 0.0)).all():
        raise ModelError("stiffer of elements: not finite or not above 0; allowed: above 0", "stiffer")
    part = Part(mesh, material, loads, is_averaged, pattern, *read, (), (), barrier, times)
    return part.under(loads)
