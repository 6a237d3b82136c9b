"""Shapes of rigid bodies: their sizes for the kernels, and the inertia of solid ones. SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from soro_core.arrays import Array
from soro_core.bodies.polyhedron import Polyhedron, corners_of_mesh, polyhedron
from soro_core.config import Points, Strict
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


class MeshShape(Strict):
    """A convex polyhedron: the hull of its corners."""

    kind: Literal["mesh"] = Field("mesh", description="the word for it in a file")
    corners: Points = Field(
        description="x, y, z of each [m], or a file; of any origin: the body counts from its centre of mass"
    )
    file: str = Field("", description="an STL file in place of the corners: a closed convex mesh")
    unit_m: float = Field(1e-3, gt=0, le=1.0, description="unit of the file")

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any) -> Any:
        """Take the corners from the file, so that what is kept of a run holds them."""
        if not isinstance(data, Mapping) or not (file := data.get("file")):
            return data
        if "corners" in data:
            raise ValueError("corners or file, not both")
        unit_m = data.get("unit_m", 1e-3)
        if not (isinstance(file, str) and isinstance(unit_m, float | int)):
            return data
        try:
            found = corners_of_mesh(*read_stl(file, float(unit_m)))
        except ModelError as error:
            raise ValueError(f"an STL file: {error}") from None
        return {"kind": "mesh", "corners": found.tolist()}

    @field_validator("corners")
    @classmethod
    def _convex(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if len(value) % 3:
            raise ValueError(f"x, y and z of each corner, not {len(value)} numbers")
        size = np.ptp(np.reshape(value, (-1, 3)), axis=0).max() if value else 0.0
        if not _SMALL <= size <= _LARGE:
            raise ValueError(f"corners that are {_SMALL:g} to {_LARGE:g} m apart")
        polyhedron(value)
        return value

    @property
    def solid(self) -> Polyhedron:
        """The polyhedron, about its centre of mass."""
        return polyhedron(self.corners)

    def extents(self) -> tuple[tuple[float, ...], float]:
        """Return sizes and bounding radius for the kernels."""
        own = self.solid
        return (float(own.planes[:, 3].min()), 0.0, 0.0), float(np.linalg.norm(own.corners, axis=1).max())

    def inertia_per_mass(self) -> Array:
        """Moments of inertia of a solid one about its principal axes per kg, (3,) [m^2]."""
        return self.solid.principal()[0]


class GroundShape(Strict):
    """The half space z <= 0 of the body's frame; of a fixed body alone."""

    kind: Literal["ground"] = Field("ground", description="the word for it in a file")

    def extents(self) -> tuple[tuple[float, ...], float]:
        """Return sizes and bounding radius for the kernels."""
        return _ZERO, 0.0

    def inertia_per_mass(self) -> Array:
        """Zeros: it does not turn."""
        return np.zeros(3)
