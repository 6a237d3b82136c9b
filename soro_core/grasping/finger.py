"""What a finger feels: the force between its measured pose and its free one, by its model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.model import SoftArm
from soro_core.model.build import find_site
from soro_core.robot.basis import radius_profile


class FingerForce(NamedTuple):
    """What an object does to a finger.

    Attributes
    ----------
    squeeze_n : float
        Force against the direction in which the finger closes [N].
    across_n : float
        Force across the finger, of any direction [N]: at least the former.
    along_n : float
        Force along the finger, away from its base [N].
    bend_n : float
        `squeeze_n` if there were no friction [N]: less right, and without the noise of the length.
    noise_n : float
        Standard deviation of `bend_n` by the noise of the pose [N].
    place_m : ndarray (3,)
        Where it touches, in the world, or seen from the palm [m].
    doubt_n : float
        How much larger `across_n` may be: by the noise, one deviation, and by a touch nearer to the base [N].
    """

    squeeze_n: float
    across_n: float
    along_n: float
    bend_n: float
    noise_n: float
    place_m: Array
    doubt_n: float = 0.0


@dataclass(frozen=True)
class Finger:
    """A finger of a hand.

    Attributes
    ----------
    arm : SoftArm
        Its model.
    closing : ndarray (n_u,)
        Pressures that close it, in parts of the largest one.
    touch_m : float
        Place along it at which it touches [m]; a finger feels moments alone, not where a force acts.
    noise : ndarray (n_q,)
        Standard deviation of its measured coordinates.
    off_m : float
        How far from its place of touch the object may touch [m].
    """

    arm: SoftArm
    closing: Array
    touch_m: float
    noise: Array
    off_m: float = 5e-3

    def __post_init__(self) -> None:
        arm = self.arm
        closing, noise = np.asarray(self.closing, dtype=float), np.asarray(self.noise, dtype=float)
        if closing.shape != (arm.n_u,) or not (closing >= 0.0).all() or closing.max() != 1.0:
            raise ConfigError(
                arm.robot.name, "closing", self.closing, f"{arm.n_u} numbers from 0 to 1, the largest one 1"
            )
        if noise.shape != (arm.n_q,) or not (noise >= 0.0).all():
            raise ConfigError(arm.robot.name, "noise", self.noise, f"{arm.n_q} numbers of 0 or more")
        if not 0.0 < self.touch_m <= arm.length:
            raise ConfigError(
                arm.robot.name, "touch_m", self.touch_m, f"a place above 0 and up to {arm.length:g} m"
            )
        if not 0.0 <= self.off_m < self.touch_m:
            raise ConfigError(
                arm.robot.name, "off_m", self.off_m, f"0 or more, below touch_m: {self.touch_m:g}"
            )

    @cached_property
    def _radius(self) -> float:
        """Radius of the section that touches [m]."""
        site = find_site(self.arm.robot, self.arm.tables, self.touch_m)
        link = self.arm.robot.links[site.link]
        return float(radius_profile(link, np.array([site.place / link.length]))[0])

    @cached_property
    def _weighed(self) -> tuple[SoftArm, ...]:
        """The arm under a gravity of 1 m/s^2 along each axis: weight is linear in gravity."""
        return tuple(
            SoftArm(self.arm.robot.replace(gravity=axis), nodes=self.arm.nodes) for axis in np.eye(3).tolist()
        )

    @property
    def up(self) -> Array:
        """Direction (3,) against the gravity of its robot file; the z axis without one."""
        gravity = np.array(self.arm.robot.gravity)
        size = float(np.linalg.norm(gravity))
        return -gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])

    def feel(self, q: Array, pressure_pa: Array, gravity: Array | None = None) -> FingerForce:
        """Return the force at the place of touch.

        At rest elastic force and weight balance the pressures and J' f; of more coordinates than three the
        force is the one whose deflection is nearest to the measured one, by energy; with fewer, it is taken
        to act against the closing alone. Without contact the free shape under these pressures is the
        measured one, and the force 0.

        Parameters
        ----------
        q : ndarray (n_q,)
            Measured coordinates.
        pressure_pa : ndarray (n_u,)
            Measured pressures [Pa gauge].
        gravity : ndarray (3,), optional
            Where the palm tilts [m/s^2]; default that of the robot file.
        """
        arm = self.arm
        if gravity is None:
            weight = arm.gravity_force(q)
        else:
            weight = sum(g * one.gravity_force(q) for g, one in zip(gravity, self._weighed, strict=True))
        missing = arm.elastic_force(q) + weight - arm.pressure_force(q, pressure_pa)
        stiffness = arm.stiffness_matrix(q)
        pose, jacobian = arm.pose_and_jacobian(q, self.touch_m)
        turn, J = pose[:3, :3] @ jacobian[:3], pose[:3, :3] @ jacobian[3:]
        along = pose[:3, 2]
        way = J @ np.linalg.solve(stiffness, arm.actuation_matrix(q) @ self.closing)
        way -= (way @ along) * along
        way /= np.linalg.norm(way)
        # Friction acts on the skin: about the backbone it has a moment, which is no squeeze.
        skin = self._radius * way
        J = J + np.cross(turn.T, skin).T
        soft = np.linalg.solve(stiffness, J.T).T  # displacement by generalised force, (3, n_q)
        by_bend = way @ soft / float(way @ soft @ J.T @ way)
        by_force = np.linalg.solve(soft @ J.T, soft) if arm.n_q > 2 else np.outer(way, by_bend)
        force = by_force @ missing
        noise = float(np.linalg.norm(by_bend @ stiffness * self.noise))
        axial = float(force @ along)
        across = float(np.linalg.norm(force - axial * along))
        # A deflection by bending tells a force times the square of its distance from the base.
        doubt = across * ((self.touch_m / (self.touch_m - self.off_m)) ** 2 - 1.0) + noise
        bend = -float(by_bend @ missing)
        return FingerForce(-float(force @ way), across, axial, bend, noise, pose[:3, 3] + skin, doubt)
