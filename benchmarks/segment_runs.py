"""Recorded runs of one segment: their simulation with a robot model, releases, and the fitted frame.

A measured curvature is the bending angle divided by the length: the mean of a strain that varies along the
link. A release starts from a curvature that is uniform along the link.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array
from soro_core.errors import ModelError
from soro_core.integrate import simulate
from soro_core.model import SoftArm
from soro_core.model.equilibrium.statics import equilibrium
from soro_core.robot.coordinates import StrainFields, strain_fields
from soro_lab.identification.frame import MeasurementFrame, paired
from soro_lab.identification.records import ForcedRun, read_columns

# Iterations of re-weighting; each reduces the weight of outliers, 20 converge to 1e-6.
_ROUNDS = 20


@dataclass(frozen=True)
class ReleaseRun:
    """Bending angle after the release of the tip.

    Attributes
    ----------
    t : array of shape (n_t,)
        Time [s], from 0.
    bend : array of shape (n_t,)
        Bending angle kappa L (1 + eps) [rad].
    """

    t: Array
    bend: Array


def read_release(path: str | Path) -> ReleaseRun:
    """Read a release with the columns t [s] and bend_deg [degrees]; errors as `read_forced`."""
    columns = read_columns(path, ("t", "bend_deg"))
    return ReleaseRun(columns["t"] - columns["t"][0], np.radians(columns["bend_deg"]))


def forced_curvature(arm: SoftArm, run: ForcedRun, dt: float = 0.02, link: int = 0) -> tuple[Array, Array]:
    """Simulate the curvature under the measured pressures, from rest at the first sample.

    Parameters
    ----------
    arm : SoftArm
        Model with bending_x and bending_y on `link`.
    run : ForcedRun
        Measured pressures; the arm is at rest at the first sample.
    dt : float
        Time step [s]; 20 ms are enough for fitting, since the recorded motion is slow.
    link : int
        Number of the link whose curvature is returned.

    Returns
    -------
    t : array of shape (n,)
        Times of the run [s].
    curvature : array of shape (n, 2)
        Means of kx, ky [1/m] over the link, in the frame of the model.

    Raises
    ------
    ModelError
        If the link lacks one of the two bendings, or the simulation fails.
    """
    fields = strain_fields(arm.robot)
    means = np.stack([_mean(fields, strain, link) for strain in ("bending_x", "bending_y")])
    begin = float(run.t[0])
    q0 = equilibrium(arm, run.pressure[0])
    steps = int((float(run.t[-1]) - begin) / dt + 1e-9)
    result = simulate(
        arm, q0, np.zeros(arm.n_q), t_end=steps * dt, dt=dt, pressure=lambda t: run.pressure_at(begin + t)
    )
    q = np.asarray(result.q, float)
    if len(q) != steps + 1 or not np.isfinite(q).all():
        raise ModelError(
            f"the forced run failed after {len(q)} of {steps + 1} samples: {result.status.message}"
        )
    return begin + np.asarray(result.t, float), q @ means.T


def release_bend(
    arm: SoftArm, bend: float, t_end: float, dt: float = 1e-3, internal: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Simulate the release of the arm from a bending angle, at rest and without pressure.

    Parameters
    ----------
    arm : SoftArm
        Model of one link with bending_y.
    bend : float
        Bending angle at the start [rad].
    t_end, dt : float
        Duration and time step [s].
    internal : array_like of shape (n_internal,), optional
        States of creep and hysteresis at the start; default 0, relaxed: the arm was held bent for long. An
        arm that was bent at once has those of creep at -q. A recording does not show them, so a fit may have
        them as parameters.

    Returns
    -------
    t, bend : arrays of shape (n,)
        Time [s] and bending angle kappa L (1 + eps) [rad] of the mean strains.

    Raises
    ------
    ModelError
        If the arm has more than one link or no bending_y, `internal` is not allowed, or the simulation fails.
    """
    if len(arm.robot.links) != 1:
        raise ModelError(
            f"release of {arm.robot.name}: got {len(arm.robot.links)} links; allowed is one", "links"
        )
    fields = strain_fields(arm.robot)
    curvature, stretch = _mean(fields, "bending_y", 0), fields.of("elongation") * fields.mean
    length = arm.robot.links[0].length
    q0 = equilibrium(arm, np.zeros(arm.n_u))
    shape = fields.of("bending_y") * fields.uniform
    q0 += shape * bend / (length * (1 + stretch @ q0) * (curvature @ shape))
    result = simulate(arm, q0, np.zeros(arm.n_q), t_end=t_end, dt=dt, pressure=None, internal0=internal)
    q = np.asarray(result.q, float)
    if not np.isfinite(q).all() or result.t[-1] < t_end - 1.5 * dt:
        raise ModelError(f"the release failed at {result.t[-1]} s: {result.status.message}")
    return np.asarray(result.t, float), (q @ curvature) * length * (1 + q @ stretch)


def fit_frame(
    measured: ArrayLike, simulated: ArrayLike, outlier_scale: float | None = None
) -> MeasurementFrame:
    """Return the rotation and offset with the smallest difference of simulated and measured curvatures.

    Parameters
    ----------
    measured, simulated : array_like of shape (n, 2)
        Curvatures [1/m] at the same times.
    outlier_scale : float, optional
        Errors e beyond this scale [1/m] have less weight, 1 / sqrt(1 + (e / scale)^2) (soft-L1 loss). None:
        ordinary least squares, in closed form.
    """
    measured, simulated = paired(measured, simulated)
    frame = _weighted(measured, simulated, np.ones(len(measured)))
    for _ in range(_ROUNDS if outlier_scale is not None else 0):
        error = np.linalg.norm(measured - frame.apply(simulated), axis=1)
        frame = _weighted(measured, simulated, 1.0 / np.sqrt(1.0 + (error / outlier_scale) ** 2))
    return frame


def _weighted(measured: Array, simulated: Array, weight: Array) -> MeasurementFrame:
    """Return the weighted fit in closed form: rotation from the complex correlation, then the offset."""
    a, b = simulated @ np.array([1, 1j]), measured @ np.array([1, 1j])
    total = weight.sum()
    mean_a, mean_b = (weight * a).sum() / total, (weight * b).sum() / total
    correlation = (weight * (b - mean_b) * (a - mean_a).conj()).sum()
    rotation = float(np.angle(correlation))
    offset = mean_b - mean_a * np.exp(1j * rotation)
    return MeasurementFrame(rotation, (float(offset.real), float(offset.imag)))


def _mean(fields: StrainFields, strain: str, link: int) -> Array:
    """Return the row (n_q,) whose product with q is the mean of a strain over a link."""
    row = fields.of(strain, link)
    if not row.any():
        found = ", ".join(f"link{i}/{name}" for i, name in zip(fields.links, fields.strains, strict=True))
        key = f"link{link}/{strain}"
        raise ModelError(f"recorded run: got an arm with {found}; required is {key}", key)
    return row * fields.mean
