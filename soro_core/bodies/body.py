"""Rigid bodies: shapes, mass, and how they are held. SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from soro_core.arrays import Array
from soro_core.bodies.shapes import (
    BallShape,
    BoxShape,
    CapsuleShape,
    CylinderShape,
    GroundShape,
    MeshShape,
)
from soro_core.config import Floats, Points, Strict
from soro_core.errors import ConfigError
from soro_core.robot import BaseState
from soro_core.robot.description import END_TOLERANCE
from soro_core.robot.vectors import Quaternion, Vector3
from soro_core.rotation import matrix_from_quaternion, rotation_exp

GRAVITY = 9.81
"""Of the world, downwards along z [m/s^2]."""
_ZERO = (0.0, 0.0, 0.0)


def _check_times(at_s: Floats, n: int, rows: str) -> None:
    """Refuse times without a row each, and times that do not increase."""
    if len(at_s) < 1 or n != len(at_s):
        raise ValueError(f"a row of {rows} for each of one or more times, not {len(at_s)} times and {n} rows")
    if at_s[0] < 0.0 or any(late <= early for early, late in pairwise(at_s)):
        raise ValueError("times of 0 or more that increase")


def smooth_way(at_s: Floats, rows: Array, t: float) -> tuple[Array, Array, Array]:
    """Return value, rate and acceleration at a time, smoothly from one row to the next, with rest at each."""
    k = int(np.searchsorted(at_s, t, side="right"))
    if k == 0 or k == len(rows):
        return rows[min(k, len(rows) - 1)], np.zeros_like(rows[0]), np.zeros_like(rows[0])
    lasts, way = at_s[k] - at_s[k - 1], rows[k] - rows[k - 1]
    x = (t - at_s[k - 1]) / lasts
    return (
        rows[k - 1] + x * x * (3.0 - 2.0 * x) * way,
        6.0 * x * (1.0 - x) / lasts * way,
        (6.0 - 12.0 * x) / lasts**2 * way,
    )


class HingeDrive(Strict):
    """A wearer who turns a body: smoothly from angle to angle, rest at each; no torque before the first."""

    at_s: Floats = Field((), description="times, increasing; in a scene after the begin of control [s]")
    angle_rad: Floats = Field((), description="angle at each time")
    stiffness: float = Field(8.0, gt=0, le=1e6, description="torque for a wrong angle [N m/rad]")
    damping: float = Field(0.2, ge=0, le=1e6, description="torque for a wrong rate [N m s/rad]")

    @model_validator(mode="after")
    def _rows(self) -> HingeDrive:
        _check_times(self.at_s, len(self.angle_rad), "angle_rad")
        return self

    def __call__(self, t: float) -> tuple[float, float, float]:
        """Return wanted angle, rate and acceleration at a time [s]."""
        way = smooth_way(self.at_s, np.array(self.angle_rad)[:, None], t)
        return float(way[0][0]), float(way[1][0]), float(way[2][0])

    def torque(self, t: float, angle: float, rate: float) -> float:
        """Return the torque [N m] at a time [s], for angle [rad] and rate [rad/s] of the body."""
        if t < self.at_s[0]:
            return 0.0
        wanted, faster, _ = self(t)
        return self.stiffness * (wanted - angle) + self.damping * (faster - rate)

    def least_inertia(self, dt: float) -> float:
        """Return the inertia [kg m2] below which a body would ring, as a torque lasts for dt [s]."""
        return dt * (self.damping + dt * self.stiffness)


class HingeAxis(Strict):
    """Where the axis of a hinge is, and how far the body turns about it."""

    point: Vector3 = Field(description="of its axis, in the world [m]")
    axis: Vector3 = Field(description="direction in the world, of any length above 0")
    limits_rad: tuple[float, float] | None = Field(None, strict=False, description="least and largest angle")

    @field_validator("axis")
    @classmethod
    def _direction(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if not math.hypot(*value) > 0.0:
            raise ValueError("a direction, not all zeros")
        return value

    @field_validator("limits_rad")
    @classmethod
    def _order(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not value[0] <= 0.0 <= value[1]:
            raise ValueError("two angles, the first at most 0 and the second at least 0")
        return value


class Hinge(HingeAxis):
    """A joint to the world with one axis; its angle counts from the pose of the body at the start."""

    stiffness: float = Field(0.0, ge=0, description="of a spring towards angle 0 [N m/rad]")
    damping: float = Field(0.0, ge=0, description="[N m s/rad]")
    drive: HingeDrive | None = Field(None, description="what turns it, as a wearer does; default: nothing")
    encoder_rad: float = Field(0.0, ge=0, le=0.1, description="step of the encoder in a scene; 0: exact")


class Attachment(Strict):
    """Where an arm holds a body: at the place of the arm, as both are at the start."""

    arm: str = Field("", description="its name; default: the only arm")
    place: float | None = Field(
        None, ge=0, description="metres along the arm from its base; default: its tip"
    )
    joint: Literal["ball", "weld"] = Field("ball", description="whether the body turns about it")


class BodyMotion(Strict):
    """Where a fixed body goes: smoothly from one place to the next, with rest at each; it does not turn."""

    at_s: Floats = Field((), description="times, increasing; in a scene after the begin of control [s]")
    displacement_m: Points = Field((), description="from its position at each time: x, y, z in the world [m]")

    @model_validator(mode="after")
    def _rows(self) -> BodyMotion:
        if len(self.displacement_m) % 3:
            raise ValueError(f"x, y and z of each row, not {len(self.displacement_m)} numbers")
        _check_times(self.at_s, len(self.displacement_m) // 3, "displacement_m")
        return self

    def moves_within(self, start: float, end: float) -> bool:
        """Whether it moves at some time between two [s]."""
        return self.at_s[0] < end and start < self.at_s[-1]

    def __call__(self, t: float) -> BaseState:
        """Return the displacement at a time [s], with its rates."""
        place, velocity, acceleration = smooth_way(self.at_s, np.reshape(self.displacement_m, (-1, 3)), t)
        return BaseState(displacement=place, velocity=velocity, acceleration=acceleration)


class RigidBody(Strict):
    """A rigid body; its position is that of its centre, which is its centre of mass."""

    shape: BallShape | CapsuleShape | CylinderShape | BoxShape | MeshShape | GroundShape = Field(
        discriminator="kind", description="its surface"
    )
    mass: float | None = Field(None, gt=0, le=1e6, description="[kg]; needed by a body that is not fixed")
    inertia: Vector3 | None = Field(
        None, description="about its axes, those of a file of a mesh [kg m2]; default that of a solid body"
    )
    position: Vector3 = Field(_ZERO, description="in the world [m]")
    quaternion: Quaternion = Field((0.0, 0.0, 0.0, 1.0), description="x, y, z, w")
    velocity: Vector3 = Field(_ZERO, description="at the start [m/s]")
    angular_velocity: Vector3 = Field(_ZERO, description="at the start, in the world [rad/s]")
    fixed: bool = Field(False, description="held in the world, or driven by a motion")
    hinge: Hinge | None = Field(None, description="default: free")
    attached: Attachment | None = Field(None, description="to an arm; default: nothing holds it")
    motion: BodyMotion | None = Field(None, description="of a fixed body; default: at rest")
    friction: float = Field(0.5, ge=0, le=10, description="coefficient; of two bodies the smaller one holds")
    restitution: float = Field(0.0, ge=0, le=1, description="speed after a bounce over that before")

    @field_validator("inertia")
    @classmethod
    def _possible(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None and not (min(value) > 0.0 and 2.0 * max(value) <= sum(value) * (1.0 + 1e-9)):
            raise ValueError("three numbers above 0, none above the sum of the others")
        return value

    @model_validator(mode="after")
    def _held(self) -> RigidBody:
        if self.fixed and self.hinge is not None:
            raise ValueError("hinge or fixed, not both")
        if self.motion is not None and not self.fixed:
            raise ValueError("a motion beside fixed: true alone")
        if isinstance(self.shape, GroundShape) and not self.fixed:
            raise ValueError("a ground with fixed: true")
        if not self.fixed and self.mass is None:
            raise ValueError("a body with a mass above 0, or fixed: true")
        if (self.fixed or self.hinge is not None) and (any(self.velocity) or any(self.angular_velocity)):
            raise ValueError("a velocity at the start of free bodies alone")
        return self

    @property
    def rotation(self) -> Array:
        """Rotation in the world at the start, (3, 3)."""
        return matrix_from_quaternion(np.array(self.quaternion))

    @property
    def axes(self) -> Array:
        """Axes of `moments` in the body's frame, as columns (3, 3): principal ones of a mesh alone."""
        if isinstance(self.shape, MeshShape) and self.inertia is None:
            return self.shape.solid.axes
        return np.eye(3)

    def moments(self) -> Array:
        """Moments of inertia about `axes`, (3,) [kg m^2]; ones of a body that is fixed."""
        if self.fixed or self.mass is None:
            return np.ones(3)
        own = self.mass * self.shape.inertia_per_mass() if self.inertia is None else self.inertia
        return np.array(own, dtype=np.float64)

    def about_hinge(self) -> tuple[Array, Array, float]:
        """Return axis (3,), place (3,) of the centre at the start from a point of it [m], inertia [kg m2]."""
        assert self.hinge is not None
        axis = np.array(self.hinge.axis) / math.hypot(*self.hinge.axis)
        lever = np.subtract(self.position, self.hinge.point)
        own = float(((self.rotation @ self.axes).T @ axis) ** 2 @ self.moments())
        return axis, lever, own + (self.mass or 0.0) * float(np.sum(np.cross(axis, lever) ** 2))

    def torque_alone(self, angle: float, rate: float, acceleration: float) -> float:
        """Return the torque [N m] about the hinge that moves the body, held by nothing else, in the world."""
        assert self.hinge is not None
        axis, lever, inertia = self.about_hinge()
        pull = np.array([0.0, 0.0, -GRAVITY * (self.mass or 0.0)])
        falls = float(axis @ np.cross(rotation_exp(angle * axis) @ lever, pull))
        return inertia * acceleration + self.hinge.damping * rate + self.hinge.stiffness * angle - falls


