"""A twin beside a real arm: driven by the measured pressures, compared with the measured poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.robot import Robot
from soro_core.rotation import matrix_from_quaternion, rotation_exp, rotation_log
from soro_core.twin.config import ShadowConfig
from soro_core.twin.twin import Twin, TwinState

# Poses of the shadow are kept for this long, because measured poses arrive late.
REMEMBERED_S = 0.5
# After a longer gap between pressures the shadow starts again, at rest under the present ones.
GAP_S = 0.5
DIFFERENCES = ("distance", "x", "y", "z", "rotation", "bending")


@dataclass(frozen=True)
class PoseDifference:
    """A measured pose less the shadow's at the same time.

    Attributes
    ----------
    position_m : ndarray (3,)
        In the world.
    rotation_rad : float
        Angle between the two orientations.
    bending_rad : float
        Angle between the base's axis and the arm's there: measured less simulated.
    """

    position_m: Array
    rotation_rad: float
    bending_rad: float

    @property
    def distance_m(self) -> float:
        """Distance of the two positions."""
        return float(np.linalg.norm(self.position_m))

    @property
    def values(self) -> Array:
        """Values in the order of `DIFFERENCES`."""
        return np.array([self.distance_m, *self.position_m, self.rotation_rad, self.bending_rad])


@dataclass(frozen=True)
class ShadowState:
    """The twin at the last measured pressures, and its poses over the last `REMEMBERED_S`."""

    twin: TwinState | None = None
    stamp_ns: int = 0
    pressure_pa: Array | None = None
    poses: tuple[tuple[int, Array], ...] = ()
    restarts: int = 0


def between(last_pa: Array, pressure_pa: Array, last_ns: int, stamp_ns: int, period_ns: int) -> list[Array]:
    """Interpolate pressures linearly at the ticks between two measurements.

    Parameters
    ----------
    last_pa, pressure_pa : ndarray (n_u,)
        The two measurements [Pa gauge].
    last_ns, stamp_ns : int
        Their times [ns].
    period_ns : int
        Period of the ticks [ns].

    Returns
    -------
    list of ndarray (n_u,)
        One entry a tick after the first measurement; the last entry is the second measurement.
    """
    ticks = round((stamp_ns - last_ns) / period_ns)
    return [last_pa + (pressure_pa - last_pa) * (k / ticks) for k in range(1, ticks + 1)]


def beginning(twin: Twin, pressure_pa: Array) -> TwinState:
    """Return the twin at rest under pressures (n_u,) [Pa]; under none where it finds no rest (buckling)."""
    try:
        return twin.initial(pressure_pa)
    except ModelError:
        return twin.initial()


class Shadow:
    """The twin of a real arm.

    Parameters
    ----------
    robot : Robot
        Robot as the controller knows it.
    config : ShadowConfig
        Parameters of the twin, and the place of its measured pose.
    """

    def __init__(self, robot: Robot, config: ShadowConfig) -> None:
        self.twin, self._config = Twin(robot, config), config
        self._period_ns = round(1e9 / config.rate_hz)
        self._place = config.pose.locations[0] * robot.length
        self._axis = matrix_from_quaternion(np.array(robot.base_quaternion))[:, 2]

    def pose(self, state: TwinState) -> Array:
        """Return the simulated pose (4, 4) of the sensor."""
        return self.twin.plant.arm.pose(state.arm.q, self._place)

    def advance(self, state: ShadowState, stamp_ns: int, pressure_pa: Array) -> ShadowState:
        """Advance to a measurement of the pressures.

        The shadow starts again at rest if its model fails, or after `GAP_S` without pressures.

        Parameters
        ----------
        state : ShadowState
            State after the last measurement.
        stamp_ns : int
            Time of this measurement [ns].
        pressure_pa : ndarray (n_u,)
            Measured pressures [Pa gauge].
        """
        if state.twin is None or state.pressure_pa is None or stamp_ns < state.stamp_ns:
            return self._start(state, stamp_ns, pressure_pa)
        if stamp_ns - state.stamp_ns > GAP_S * 1e9:
            return self._start(replace(state, restarts=state.restarts + 1), stamp_ns, pressure_pa)
        ways = between(state.pressure_pa, pressure_pa, state.stamp_ns, stamp_ns, self._period_ns)
        if not ways:
            return state
        twin, poses = state.twin, list(state.poses)
        for left, pressure in zip(range(len(ways) - 1, -1, -1), ways, strict=True):
            twin = self.twin.step_pressures(twin, pressure)
            if not twin.status.ok:
                return self._start(replace(state, restarts=state.restarts + 1), stamp_ns, pressure_pa)
            poses.append((stamp_ns - left * self._period_ns, self.pose(twin)))
        oldest = stamp_ns - round(REMEMBERED_S * 1e9)
        kept = tuple(entry for entry in poses if entry[0] >= oldest)
        return replace(state, twin=twin, stamp_ns=stamp_ns, pressure_pa=pressure_pa, poses=kept)

    def at(self, state: ShadowState, stamp_ns: int) -> Array | None:
        """Return the simulated pose (4, 4) at a time; None where no pose is kept around it."""
        return _between_poses(state.poses, stamp_ns)

    def compare(self, simulated: Array, position: Array, quaternion: Array) -> PoseDifference:
        """Subtract a simulated pose from a measured one.

        Parameters
        ----------
        simulated : ndarray (4, 4)
            Pose of the shadow.
        position : ndarray (3,)
            Measured position in the world [m].
        quaternion : ndarray (4,)
            Measured orientation x, y, z, w.
        """
        measured = matrix_from_quaternion(quaternion)
        turn = rotation_log(simulated[:3, :3].T @ measured)
        bending = _angle(self._axis, measured[:, 2]) - _angle(self._axis, simulated[:3, 2])
        return PoseDifference(position - simulated[:3, 3], float(np.linalg.norm(turn)), bending)

    def _start(self, state: ShadowState, stamp_ns: int, pressure_pa: Array) -> ShadowState:
        twin = beginning(self.twin, pressure_pa)
        return ShadowState(twin, stamp_ns, pressure_pa, ((stamp_ns, self.pose(twin)),), state.restarts)


def _between_poses(poses: Sequence[tuple[int, Array]], stamp_ns: int) -> Array | None:
    if not poses or not poses[0][0] <= stamp_ns <= poses[-1][0]:
        return None
    n = next(k for k, (when, _) in enumerate(poses) if when >= stamp_ns)
    after_ns, after = poses[n]
    if after_ns == stamp_ns:
        return after
    before_ns, before = poses[n - 1]
    part = (stamp_ns - before_ns) / (after_ns - before_ns)
    pose = before + part * (after - before)
    rotation = before[:3, :3]
    pose[:3, :3] = rotation @ rotation_exp(part * rotation_log(rotation.T @ after[:3, :3]))
    return pose


def _angle(a: Array, b: Array) -> float:
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
