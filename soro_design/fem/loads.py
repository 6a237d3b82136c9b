"""Loads of a part: what is held, pressed, pulled, sprung and reinforced."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array, Integers
from soro_core.errors import ModelError
from soro_design.fem.elements.element import element
from soro_design.fem.elements.fibres import Fibres
from soro_design.fem.elements.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Pressure:
    """A pressure on faces that stays normal to them as they move.

    Attributes
    ----------
    faces : ndarray of int, (f, m)
        Faces of the boundary, turned outwards (`Mesh.faces_at`).
    pressure_pa : float
        Above that of the surroundings; positive pushes into the material.
    is_patch : bool
        Whether the faces are meant to be an open surface; else they have to close a cavity (`fem.rim`).
    """

    faces: Integers
    pressure_pa: float
    is_patch: bool = False


@dataclass(frozen=True, eq=False)
class Loads:
    """All loads at load factor 1; begin with `no_loads` and add to it.

    Attributes
    ----------
    held : ndarray, (n, d)
        Prescribed displacements [m], NaN where a node is free.
    force : ndarray, (n, d)
        Forces that keep their direction [N]; in plane strain N/m of thickness, about an axis those of the
        whole ring.
    springs : ndarray, (n, d)
        Stiffness [N/m] of springs between nodes and the ground; the load factor does not scale it.
    pressures : tuple of Pressure
        Pressures that follow the faces.
    fibres : tuple of Fibres
        Fibres and tendons; the load factor scales the tension alone.
    """

    held: Array
    force: Array
    springs: Array
    pressures: tuple[Pressure, ...] = ()
    fibres: tuple[Fibres, ...] = ()

    def hold(self, nodes: ArrayLike, direction: int, displacement_m: float | Array = 0.0) -> Loads:
        """Return the loads with nodes held in a direction.

        Parameters
        ----------
        nodes : array_like of bool or int
            Which nodes.
        direction : int
            0 for x or r, 1 for y or z of a section, 2 for z of a solid.
        displacement_m : float or ndarray
            Of them at load factor 1.

        Raises
        ------
        ModelError
            If there is no such direction, or a displacement is not finite.
        """
        if direction not in range(self.held.shape[1]):
            raise ModelError(f"direction {direction}; allowed: 0 to {self.held.shape[1] - 1}", "direction")
        if not np.isfinite(displacement_m).all():
            raise ModelError(f"displacement_m {displacement_m}; allowed: finite numbers", "displacement_m")
        held = self.held.copy()
        held[np.asarray(nodes), direction] = displacement_m
        return replace(self, held=held)

    def press(self, faces: Integers, pressure_pa: float, is_patch: bool = False) -> Loads:
        """Return the loads with a pressure on faces.

        Parameters
        ----------
        faces : ndarray of int, (f, m)
            Faces of the boundary that close a cavity, but for a rim that is held or in a plane of symmetry.
        pressure_pa : float
            Above that of the surroundings; positive pushes into the material.
        is_patch : bool
            Whether the faces may be an open surface.

        Raises
        ------
        ModelError
            If the pressure is not finite.
        """
        if not np.isfinite(pressure_pa):
            raise ModelError(f"pressure_pa {pressure_pa}; allowed: a finite number", "pressure_pa")
        return replace(self, pressures=(*self.pressures, Pressure(faces, float(pressure_pa), is_patch)))

    def pull(self, force: Array) -> Loads:
        """Return the loads with more forces (n, d) [N].

        Raises
        ------
        ModelError
            If they are not finite, or not of that shape.
        """
        if force.shape != self.force.shape or not np.isfinite(force).all():
            raise ModelError(f"force of shape {force.shape}; allowed: finite, {self.force.shape}", "force")
        return replace(self, force=self.force + force)

    def spring(self, stiffness: Array) -> Loads:
        """Return the loads with more springs (n, d) [N/m].

        Raises
        ------
        ModelError
            If one is negative or not finite, or they are not of that shape.
        """
        is_allowed = np.isfinite(stiffness) & (stiffness >= 0.0)
        if stiffness.shape != self.springs.shape or not is_allowed.all():
            raise ModelError(
                f"stiffness of shape {stiffness.shape}; allowed: finite, 0 or more, {self.springs.shape}",
                "stiffness",
            )
        return replace(self, springs=self.springs + stiffness)

    def reinforce(self, fibres: Fibres) -> Loads:
        """Return the loads with more fibres or tendons."""
        return replace(self, fibres=(*self.fibres, fibres))


def no_loads(mesh: Mesh) -> Loads:
    """Return loads under which all nodes are free; those on an axis of revolution stay on it."""
    shape = mesh.points.shape
    held = np.full(shape, np.nan)
    if mesh.space == "axisymmetric":
        held[mesh.points[:, 0] == 0.0, 0] = 0.0
    return Loads(held, np.zeros(shape), np.zeros(shape))


def traction(mesh: Mesh, faces: Integers, stress_pa: ArrayLike) -> Array:
    """Return the forces (n, d) [N] of a stress vector (d,) that keeps its direction, per undeformed area.

    Parameters
    ----------
    mesh : Mesh
        The mesh.
    faces : ndarray of int, (f, m)
        Faces on which it acts.
    stress_pa : array_like, (d,)
        Force per area.
    """
    share = np.einsum("fg,ga->fa", _face_areas(mesh, faces), element(mesh.element.face).shape)
    return _spread(mesh, faces, share, np.asarray(stress_pa, dtype=float))


def spread_force(mesh: Mesh, faces: Integers, force_n: ArrayLike) -> Array:
    """Return the forces (n, d) [N] of a force (d,) that faces share by their undeformed area.

    Parameters
    ----------
    mesh : Mesh
        The mesh.
    faces : ndarray of int, (f, m)
        Faces on which it acts.
    force_n : array_like, (d,)
        Their sum [N].
    """
    return traction(mesh, faces, np.asarray(force_n, dtype=float) / _face_areas(mesh, faces).sum())


def spread_spring(mesh: Mesh, faces: Integers, stiffness: ArrayLike) -> Array:
    """Return springs (n, d) [N/m] that share a stiffness per undeformed area (d,) [N/m3].

    Parameters
    ----------
    mesh : Mesh
        The mesh.
    faces : ndarray of int, (f, m)
        Faces that the springs hold.
    stiffness : array_like, (d,)
        Stiffness per area in each direction.
    """
    face = element(mesh.element.face)
    # The square of a shape function, which is positive also where its own integral is not.
    area = _face_areas(mesh, faces)
    share = np.einsum("fg,ga->fa", area, face.shape**2)
    share *= (area.sum(axis=1) / share.sum(axis=1))[:, None]
    return _spread(mesh, faces, share, np.asarray(stiffness, dtype=float))


def _face_areas(mesh: Mesh, faces: Integers) -> Array:
    """Undeformed areas (f, g) of the points of integration of faces."""
    face = element(mesh.element.face)
    at = mesh.points[faces]
    tangent = np.einsum("fad,gak->fgdk", at, face.slope)
    metric = np.einsum("fgdk,fgdm->fgkm", tangent, tangent)
    area = np.sqrt(np.linalg.det(metric)) * face.weight
    if mesh.space == "axisymmetric":
        area = area * 2.0 * np.pi * np.einsum("fa,ga->fg", at[:, :, 0], face.shape)
    return np.asarray(area)


def _spread(mesh: Mesh, faces: Integers, share: Array, each: Array) -> Array:
    total = np.zeros_like(mesh.points)
    np.add.at(total, faces, share[:, :, None] * each)
    return total
