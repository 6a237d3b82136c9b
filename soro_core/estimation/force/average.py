"""The average of a measured force: over long where it is noisy, and anew when it changes.

The noise along the weak direction, the chord of the arm, is a hundred times that across it, and reaches what
is across the tip of a bent arm. So both have a Kalman filter of a random walk of their own: one that is a
low-pass across the chord, and a much slower one along it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array

# Rate along the weak direction [rad/s].
_ALONG_PER_S = 0.3
# Square of the deviations of the noise from which on another force is a new one.
_NEW = 25.0
# Error of the force of inertia along the weak direction, in parts of that across it.
INERTIA_ALONG = 3.0
# Parts of a new force along the weak direction that are expected, of that across it: of a push, and of what
# may be a load.
ALONG, ALONG_LOAD = 0.5, 5.0
_ONE = np.eye(3)


class Axes(NamedTuple):
    """Principal axes of a covariance: variances (3,), from the least on, and directions (3, 3), columns."""

    variances: Array
    directions: Array

    @property
    def weak(self) -> Array:
        """Direction (3,) of the largest variance."""
        return self.directions[:, -1]


def axes_of(covariance: Array) -> Axes:
    """Return the principal axes of a covariance (3, 3)."""
    return Axes(*np.linalg.eigh(covariance))


class NoisyForce(NamedTuple):
    """A measured force.

    Attributes
    ----------
    force_n : ndarray (3,)
        [N].
    density : Axes
        Those of the covariance of its noise, times the time for which that lasts [N^2 s].
    inertia : float
        The same of the error of the force of inertia in each direction across the weak one [N^2 s].
    """

    force_n: Array
    density: Axes
    inertia: float


class Average(NamedTuple):
    """A force (3,) [N], and its variances by noise along and across the weak direction [N^2]."""

    force_n: Array
    along: float
    across: float


def averaged(
    before: Average | None, seen: NoisyForce, rate: float, dt: float, along_part: float = ALONG
) -> Average:
    """Return the average with one more measured force.

    Parameters
    ----------
    before : Average or None
        None before the first force.
    seen : NoisyForce
    rate : float
        Rate of the low-pass across the weak direction [rad/s].
    dt : float
        Time since the last one [s].
    along_part : float
        Part of a new force along the weak direction that is expected, of that across it.
    """
    _, noise_across, noise_along = seen.density.variances.tolist()
    noise_across = (noise_across + seen.inertia) / max(dt, 1e-3)
    noise_along = (noise_along + seen.inertia * INERTIA_ALONG**2) / max(dt, 1e-3)
    if before is None or dt <= 0.0:
        return Average(seen.force_n, noise_along, noise_across)
    weak, off = seen.density.weak, seen.force_n - before.force_n
    along = float(weak @ off) * weak
    across = off - along
    size = float(across @ across)
    way, way_along = dt * rate, dt * _ALONG_PER_S
    spread_across = before.across + way * way * noise_across
    spread_along = before.along + way_along * way_along * noise_along
    if size > _NEW * (spread_across + noise_across):
        spread_across, spread_along = spread_across + size, spread_along + size * along_part**2
    gain = spread_across / (spread_across + noise_across)
    gain_along = spread_along / (spread_along + noise_along)
    force_n = before.force_n + gain * across + gain_along * along
    return Average(force_n, (1.0 - gain_along) * spread_along, (1.0 - gain) * spread_across)


def covariance_of(average: Average, weak: Array) -> Array:
    """Return the covariance (3, 3) [N^2] of an average by noise with a weak direction (3,)."""
    square = weak[:, None] * weak
    return np.asarray(average.across * (_ONE - square) + average.along * square)
