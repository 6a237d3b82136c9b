"""The frame of a curvature measurement: its rotation about the tangent and its offsets.

A camera or marker frame is rotated against the numbering of the chambers, and a robot that was printed
slightly bent has a curvature at rest. Both are properties of the measurement, not of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from soro_core.arrays import Array


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
    measured, simulated = paired(measured, simulated)
    shown = MeasurementFrame(float(rotation), (float(first), float(second))).apply(simulated)
    vector = np.sqrt(np.mean(np.sum((measured - shown) ** 2, axis=1)))
    magnitude = np.sqrt(np.mean((np.linalg.norm(measured, axis=1) - np.linalg.norm(shown, axis=1)) ** 2))
    return CurvatureErrors(float(vector), float(magnitude))


def paired(measured: ArrayLike, simulated: ArrayLike) -> tuple[Array, Array]:
    """Return curvatures (n, 2) [1/m] as arrays; ValueError if shapes differ or a value is not finite."""
    a, b = np.asarray(measured, float), np.asarray(simulated, float)
    if a.ndim != 2 or a.shape[1] != 2 or a.shape != b.shape or not len(a):
        raise ValueError(f"shapes {a.shape} and {b.shape} of curvatures: allowed are two equal shapes (n, 2)")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise ValueError("curvatures with values that are not finite: leave those samples out first")
    return a, b
