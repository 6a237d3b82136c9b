"""The motion that sensors are placed for without a scene: from rest to ends of the pressures and back."""

from __future__ import annotations

import numpy as np

from soro_core.arrays import Array
from soro_core.model import SoftArm
from soro_lab.analysis.equilibrium_paths import place_at, rest_pressure, targets

# Bounds of the time that stands for one period of the slowest mode that swings [s].
SHORTEST_S, LONGEST_S = 0.05, 1.0


def slowest_period(arm: SoftArm) -> float:
    """Return the period [s] of the slowest mode about rest that swings, within bounds."""
    low, high = arm.robot.pressure_range_pa
    modes = place_at(arm, np.full(arm.n_u, rest_pressure(low, high))).modes
    swings = modes.damped_hz[modes.damped_hz > 0.0]
    period = 1.0 / swings.min() if swings.size else LONGEST_S
    return float(min(max(period, SHORTEST_S), LONGEST_S))


def excursions(arm: SoftArm, dt: float, period_s: float) -> list[Array]:
    """Return pressures (n_ticks, n_u) [Pa] of the motions: up, hold, down and hold, two periods each.

    Parameters
    ----------
    arm : SoftArm
    dt : float
        Time of a tick [s].
    period_s : float
        Period of its slowest mode [s].
    """
    low, high = arm.robot.pressure_range_pa
    rest = np.full(arm.n_u, rest_pressure(low, high))
    n = max(2, round(2.0 * period_s / dt))
    up, hold = np.linspace(0.0, 1.0, n), np.ones(n)
    share = np.concatenate([up, hold, up[::-1], 0.0 * hold])
    return [rest + share[:, None] * (end - rest) for _, end in targets(arm.robot.chamber_names, low, high)]
