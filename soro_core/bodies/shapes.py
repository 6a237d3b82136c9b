"""Shapes of rigid bodies: their sizes for the kernels, and the inertia of solid ones. SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, field_validator, model_validator

from soro_core.arrays import Array
from soro_core.bodies.polyhedron import Polyhedron, corners_of_mesh, polyhedron
from soro_core.config import InnerError, Points, Strict
from soro_core.errors import ModelError
from soro_core.files.stl import read_stl
from soro_core.robot.vectors import Vector3

_ZERO = (0.0, 0.0, 0.0)
# Lengths of a body [m]: beyond these a unit is wrong.
_SMALL, _LARGE = 1e-4, 100.0
_Length = Annotated[float, Field(ge=_SMALL, le=_LARGE)]


class BallShape(Strict):
    """A ball."""

    kind: Literal["ball"] = Field("ball", description="the word for it in a file")
    radius: _Length = Field(description="[m]")

    def extents(self) -> tuple[tuple[float, ...], float]:
        """Return sizes and bounding radius for the kernels."""
        return (self.radius, 0.0, 0.0), self.radius

    def inertia_per_mass(self) -> Array:
        """Moments of inertia of a solid one about its axes per kg, (3,) [m^2]."""
        return np.full(3, 0.4 * self.radius**2)


class CapsuleShape(Strict):
    """A cylinder along z between two half balls."""

    kind: Literal["capsule"] = Field("capsule", description="the word for it in a file")
    radius: _Length = Field(description="[m]")
    length: _Length = Field(description="of the cylinder, without the half balls [m]")

    def extents(self) -> tuple[tuple[float, ...], float]:
        """Return sizes and bounding radius for the kernels."""
        return (self.radius, 0.5 * self.length, 0.0), self.radius + 0.5 * self.length

    def inertia_per_mass(self) -> Array:
        """Moments of inertia of a solid one about its axes per kg, (3,) [m^2]."""
        r, d = self.radius, self.length
        tube = d / (d + 4.0 * r / 3.0)
        across = tube * (r * r / 4 + d * d / 12) + (1 - tube) * (0.4 * r * r + d * d / 4 + 3 * d * r / 8)
        return np.array([across, across, tube * 0.5 * r * r + (1 - tube) * 0.4 * r * r])


class CylinderShape(Strict):
    """A cylinder along z."""

    kind: Literal["cylinder"] = Field("cylinder", description="the word for it in a file")
    radius: _Length = Field(description="[m]")
    length: _Length = Field(description="[m]")

    def extents(self) -> tuple[tuple[float, ...], float]:
        """Return sizes and bounding radius for the kernels."""
        half = 0.5 * self.length
        return (self.radius, half, 0.0), math.hypot(self.radius, half)

    def inertia_per_mass(self) -> Array:
        """Moments of inertia of a solid one about its axes per kg, (3,) [m^2]."""
        across = self.radius**2 / 4 + self.length**2 / 12
        return np.array([across, across, 0.5 * self.radius**2])


class BoxShape(Strict):
    """A box."""

    kind: Literal["box"] = Field("box", description="the word for it in a file")
    size: Vector3 = Field(description="lengths of its edges along x, y, z [m]")

    @field_validator("size")
    @classmethod
    def _bounded(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not all(_SMALL <= one <= _LARGE for one in value):
            raise ValueError(f"three lengths of {_SMALL:g} to {_LARGE:g} m")
        return value

    def extents(self) -> tuple[tuple[float, ...], float]:
        """Return sizes and bounding radius for the kernels."""
        half = tuple(0.5 * one for one in self.size)
        return half, math.hypot(*half)

    def inertia_per_mass(self) -> Array:
        """Moments of inertia of a solid one about its axes per kg, (3,) [m^2]."""
        square = np.array(self.size) ** 2
        return np.asarray((square.sum() - square) / 12.0)


class StlFile(Strict):
    """A convex mesh of an STL file, in place of its corners."""

    kind: Literal["mesh"] = Field("mesh", description="the word for it in a file")
    file: str = Field(description="an STL file of a closed convex mesh")
    unit_m: float = Field(1e-3, gt=0, le=1.0, description="unit of the file [m]")

    def corners(self) -> Array:
        """Read the corners of the hull, (n, 3) [m].

        Raises
        ------
        ValueError
            If the file cannot be read, or its mesh is not convex.
        """
        try:
            return corners_of_mesh(*read_stl(self.file, self.unit_m))
        except ModelError as error:
            why = str(error).partition("; allowed")[0]
            raise ValueError(f"an STL file; {why}") from None


class MeshShape(Strict):
    """A convex polyhedron: the hull of its corners, about its centre of mass."""

    kind: Literal["mesh"] = Field("mesh", description="the word for it in a file")
    corners: Points = Field(
        description="x, y, z of each [m], of any origin; or file: an STL file, and its unit_m (1e-3)"
    )

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any) -> Any:
        """Take the corners from a file, so that what is kept of a run holds them."""
        if not isinstance(data, Mapping) or "file" not in data:
            return data
        try:
            given = StlFile.model_validate(data)
        except ValidationError as error:
            raise InnerError(error, StlFile) from None
        return {"kind": given.kind, "corners": given.corners().tolist()}

    @field_validator("corners")
    @classmethod
    def _convex(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if len(value) % 3:
            raise ValueError(f"x, y and z of each corner, not {len(value)} numbers")
        rows = np.reshape(value, (-1, 3))
        if not (value and np.ptp(rows, axis=0).max() >= _SMALL and np.abs(rows).max() <= _LARGE):
            raise ValueError(
                f"corners {_SMALL:g} m apart or more, and at most {_LARGE:g} m from their origin"
            )
        polyhedron(value)
        return value

    @property
    def solid(self) -> Polyhedron:
        """The polyhedron, about its centre of mass."""
        return polyhedron(self.corners)

    def extents(self) -> tuple[tuple[float, ...], float]:
        """Return sizes, here the distance of the nearest face, and bounding radius for the kernels."""
        own = self.solid
        return (float(own.planes[:, 3].min()), 0.0, 0.0), float(np.linalg.norm(own.corners, axis=1).max())

    def inertia_per_mass(self) -> Array:
        """Moments of inertia of a solid one about its principal axes per kg, (3,) [m^2]."""
        return self.solid.principal


class GroundShape(Strict):
    """The half space z <= 0 of the body's frame; of a fixed body alone."""

    kind: Literal["ground"] = Field("ground", description="the word for it in a file")

    def extents(self) -> tuple[tuple[float, ...], float]:
        """Return sizes and bounding radius for the kernels."""
        return _ZERO, 0.0

    def inertia_per_mass(self) -> Array:
        """Zeros: it does not turn."""
        return np.zeros(3)
