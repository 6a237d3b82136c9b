"""The numbers of one filter, from its parameters and the model, as its kernels take them.

The configured noise is that of strains that are uniform along a link; its meaning for several coefficients
does not depend on the basis (`soro_core.robot.coordinates`). The initial covariance of the coefficients is
the variance times W^-1, W of docs/model.md (4): all shapes of the arm are equally likely. The disturbance
accelerates the strain uniformly. It then acts like the inertia of a bending arm, mostly on the outer part, as
a payload does, and the model gives its effect on the higher coefficients. Independent disturbances of all
coefficients are mostly unobservable from the tip, and drift until the prediction fails (docs/adr/0010).
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from soro_core.adaptation.damping import damping_model
from soro_core.adaptation.scales import scales_of
from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.estimation.config import EstimatorConfig, ProcessNoise
from soro_core.estimation.kernel.parts import MOST_ROWS, FilterSettings
from soro_core.model import SoftArm
from soro_core.model.build import find_site
from soro_core.robot.coordinates import StrainFields, strain_fields


def settings_of(arm: SoftArm, config: EstimatorConfig, pieces: int, dt: float) -> FilterSettings:
    """Return the settings of the filter of one arm; parameters as in `filter.Filter`."""
    fields, n = strain_fields(arm.robot), arm.n_q
    angle = np.where(fields.stretch, 1.0, fields.length)
    q_unit, force_unit = _units(arm, pieces)
    losses = damping_model(arm, pieces)
    pose, imu = config.pose, config.imu
    kinematics = 3 * [pose.position_model_std_m**2] + 3 * [pose.orientation_model_std_rad**2]
    gates = [0.0, *(chdtri(k, 1.0 - config.gate_probability) for k in range(1, MOST_ROWS + 1))]
    return FilterSettings(
        n_d=n if config.disturbance else 0,
        time=float(config.process.disturbance_time_s),
        learned_time=float(config.learned_process.disturbance_time_s),
        process=_process(config.process, fields),
        learned_process=_process(config.learned_process, fields),
        pressure_process=config.pressure_std_pa**2 * dt,
        initial=_initial(config, fields),
        first=np.append(fields.first, n).astype(np.int64),
        samples=np.ascontiguousarray(fields.samples),
        largest=fields.largest,
        limit=np.where(fields.stretch, config.stretch_limit, config.bend_limit_rad / fields.length),
        weight=fields.weight * np.outer(angle, angle),
        increment=1e-6 / angle / np.sqrt(np.diag(fields.weight)),
        q_unit=q_unit,
        force_unit=force_unit,
        damping=arm.tables.damping.copy(),
        damping_number=losses.number,
        damping_matrix=losses.matrix,
        tip_mass=float(arm.tables.tip_mass[0]),
        tip=find_site(arm.robot, arm.tables, arm.length),
        pose_variance=np.array([pose.position_std_m, pose.orientation_std_rad]) ** 2,
        kinematic_variance=np.array(kinematics),
        imu_variance=np.array([imu.rate_std_rad_s, imu.orientation_std_rad, imu.acceleration_std_m_s2]) ** 2,
        imu_kinematic_variance=float(imu.orientation_model_std_rad**2),
        noise_time=float(config.watch.noise_time_s),
        gravity_tolerance=float(imu.gravity_tolerance_m_s2) if imu.use_gravity else -1.0,
        gates=np.array(gates, dtype=np.float64),
        outlier_inflation=float(config.outlier_inflation),
        most_refused=int(config.reacquire_after),
        frozen_m=float(pose.position_std_m),
    )


def _units(arm: SoftArm, pieces: int) -> tuple[Array, Array]:
    """Return the units of the learned force; all its forces are 0 where the model gives no units."""
    try:
        scales = scales_of(arm, pieces)
    except ConfigError:
        return np.ones(arm.n_q), np.zeros(arm.n_q)
    return scales.q, scales.force


def _process(noise: ProcessNoise, fields: StrainFields) -> Array:
    """Return the spectral density of the noise of rates and drifts, (2, n, n)."""
    acceleration = np.where(fields.stretch, noise.stretch_acceleration, noise.curvature_acceleration_per_m)
    drift = np.where(fields.stretch, noise.stretch_disturbance, noise.curvature_disturbance_per_m)
    return np.stack([std[:, None] ** 2 * _uniform(fields) for std in (acceleration, drift)])


def _uniform(fields: StrainFields) -> Array:
    """Return the covariance (n, n) of fields that are uniform, of variance 1."""
    same = fields.index[:, None] == fields.index
    return np.asarray(np.outer(fields.uniform, fields.uniform) * same)


def _initial(config: EstimatorConfig, fields: StrainFields) -> Array:
    """Return the initial covariance; the disturbance can change by its own size within a second."""
    start, stretch = config.initial, fields.stretch
    white, uniform = fields.root.T @ fields.root, _uniform(fields)
    position = np.where(stretch, start.stretch_std, start.curvature_std_per_m)
    rate = np.where(stretch, start.stretch_rate_std_per_s, start.curvature_rate_std_per_m_s)
    disturbance = np.where(stretch, start.stretch_disturbance_std, start.curvature_disturbance_std_per_m)
    blocks = [std[:, None] ** 2 * white for std in (position, rate)]
    if config.disturbance:
        blocks += 2 * [disturbance[:, None] ** 2 * uniform]
    n, count = len(stretch), len(blocks)
    matrix = np.zeros((count, n, count, n))
    for i, block in enumerate(blocks):
        matrix[i, :, i, :] = block
    return matrix.reshape(count * n, count * n)