def check_attachments(bodies: Mapping[str, RigidBody], lengths: Mapping[str, float], where: str) -> None:
    """Refuse bodies on an arm that is not there, and at a place behind its end.

    Parameters
    ----------
    bodies : mapping of str to RigidBody
    lengths : mapping of str to float
        Of the arms [m].
    where : str
        Owner of the bodies, for the error.

    Raises
    ------
    ConfigError
    """
    for name, body in bodies.items():
        if (held := body.attached) is None:
            continue
        key, arm = f"bodies.{name}.attached", held.arm or (next(iter(lengths)) if len(lengths) == 1 else "")
        if arm not in lengths:
            raise ConfigError(where, f"{key}.arm", held.arm, ", ".join(lengths) or "none, as there is no arm")
        if held.place is not None and held.place > lengths[arm] + END_TOLERANCE:
            raise ConfigError(
                where, f"{key}.place", held.place, f"0 to {lengths[arm]:.6g} m, the end of {arm}"
            )


def check_mounts(mounts: Mapping[str, str], arms: Sequence[str], where: str) -> None:
    """Refuse arms on one that is not there, stands behind them, or is carried itself.

    Parameters
    ----------
    mounts : mapping of str to str
        Names of carried arms, and of their carriers.
    arms : sequence of str
        Names of all arms, in their order.
    where : str
        Owner of the arms, for the error.

    Raises
    ------
    ConfigError
    """
    for name, carrier in mounts.items():
        if name not in arms:
            raise ConfigError(where, "mounts", name, ", ".join(arms) or "none, as there is no arm")
        before = [one for one in arms[: list(arms).index(name)] if one not in mounts]
        if carrier not in before:
            allowed = f"an arm that no other one carries, before it: {', '.join(before) or 'there is none'}"
            raise ConfigError(where, f"arms.{name}.mounted_on", carrier, allowed)
