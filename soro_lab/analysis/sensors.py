"""Sensors that could be on an arm: what each measures, and with which noise, docs/analysis.md (9)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from pydantic import Field

from soro_core.arrays import Array
from soro_core.config import Strict
from soro_core.estimation.config import EstimatorConfig
from soro_core.model import SoftArm
from soro_core.twin.config import TwinSection

Rows: TypeAlias = Callable[[SoftArm, Array, float], Array]

# Noise of a sensor that a scene does not describe, and of what a scene says not to use.
BEND_STD_RAD, UNUSED = 0.02, 1e9


class SensorNoise(Strict):
    """Deviations of one sample, errors of the arm's kinematics included."""

    position_m: float = Field(gt=0, le=1e9, description="each coordinate of a pose or a marker")
    rotation_rad: float = Field(gt=0, le=1e9, description="each rotation of a pose")
    imu_rotation_rad: float = Field(gt=0, le=1e9, description="each rotation of an IMU")
    rate_rad_s: float = Field(gt=0, le=1e9, description="each angular velocity of an IMU")
    acceleration_m_s2: float = Field(gt=0, le=1e9, description="each component of gravity of an IMU")
    bend_rad: float = Field(BEND_STD_RAD, gt=0, le=1e9, description="each of the two angles of a bend sensor")


def noise_of(twin: TwinSection, filter_: EstimatorConfig) -> dict[str, float]:
    """Return the noise that a scene states: the larger of sensor's and filter's, with the model's error."""
    pose, imu = filter_.pose, filter_.imu

    def total(sensor: float, known: float, model: float) -> float:
        return float(np.hypot(max(sensor, known), model))

    return {
        "position_m": total(twin.pose.position_noise_m, pose.position_std_m, pose.position_model_std_m),
        "rotation_rad": total(
            twin.pose.rotation_noise_rad, pose.orientation_std_rad, pose.orientation_model_std_rad
        ),
        "imu_rotation_rad": total(
            twin.imu.rotation_noise_rad, imu.orientation_std_rad, imu.orientation_model_std_rad
        ),
        "rate_rad_s": total(twin.imu.rate_noise_rad_s, imu.rate_std_rad_s, 0.0),
        "acceleration_m_s2": total(twin.imu.acceleration_noise_m_s2, imu.acceleration_std_m_s2, 0.0)
        if imu.use_gravity
        else UNUSED,
        "bend_rad": total(BEND_STD_RAD, 0.0, pose.orientation_model_std_rad),
    }


@dataclass(frozen=True)
class SensorType:
    """A kind of sensor.

    Attributes
    ----------
    name : str
    rows : callable
        Derivatives (m, 2 n_q) of what it measures by (q, qd), of an arm, at q, at a place [m].
    std : ndarray (m,)
        Deviation of each of them.
    rate_hz : float
        Samples a second.
    """

    name: str
    rows: Rows
    std: Array
    rate_hz: float


@dataclass(frozen=True)
class SensorCandidate:
    """A kind of sensor at a place [m of undeformed length from the base]."""

    kind: SensorType
    s: float


KINDS = ("pose", "marker", "imu", "bend")


def kinds_of(names: tuple[str, ...], noise: SensorNoise, twin: TwinSection) -> list[SensorType]:
    """Return the kinds with these names.

    Parameters
    ----------
    names : tuple of str
        Of `KINDS`.
    noise : SensorNoise
    twin : TwinSection
        Rates of the sensors.
    """
    position, rate = [noise.position_m] * 3, [noise.rate_rad_s] * 3
    imu = [*rate, *[noise.imu_rotation_rad] * 3, *[noise.acceleration_m_s2] * 3]
    known = {
        "pose": (_pose, [*position, *[noise.rotation_rad] * 3], twin.pose.rate_hz),
        "marker": (_marker, position, twin.pose.rate_hz),
        "imu": (_imu, imu, twin.imu.rate_hz),
        "bend": (_bend, [noise.bend_rad] * 2, twin.pose.rate_hz),
    }
    return [SensorType(name, known[name][0], np.array(known[name][1]), known[name][2]) for name in names]


def _at_rest(rows: Array) -> Array:
    """Rows by (q, qd) of what does not depend on qd."""
    return np.hstack([rows, np.zeros_like(rows)])


def _pose(arm: SoftArm, q: Array, s: float) -> Array:
    pose, jacobian = arm.pose_and_jacobian(q, s)
    return _at_rest(np.vstack([pose[:3, :3] @ jacobian[3:], jacobian[:3]]))


def _marker(arm: SoftArm, q: Array, s: float) -> Array:
    pose, jacobian = arm.pose_and_jacobian(q, s)
    return _at_rest(pose[:3, :3] @ jacobian[3:])


def _bend(arm: SoftArm, q: Array, s: float) -> Array:
    """Direction of the section's normal seen from the base: two angles."""
    return _at_rest(arm.jacobian(q, s)[:2])


def _imu(arm: SoftArm, q: Array, s: float) -> Array:
    """Angular velocity, orientation, direction of gravity; as in the filter, without d(omega)/dq."""
    pose, jacobian = arm.pose_and_jacobian(q, s)
    turn = jacobian[:3]
    x, y, z = -pose[:3, :3].T @ arm.tables.gravity
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.vstack([np.hstack([np.zeros_like(turn), turn]), _at_rest(turn), _at_rest(across @ turn)])
