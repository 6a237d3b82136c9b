"""What robot, platform and limits let an excitation ask of the regulators."""

from __future__ import annotations

import math
from dataclasses import dataclass

from soro_core.errors import ConfigError
from soro_core.pneumatics import RegulatorModel
from soro_core.robot import Robot
from soro_core.safety import Limits
from soro_lab.excitation.config import ExciteConfig

# The amplitude that the lag leaves at the end of a sweep, part of that of the set points.
LEFT = 0.25
# Samples of the loop in a period at the end of a sweep.
SAMPLES = 10.0
# Part of the rate limits that is used: rounding to ticks may not pass them.
RATE_PART = 0.95


@dataclass(frozen=True)
class Supply:
    """Range and rates of the set points.

    Attributes
    ----------
    names : tuple of str
        Names of the chambers.
    links : tuple of tuple of int
        Numbers of the chambers of each link that has some.
    low_pa, high_pa : float
        Lowest and highest set point [Pa gauge]; 0 lies within.
    rise_pa_s, fall_pa_s : float
        Fastest rise and fall of a set point [Pa/s].
    sweep_low_hz, sweep_high_hz : float
        Frequencies of a sweep.
    """

    names: tuple[str, ...]
    links: tuple[tuple[int, ...], ...]
    low_pa: float
    high_pa: float
    rise_pa_s: float
    fall_pa_s: float
    sweep_low_hz: float
    sweep_high_hz: float


def supply_of(
    robot: Robot,
    limits: Limits,
    response: RegulatorModel,
    config: ExciteConfig,
    rate_hz: float,
    where: str,
) -> Supply:
    """Return the range and the rates that are left.

    Parameters
    ----------
    robot : Robot
        Robot as its file describes it.
    limits : Limits
        Limits of the limiter within the range of the platform.
    response : RegulatorModel
        Lag of the regulators in the loop.
    config : ExciteConfig
        Keys of the excitation.
    rate_hz : float
        Ticks of the loop a second.
    where : str
        File or node of the configuration, for errors.

    Raises
    ------
    ConfigError
        If a key asks for more than the limits allow, or they leave nothing.
    """
    low = max(limits.minimum_pa, response.minimum_pa, robot.pressure_range_pa[0])
    high = min(limits.maximum_pa, response.maximum_pa, robot.pressure_range_pa[1])
    if low > 0.0 or high <= 0.0:
        allowed = "a range of robot, platform and limits from 0 or below to above 0: chambers start empty"
        raise ConfigError(where, "limits", (low, high), allowed)
    if config.maximum_pa is not None and config.maximum_pa > high:
        raise ConfigError(
            where, "excite.maximum_pa", config.maximum_pa, f"up to {high:g}, the range of the run"
        )
    if config.minimum_pa is not None and config.minimum_pa < low:
        raise ConfigError(
            where, "excite.minimum_pa", config.minimum_pa, f"from {low:g}, the range of the run"
        )
    lag_s = max(response.tau_s, response.falling_tau_s)
    # A lag leaves 1 / sqrt(1 + (2 pi f tau)^2) of an amplitude.
    by_lag = math.sqrt(1.0 / LEFT**2 - 1.0) / (2.0 * math.pi * lag_s) if lag_s > 0.0 else math.inf
    top = min(config.sweep_high_hz, by_lag, rate_hz / SAMPLES)
    chambers = _by_link(robot)
    return Supply(
        names=robot.chamber_names,
        links=chambers,
        low_pa=low if config.minimum_pa is None else config.minimum_pa,
        high_pa=high if config.maximum_pa is None else config.maximum_pa,
        rise_pa_s=RATE_PART * limits.rise_pa_s,
        fall_pa_s=RATE_PART * limits.fall_pa_s,
        sweep_low_hz=min(config.sweep_low_hz, 0.5 * top),
        sweep_high_hz=top,
    )


def _by_link(robot: Robot) -> tuple[tuple[int, ...], ...]:
    found, first = [], 0
    for link in robot.links:
        if link.chambers:
            found.append(tuple(range(first, first + len(link.chambers))))
        first += len(link.chambers)
    return tuple(found)
