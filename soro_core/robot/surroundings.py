"""What acts on an arm from outside, what it carries, and how its base moves. SI units."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, field_validator

from soro_core.config import Strict
from soro_core.robot.vectors import Vector3
from soro_core.rotation import rotation_exp

_NONE = (0.0, 0.0, 0.0)


class PointMass(Strict):
    """A mass without extent on the backbone."""

    place: float = Field(gt=0, description="metres of undeformed length from the base of the arm")
    mass: float = Field(ge=0, description="[kg]")


class Surface(Strict):
    """How an obstacle pushes back at a point of the arm that sinks in (`soro_core.model.forces.contact`)."""

    stiffness: float = Field(gt=0, description="normal force per depth at one point [N/m]")
    damping: float = Field(
        0.0, ge=0, description="relative growth of the normal force by the speed of sinking in [s/m]"
    )
    friction: float = Field(0.0, ge=0, description="coefficient of Coulomb's friction")
    slip_velocity: float = Field(
        1e-3, gt=0, description="speed at which friction has reached 0.71 of its limit [m/s]"
    )


class Plane(Surface):
    """A half space that the arm cannot enter; fixed in the world."""

    point: Vector3 = Field(description="a point of its surface, in the world [m]")
    normal: Vector3 = Field(description="direction out of it, in the world, of any length above 0")

    @field_validator("normal")
    @classmethod
    def _direction(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not math.hypot(*value) > 0.0:
            raise ValueError("a direction, not all zeros")
        return value


class Sphere(Surface):
    """A ball that the arm cannot enter; fixed in the world."""

    centre: Vector3 = Field(description="in the world [m]")
    radius: float = Field(gt=0, description="[m]")


class Contacts(Strict):
    """Obstacles, and the number of points of the arm that they act on."""

    planes: Annotated[tuple[Plane, ...], Field(strict=False)] = ()
    spheres: Annotated[tuple[Sphere, ...], Field(strict=False)] = ()
    points_per_link: int = Field(
        5, ge=1, le=200, description="evenly spaced up to the end of each link (of the original, if refined)"
    )


class TipConstraint(Strict):
    """A stiff spring and damper that holds the tip at a point of the world and leaves it free to turn."""

    point: Vector3 = Field(description="in the world [m]")
    axes: Annotated[tuple[Literal["x", "y", "z"], ...], Field(strict=False, min_length=1)] = Field(
        ("x", "y", "z"), description="directions of the world in which it is held"
    )
    stiffness: float = Field(1e5, gt=0, description="[N/m]")
    damping: float = Field(100.0, ge=0, description="[N s/m]")

    @field_validator("axes")
    @classmethod
    def _once(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(value)) != len(value):
            raise ValueError("each of x, y, z at most once")
        return value


class BaseState(NamedTuple):
    """Where the base is and how it moves, all in the world; by default as the robot file has it, at rest.

    Attributes
    ----------
    displacement : (3,)
        From the base position of the robot file [m].
    velocity, acceleration : (3,)
        Its rates [m/s, m/s^2].
    rotation : (3, 3)
        Turns the base from its orientation in the robot file, about its origin.
    angular_velocity, angular_acceleration : (3,)
        [rad/s, rad/s^2].
    """

    displacement: ArrayLike = _NONE
    velocity: ArrayLike = _NONE
    acceleration: ArrayLike = _NONE
    rotation: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    angular_velocity: ArrayLike = _NONE
    angular_acceleration: ArrayLike = _NONE


class Shake(Strict):
    """A base that swings about its pose in the robot file: sin(2 pi frequency t) times the amplitudes."""

    frequency_hz: float = Field(1.0, gt=0, le=1000, description="[Hz]")
    amplitude_m: Vector3 = Field(_NONE, description="of its place, in the world [m]; 0: at rest")
    amplitude_rad: Vector3 = Field(_NONE, description="of its rotation vector, in the world [rad]")

    @property
    def moves(self) -> bool:
        """Whether an amplitude is above 0."""
        return any(self.amplitude_m) or any(self.amplitude_rad)

    def __call__(self, t: float) -> BaseState:
        """Return the state of the base at a time [s]."""
        rate = 2.0 * math.pi * self.frequency_hz
        there, turned = np.array(self.amplitude_m), np.array(self.amplitude_rad)
        x, v = math.sin(rate * t), rate * math.cos(rate * t)
        a = -(rate**2) * x
        return BaseState(x * there, v * there, a * there, rotation_exp(x * turned), v * turned, a * turned)
