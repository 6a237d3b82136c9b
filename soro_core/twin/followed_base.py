"""A base that follows poses that come one by one: what moves under the simulated arm, and under its model."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.model import SoftArm
from soro_core.robot import BaseState, Robot
from soro_core.rotation import left_jacobian_inverse, matrix_from_quaternion, rotation_exp, rotation_log

# Rate of the way to a new pose [1/s], critically damped: it arrives within 0.2 s, with finite acceleration.
_RATE = 30.0
# Largest step from one pose to the next.
LARGEST_M, LARGEST_RAD = 0.2, 0.5
# Step of the difference quotient of the angular velocity [s].
_STEP_S = 1e-5


class BaseWay(NamedTuple):
    """The way to the last pose.

    Attributes
    ----------
    since_s : float
        When that pose came [s].
    goal : ndarray (6,)
        Displacement [m] and rotation vector [rad] from the base of the robot file, in the world.
    away, rate : ndarray (6,)
        From the goal to where the base was then, and its rate.
    """

    since_s: float = 0.0
    goal: Array = np.zeros(6)
    away: Array = np.zeros(6)
    rate: Array = np.zeros(6)

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return displacement and rotation vector (6,) at a time [s], and their first and second rates."""
        passed_s = max(t - self.since_s, 0.0)
        fades = math.exp(-_RATE * passed_s)
        slope = self.rate + _RATE * self.away
        left = self.away + passed_s * slope
        return (
            self.goal + fades * left,
            fades * (slope - _RATE * left),
            fades * _RATE * (_RATE * left - 2.0 * slope),
        )

    def __call__(self, t: float) -> BaseState:
        """Return the state of the base at a time [s]."""
        x, v, a = self.at(t)
        turn = v[3:], a[3:]
        if x[3:].any():
            before, after = self._spin(t - _STEP_S), self._spin(t + _STEP_S)
            turn = self._spin(t), (after - before) / (2.0 * _STEP_S)
        return BaseState(x[:3], v[:3], a[:3], rotation_exp(x[3:]), *turn)

    def _spin(self, t: float) -> Array:
        """Angular velocity (3,) in the world [rad/s]."""
        x, v, _ = self.at(t)
        return np.asarray(np.linalg.solve(left_jacobian_inverse(x[3:]), v[3:]), dtype=np.float64)

    def towards(self, t: float, displacement: Array, rotation: Array) -> BaseWay:
        """Return the way to another pose.

        Parameters
        ----------
        t : float
            When it comes [s].
        displacement : ndarray (3,)
            From the base position of the robot file [m].
        rotation : ndarray (3, 3)
            Turns the base from its orientation in the robot file.

        Raises
        ------
        ModelError
            If it is too far from the last one: the arm would be torn off.
        """
        goal = np.concatenate((displacement, rotation_log(rotation)))
        apart_m, apart_rad = (float(np.linalg.norm(part)) for part in np.split(goal - self.goal, 2))
        # What is not finite is not less; behind half a turn the vector points the other way.
        if not (apart_m <= LARGEST_M and apart_rad <= LARGEST_RAD):
            raise ModelError(
                f"{apart_m:.3g} m and {apart_rad:.3g} rad from the last pose; allowed: at most "
                f"{LARGEST_M:g} m and {LARGEST_RAD:g} rad, and half a turn from the robot file",
                "base",
            )
        x, v, _ = self.at(t)
        return BaseWay(t, goal, x - goal, v)

    def to_pose(self, t: float, pose: Array, robot: Robot) -> BaseWay:
        """Return the way to a pose (4, 4) of the base in the world, which comes at `t` [s].

        Raises
        ------
        ModelError
            If it is no pose, or too far from the last one.
        """
        rotation = pose[:3, :3] @ matrix_from_quaternion(np.array(robot.base_quaternion)).T
        if not np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-6:
            raise ModelError("a pose of the base without a rotation: allowed is a rigid one", "pose")
        return self.towards(t, pose[:3, 3] - np.array(robot.base_position), rotation)


AT_REST = BaseWay()


class FollowedBase:
    """The base of a plant, whose way the twin sets at each tick; the steppers call it."""

    way = AT_REST

    def __call__(self, t: float) -> BaseState:
        """Return the state of the base at a time [s]."""
        return self.way(t)


def carried(state: BaseState, robot: Robot) -> Array:
    """Return the pose (4, 4) of the base in the world, from its displacement and rotation."""
    pose = np.eye(4)
    pose[:3, :3] = np.asarray(state.rotation) @ matrix_from_quaternion(np.array(robot.base_quaternion))
    pose[:3, 3] = np.array(robot.base_position) + np.asarray(state.displacement)
    return pose


def place_base(arm: SoftArm, state: BaseState) -> None:
    """Put the base of an arm where it is now, for what `arm` tells next.

    The acceleration of the base counts as gravity, which is exact while it does not turn. Its spin, which
    acts by its square and its rate, is left out: 0.5 rad/s are 0.05 m/s^2 at 0.2 m.

    Parameters
    ----------
    arm : SoftArm
    state : BaseState
    """
    pose, tables = carried(state, arm.robot), arm.tables
    tables.base_rotation[:], tables.base_position[:] = pose[:3, :3], pose[:3, 3]
    tables.gravity[:] = np.array(arm.robot.gravity) - np.asarray(state.acceleration)
