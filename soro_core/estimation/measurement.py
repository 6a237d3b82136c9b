"""Measurement models: predicted values of a sample, and their derivatives by the state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from soro_core.estimation.config import EstimatorConfig
from soro_core.estimation.samples import ImuSample, PoseSample, Sample
from soro_core.model import SoftArm
from soro_core.rotation import left_jacobian_inverse, matrix_from_quaternion, rotation_log, skew

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Innovation:
    """Residual of one sample, linearised about a state.

    Attributes
    ----------
    residual : ndarray (m,)
        Measured minus predicted; rotations as the logarithm of R_predicted' R_measured.
    jacobian : ndarray (m, 2 n_q)
        Derivative of the prediction by (q, qd).
    variance : ndarray (m,)
        Sum of the variances of sensor and kinematics; the components are independent.
    """

    residual: Array
    jacobian: Array
    variance: Array


def innovation(arm: SoftArm, config: EstimatorConfig, sample: Sample, q: Array, qd: Array) -> Innovation:
    """Return the innovation of a sample at a state.

    Parameters
    ----------
    arm : SoftArm
        Kinematics.
    config : EstimatorConfig
        Noise of the sensors.
    sample : Sample
        Measured values.
    q, qd : ndarray (n_q,)
        Coordinates and rates.

    Returns
    -------
    Innovation
    """
    s = min(max(sample.s, 0.0), arm.length)
    pose, jacobian = arm.pose_and_jacobian(q, s)
    if isinstance(sample, PoseSample):
        return _pose(config, sample, pose, jacobian)
    return _imu(config, sample, pose, jacobian, qd, np.asarray(arm.robot.gravity, dtype=np.float64))


def _pose(config: EstimatorConfig, sample: PoseSample, pose: Array, jacobian: Array) -> Innovation:
    rotation, n = pose[:3, :3], jacobian.shape[1]
    angle = rotation_log(rotation.T @ matrix_from_quaternion(sample.quaternion))
    rows = np.zeros((6, 2 * n))
    rows[:3, :n] = rotation @ jacobian[3:]
    rows[3:, :n] = _log_jacobian(angle, jacobian)
    noise = config.pose
    position = noise.position_std_m**2 + noise.position_model_std_m**2
    orientation = noise.orientation_std_rad**2 + noise.orientation_model_std_rad**2
    variance = np.array(3 * [position] + 3 * [orientation])
    return Innovation(np.concatenate([sample.position - pose[:3, 3], angle]), rows, variance)


def _imu(
    config: EstimatorConfig, sample: ImuSample, pose: Array, jacobian: Array, qd: Array, gravity: Array
) -> Innovation:
    rotation, n, noise = pose[:3, :3], jacobian.shape[1], config.imu
    # d(omega)/dq = dJ/dq qd is neglected: small at the speeds of an arm, and 0 at rest.
    residuals, rows, variances = (
        [sample.angular_velocity - jacobian[:3] @ qd],
        [np.hstack([np.zeros((3, n)), jacobian[:3]])],
        [np.full(3, noise.rate_std_rad_s**2)],
    )
    if sample.orientation is not None:
        angle = rotation_log(rotation.T @ matrix_from_quaternion(sample.orientation))
        residuals.append(angle)
        rows.append(np.hstack([_log_jacobian(angle, jacobian), np.zeros((3, n))]))
        variances.append(np.full(3, noise.orientation_std_rad**2 + noise.orientation_model_std_rad**2))
    up = -rotation.T @ gravity
    length = float(np.linalg.norm(gravity))
    shaken = abs(float(np.linalg.norm(sample.linear_acceleration)) - length) > noise.gravity_tolerance_m_s2
    if noise.use_gravity and length > 0.0 and not shaken:
        # (R exp([w]x))' v = R' v + [R' v]x w to first order.
        residuals.append(sample.linear_acceleration - up)
        rows.append(np.hstack([skew(up) @ jacobian[:3], np.zeros((3, n))]))
        variances.append(np.full(3, noise.acceleration_std_m_s2**2))
    return Innovation(np.concatenate(residuals), np.vstack(rows), np.concatenate(variances))


def _log_jacobian(angle: Array, jacobian: Array) -> Array:
    """Derivative of the predicted rotation in the coordinates of log(R_predicted' R_measured)."""
    return np.asarray(left_jacobian_inverse(angle) @ jacobian[:3])
