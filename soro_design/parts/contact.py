"""Contact of a part file: how its surfaces keep off each other, and rigid planes that they may meet."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from soro_core.config import Floats, Strict
from soro_design.fem.contact import Contact, Obstacle


class RigidPlane(Strict):
    """A rigid plane that does not move; of a section, a line."""

    through_m: Annotated[Floats, Field(description="its middle; of a section two numbers, else three")]
    normal: Annotated[Floats, Field(description="across it, of any length")]
    size_m: Annotated[float, Field(gt=0.0, description="length of its edges")]

    @field_validator("normal")
    @classmethod
    def _direction(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not any(value):
            raise ValueError("numbers that are not all 0")
        return value

    def obstacle(self) -> Obstacle:
        """Return it as a line or as two triangles."""
        middle, normal = np.array(self.through_m), np.array(self.normal)
        # The rows behind the first are at right angles to the normal.
        across = 0.5 * self.size_m * np.linalg.svd(normal[None])[2][1:]
        if len(middle) == 2:
            return Obstacle(middle + np.array([-across[0], across[0]]), np.array([[0, 1]]))
        corners = [a * across[0] + b * across[1] for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        return Obstacle(middle + corners, np.array([[0, 1, 2], [0, 2, 3]]))


class ContactKeys(Strict):
    """Contact of surfaces with each other and with planes (extra `design`)."""

    distance_m: Annotated[
        float, Field(gt=0.0, description="at which surfaces begin to push; well below walls and elements")
    ]
    stiffness_pa: Annotated[
        float | None, Field(gt=0.0, description="of the barrier; default: the shear modulus")
    ] = None
    planes: Annotated[tuple[RigidPlane, ...], Field(strict=False, description="that the part may meet")] = ()

    @property
    def contact(self) -> Contact:
        """For `make_part`."""
        return Contact(self.distance_m, self.stiffness_pa, tuple(plane.obstacle() for plane in self.planes))
