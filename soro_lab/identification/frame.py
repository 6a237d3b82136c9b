"""The frame of a curvature measurement: its rotation about the tangent and its offsets.

A camera or marker frame is rotated against the numbering of the chambers, and a robot that was printed
slightly bent has a curvature at rest. Both are properties of the measurement: they are fitted and reported,
but not part of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array

# Iterations of re-weighting; each reduces the weight of outliers, 20 converge to 1e-6.
_ROUNDS = 20


@dataclass(frozen=True)
class MeasurementFrame:
    """measured = R(rotation) simulated + offset.

    Attributes
    ----------
    rotation : float
        Angle [rad] about the tangent from the model's to the measured frame.
    offset : tuple of float
        Measured curvature [1/m] where the model is straight.
    """

    rotation: float
    offset: tuple[float, float]

    def apply(self, curvature: ArrayLike) -> Array:
        """Return curvatures (n, 2) [1/m] of the model in the frame of the measurement."""
        c, s = np.cos(self.rotation), np.sin(self.rotation)
        turned: Array = np.asarray(curvature, float) @ np.array([[c, s], [-s, c]])
        turned += np.asarray(self.offset)
        return turned


@dataclass(frozen=True)
class CurvatureErrors:
    """Root mean square errors of a curvature."""

    vector: float
    """Of the curvature vector [1/m]."""
    magnitude: float
    """Of its magnitude [1/m]."""


def curvature_errors(
    measured: ArrayLike, simulated: ArrayLike, rotation: float = 0.0, offset: ArrayLike = (0.0, 0.0)
) -> CurvatureErrors:
    """Compare measured curvatures with simulated ones in the measured frame.

    Parameters
    ----------
    measured, simulated : array_like of shape (n, 2)
        Curvatures kx, ky [1/m] at the same times.
    rotation : float
        Angle from the model's to the measured frame [rad].
    offset : array_like of shape (2,)
        Measured curvature of the straight model [1/m].

    Returns
    -------
    CurvatureErrors
        vector: sqrt(mean |measured - shown|^2), magnitude: sqrt(mean (|measured| - |shown|)^2),
        with shown = R(rotation) simulated + offset.
    """
    first, second = np.asarray(offset, float)
    measured, simulated = _pairs(measured, simulated)
    shown = MeasurementFrame(float(rotation), (float(first), float(second))).apply(simulated)
    vector = np.sqrt(np.mean(np.sum((measured - shown) ** 2, axis=1)))
    magnitude = np.sqrt(np.mean((np.linalg.norm(measured, axis=1) - np.linalg.norm(shown, axis=1)) ** 2))
    return CurvatureErrors(float(vector), float(magnitude))


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
    measured, simulated = _pairs(measured, simulated)
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


def _pairs(measured: ArrayLike, simulated: ArrayLike) -> tuple[Array, Array]:
    a, b = np.asarray(measured, float), np.asarray(simulated, float)
    if a.ndim != 2 or a.shape[1] != 2 or a.shape != b.shape or not len(a):
        raise ValueError(f"shapes {a.shape} and {b.shape} of curvatures: allowed are two equal shapes (n, 2)")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ValueError("curvatures with values that are not finite: leave those samples out first")
    return a, b
