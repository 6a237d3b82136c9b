"""Convert set points of regulators to effective chamber pressures, and back.

With the dead band d and the swelling s of a chamber, of its set point p acts

    a = b / (1 - s |b|),  b = p - d,    so that    p = d + a / (1 + s |a|),    docs/model.md (56), (57).

A chamber with a dead band is kept at the band or above, where this is one line without a step. Below it the
line goes on, for searches beyond the bounds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_core.errors import ConfigError
from soro_core.robot import Robot


@dataclass(frozen=True)
class EffectivePressure:
    """Dead bands (n_u,) [Pa] and swelling (n_u,) [1/Pa] of the chambers of an arm."""

    dead_band_pa: Array
    swell_per_pa: Array

    def from_setpoint(self, pressure_pa: Array) -> Array:
        """Return effective pressures (n_u,) [Pa] of set points (n_u,) [Pa gauge] in the robot's range."""
        beyond = pressure_pa - self.dead_band_pa
        return np.asarray(beyond / (1.0 - self.swell_per_pa * np.abs(beyond)))

    def to_setpoint(self, effective_pa: Array) -> Array:
        """Return the set points (n_u,) [Pa gauge] of effective pressures (n_u,) [Pa]."""
        return np.asarray(self.dead_band_pa + effective_pa / (1.0 + self.swell_per_pa * np.abs(effective_pa)))


def effective_pressure_of(robot: Robot) -> EffectivePressure:
    """Return dead bands and swelling of a robot's chambers."""
    chambers = [chamber for link in robot.links for chamber in link.chambers]
    return EffectivePressure(
        np.array([c.dead_band_pa for c in chambers]), np.array([c.swell_per_pa for c in chambers])
    )


def check_dead_bands(robot: Robot, low_pa: float, high_pa: float) -> None:
    """Check that the set points reach beyond each dead band, and not to both sides of it.

    Parameters
    ----------
    robot : Robot
        Discretised robot.
    low_pa, high_pa : float
        Range of the set points [Pa gauge].

    Raises
    ------
    ConfigError
        If the range is not above a dead band alone: across it no small change of a set point has an effect.
    """
    for name, band in zip(robot.chamber_names, effective_pressure_of(robot).dead_band_pa, strict=True):
        if band > 0.0 and not (low_pa > -band and high_pa > band):
            allowed = f"set points above -{band:g} that reach beyond {band:g}, not {low_pa:g} to {high_pa:g}"
            raise ConfigError("controller", "dead_band_pa", f"{band:g} of {name}", allowed)
