"""What pushes on the true arm without that estimator and controller know it: a wrench, a wall that moves."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from soro_core.arrays import Array
from soro_core.config import Floats, Points, Strict
from soro_core.robot.surroundings import Plane
from soro_core.robot.vectors import Vector3

_NONE = (0.0, 0.0, 0.0)
# Largest force [N] and torque [N m] along an axis.
LARGEST_N, LARGEST_NM = 100.0, 10.0
# A time that is earlier by less [s] is the same tick.
SAME_S = 1e-9


class WrenchChanges(Strict):
    """A wrench on the arm in the directions of the world: a time, a force and a torque for each change."""

    at_s: Floats = Field((), description="times after the begin of control, increasing; none: no wrench")
    force_n: Points = Field((), description="force in the world at each time: x, y, z [N]")
    torque_nm: Points = Field((), description="torque in the world at each time: x, y, z [N m]; default none")
    change: Literal["step", "ramp"] = Field(
        "step", description="each row holds from its time on (step), or grows into the next one (ramp)"
    )
    location: float = Field(1.0, gt=0, le=1, description="where it acts, as a part of the arm's length")

    @model_validator(mode="after")
    def _rows(self) -> WrenchChanges:
        n = len(self.at_s)
        if len(self.force_n) != 3 * n:
            raise ValueError(f"a row of force_n for each time: {3 * n} numbers, not {len(self.force_n)}")
        if len(self.torque_nm) not in (0, 3 * n):
            raise ValueError(f"a row of torque_nm for each time or none: 0 or {3 * n} numbers")
        if any(time < 0.0 for time in self.at_s) or any(b <= a for a, b in pairwise(self.at_s)):
            raise ValueError("times of 0 or more that increase")
        if any(abs(one) > LARGEST_N for one in self.force_n):
            raise ValueError(f"forces from {-LARGEST_N:g} to {LARGEST_N:g} N")
        if any(abs(one) > LARGEST_NM for one in self.torque_nm):
            raise ValueError(f"torques from {-LARGEST_NM:g} to {LARGEST_NM:g} N m")
        return self

    def at(self, t: float) -> Array:
        """Torque [N m] and force [N] in the world (6,), `t` seconds after the begin of control."""
        n = len(self.at_s)
        if not n or t < self.at_s[0] - SAME_S:
            return np.zeros(6)
        rows = np.zeros((n, 6))
        rows[:, 3:] = np.reshape(self.force_n, (n, 3))
        if self.torque_nm:
            rows[:, :3] = np.reshape(self.torque_nm, (n, 3))
        if self.change == "step":
            return np.asarray(rows[np.searchsorted(self.at_s, t + SAME_S, side="right") - 1])
        return np.array([np.interp(t, self.at_s, column) for column in rows.T])


class Wall(Strict):
    """A plane that pushes the arm away and moves for some time; its law is that of a robot's contacts.

    The twin shortens its steps until they resolve how the tip bounces on it.
    """

    stiffness: float = Field(
        0.0, ge=0, le=1e7, description="normal force per depth at one point [N/m]; 0: no wall"
    )
    point: Vector3 = Field(_NONE, description="a point of its surface before it moves, in the world [m]")
    normal: Vector3 = Field((0.0, 0.0, 1.0), description="direction out of it, in the world")
    damping: float = Field(0.0, ge=0, le=1e3, description="as of a plane of a robot file [s/m]")
    friction: float = Field(0.0, ge=0, le=100, description="coefficient of Coulomb's friction")
    slip_velocity: float = Field(1e-3, gt=0, le=10, description="as of a plane of a robot file [m/s]")
    velocity_m_s: Vector3 = Field(_NONE, description="velocity while it moves, in the world [m/s]")
    from_s: float = Field(
        0.0, ge=0, le=86400, description="time after the begin of control when it begins to move"
    )
    to_s: float = Field(86400.0, ge=0, le=86400, description="time after the begin of control when it stops")

    @model_validator(mode="after")
    def _possible(self) -> Wall:
        if not math.hypot(*self.normal) > 0.0:
            raise ValueError("a normal that is not all zeros")
        if math.hypot(*self.velocity_m_s) > 1.0:
            raise ValueError("a velocity_m_s of at most 1 m/s")
        if self.to_s < self.from_s:
            raise ValueError("a to_s of from_s or more")
        return self

    @property
    def plane(self) -> Plane:
        """The wall before it moves."""
        return Plane(**{name: getattr(self, name) for name in Plane.model_fields})

    def at(self, t: float) -> tuple[Array, Array]:
        """Point [m] and velocity [m/s] in the world, `t` seconds after the begin of control."""
        moved = min(max(t, self.from_s), self.to_s) - self.from_s
        speed = np.array(self.velocity_m_s)
        is_moving = self.from_s <= t + SAME_S < self.to_s
        return np.array(self.point) + moved * speed, speed if is_moving else np.zeros(3)
