"""Distance along a path over time, from rest to rest, within limits of speed and acceleration.

The speed rises and falls along the quintic `smooth_step` and is constant between. So the acceleration is
continuous with a continuous rate: the inverse of the regulators' lag differentiates the pressures once more.
On a path of curvature k, a point of speed v and tangential acceleration a has the acceleration
sqrt(a^2 + (k v^2)^2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from soro_core.control.reference.trajectory import smooth_step

# Largest slope of `smooth_step`, at its middle.
STEEPEST = 1.875


@dataclass(frozen=True)
class SpeedLaw:
    """Speed that rises within `ramp_s`, stays, and falls within `ramp_s`.

    Attributes
    ----------
    length_m : float
        Length of the path [m].
    speed_m_s : float
        Largest speed [m/s].
    ramp_s : float
        Duration of the rise and of the fall [s].
    """

    length_m: float
    speed_m_s: float
    ramp_s: float

    @property
    def duration_s(self) -> float:
        """Time from rest to rest [s]."""
        return self.length_m / self.speed_m_s + self.ramp_s

    def at(self, t: float) -> tuple[float, float, float]:
        """Return distance [m], speed [m/s] and acceleration [m/s^2] at time `t` [s]; at rest outside."""
        t = min(max(t, 0.0), self.duration_s)
        left = self.duration_s - t
        if t < self.ramp_s:
            return self._ramp(t)
        if left < self.ramp_s:
            distance, speed, acceleration = self._ramp(left)
            return self.length_m - distance, speed, -acceleration
        return self.speed_m_s * (t - 0.5 * self.ramp_s), self.speed_m_s, 0.0

    def _ramp(self, t: float) -> tuple[float, float, float]:
        x = t / self.ramp_s
        part, slope, _ = smooth_step(x)
        passed = x**4 * (2.5 - 3.0 * x + x * x)  # integral of the smooth step
        return (
            self.speed_m_s * self.ramp_s * passed,
            self.speed_m_s * part,
            self.speed_m_s * slope / self.ramp_s,
        )


def speed_law(
    length_m: float, speed_m_s: float, acceleration_m_s2: float, curvature_per_m: float = 0.0
) -> SpeedLaw:
    """Return the law of a path from rest to rest.

    Parameters
    ----------
    length_m : float
        Length of the path [m], above 0.
    speed_m_s : float
        Largest speed [m/s], above 0.
    acceleration_m_s2 : float
        Largest acceleration, the one towards the centre of a curve included [m/s^2], above 0.
    curvature_per_m : float
        Largest curvature of the path [1/m].

    Returns
    -------
    SpeedLaw
    """
    speed, tangential = speed_m_s, acceleration_m_s2
    if curvature_per_m > 0.0:
        # The fastest curve leaves as much acceleration along the path as it takes towards its centre.
        speed = min(speed, math.sqrt(acceleration_m_s2 / (math.sqrt(2.0) * curvature_per_m)))
        tangential = math.sqrt(acceleration_m_s2**2 - (curvature_per_m * speed * speed) ** 2)
    # A short path ends its rise where its fall begins: speed * ramp = length.
    speed = min(speed, math.sqrt(length_m * tangential / STEEPEST))
    return SpeedLaw(length_m, speed, STEEPEST * speed / tangential)
