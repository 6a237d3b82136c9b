"""How the arm bends in a first pressurisation, judged by the measurement of the probe before control."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError, ModelError
from soro_core.linear import inverse
from soro_core.robot import Robot
from soro_hardware.finding import Finding, Level
from soro_hardware.hil.measured import PressureHold

if TYPE_CHECKING:
    from soro_core.model import SoftArm

COMPASS = ("+x", "+x +y", "+y", "-x +y", "-x", "-x -y", "-y", "+x -y")
# Steps to the shape whose tip is at a place; each solves the problem for the slope of now.
_STEPS = 20
_LEVELS: dict[str, Level] = {"warn": "warn", "fail": "fail", "stop": "fail"}


@dataclass(frozen=True)
class Bending:
    """Motion of the tip by the model.

    Attributes
    ----------
    arm : SoftArm
    chambers : tuple of int
        Number in the robot of each chamber of the platform.
    rest : ndarray (n_q,)
        Coordinates without pressure.
    expected_m : ndarray (n, m, 2)
        Displacement of the tip normal to the axis of the base, with chamber n alone at step m [m].
    across : ndarray (2, 3)
        x and y axes of the base frame in the world.
    """

    arm: SoftArm
    chambers: tuple[int, ...]
    rest: Array
    expected_m: Array
    across: Array

    def directions(self) -> tuple[str, ...]:
        """Return the direction of the tip in the base frame for each chamber, as text."""
        angles = [np.arctan2(row[-1, 1], row[-1, 0]) for row in self.expected_m]
        return tuple(
            f"{COMPASS[round(angle / (np.pi / 4)) % 8]} of the base frame ({np.degrees(angle) % 360:.0f} deg)"
            for angle in angles
        )

    def findings(self, holds: Sequence[PressureHold]) -> list[Finding]:
        """Return what the motions of the tip at the last step of each chamber say."""
        from soro_core.adaptation.config import mass_prior
        from soro_core.control.probing.findings import judge_answers
        from soro_core.control.probing.wiring import HeldState, WiringModel

        last = {hold.chamber: hold for hold in holds}.values()
        if not last:
            return []
        moved = [hold.moved_m for hold in last if hold.moved_m is not None]
        if len(moved) < len(last):
            return [Finding("bends", "warn", "no pose of the tip received", "give --pose TOPIC, or --ask")]
        none, pressure = np.zeros(self.arm.n_q), np.zeros((len(last), self.arm.n_u))
        pressure[:, list(self.chambers)] = [hold.level_pa for hold in last]
        try:
            shapes = [self.rest, *map(self._shape, moved)]
            levels = [np.zeros(self.arm.n_u), *pressure]
            states = [HeldState(q, none, none, p) for q, p in zip(shapes, levels, strict=True)]
            model = WiringModel(self.arm, mass_prior(self.arm)[2])
            found, _ = judge_answers(model, self.arm.robot.chamber_names, states)
        except (ModelError, np.linalg.LinAlgError) as error:
            text = f"no shape of the model has the tip where it was measured: {error}"
            return [Finding("bends", "fail", text, "frame of the pose sensor, or the robot file")]
        if not found:
            return [Finding("bends", "ok", "each chamber moves the tip as the robot file says")]
        return [Finding("bends", _LEVELS[one.level], one.text, one.step) for one in found]

    def _shape(self, moved_m: Array) -> Array:
        """Return the coordinates (n_q,) of least elastic energy whose tip has moved so from rest."""
        arm, q = self.arm, self.rest
        soft = inverse(arm.stiffness_matrix(np.zeros(arm.n_q)))
        wanted = arm.pose(q, arm.length)[:3, 3] + moved_m
        for _ in range(_STEPS):
            pose, jacobian = arm.pose_and_jacobian(q, arm.length)
            by_q = pose[:3, :3] @ jacobian[3:]
            force = np.linalg.lstsq(by_q @ soft @ by_q.T, wanted - pose[:3, 3] + by_q @ q, rcond=None)[0]
            q = soft @ by_q.T @ force
        return q


def bending_of(robot: Robot, names: tuple[str, ...], steps_pa: tuple[float, ...]) -> Bending:
    """Return how the model's tip moves with each chamber alone.

    Parameters
    ----------
    robot : Robot
    names : tuple of str
        Chambers of the platform.
    steps_pa : tuple of float
        Set points of each chamber [Pa gauge].

    Raises
    ------
    ConfigError
        If the chambers of robot and platform differ.
    """
    # Imported here: without a robot no kernel is compiled.
    from soro_core.model.equilibrium.statics import equilibrium
    from soro_core.model.soft_arm import SoftArm
    from soro_core.rotation import matrix_from_quaternion

    if set(robot.chamber_names) != set(names):
        raise ConfigError(robot.name, "chambers", ", ".join(robot.chamber_names), ", ".join(names))
    arm = SoftArm(robot)
    order = tuple(robot.chamber_names.index(name) for name in names)
    rest = equilibrium(arm, np.zeros(arm.n_u))

    def tip(q: Array) -> Array:
        return np.asarray(arm.pose(q, robot.length)[:3, 3])

    across = matrix_from_quaternion(np.array(robot.base_quaternion))[:, :2].T
    expected = [
        [across @ (tip(equilibrium(arm, p * np.eye(arm.n_u)[n])) - tip(rest)) for p in steps_pa]
        for n in order
    ]
    return Bending(arm, order, rest, np.array(expected), across)
