"""The steps of a latency measurement: limits that allow them, and commands one cycle after another."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soro_core import safety
from soro_core.errors import ConfigError, HardwareError
from soro_hardware.hil.latency import LatencyConfig
from soro_hardware.hil.paced import CycleSample, PacedRegulator, small_limits
from soro_hardware.platform import PlatformBase

# Steepest slew of the limiter, the largest step of a cycle.
STEEPEST_PA_S = 2e6


def latency_limits(platform: PlatformBase, config: LatencyConfig) -> safety.Limits:
    """Return limits just above the steps, with a slew that allows each step within one cycle.

    Raises
    ------
    ConfigError
        If the slew exceeds that of the limiter, or the steps exceed the platform's range.
    """
    most_pa = config.low_pa + config.step_pa
    if most_pa > platform.range.maximum_pa:
        top = f"low_pa and step_pa together up to the platform's {platform.range.maximum_pa:g} Pa"
        raise ConfigError("latency", "step_pa", config.step_pa, top)
    slew_pa_s = 1.01 * config.step_pa * platform.cycle_hz
    if slew_pa_s > STEEPEST_PA_S:
        at_most = STEEPEST_PA_S / platform.cycle_hz / 1.01
        raise ConfigError("latency", "step_pa", config.step_pa, f"at most {at_most:.0f} Pa: one cycle's slew")
    return small_limits(platform, most_pa, slew_pa_s, slew_pa_s)


def measure(
    config: LatencyConfig, regulator: PacedRegulator, stopped: Callable[[], bool] = lambda: False
) -> list[list[CycleSample]]:
    """Command the steps and record samples.

    Parameters
    ----------
    config : LatencyConfig
        Steps.
    regulator : PacedRegulator
        Regulator behind the limiter.
    stopped : callable
        Function that returns whether to vent and end.

    Returns
    -------
    list of list of Sample
        Samples of each chamber.

    Raises
    ------
    HardwareError
        If the limiter vents, or `stopped` returns True; the chambers are then vented.
    """
    n = regulator.n_chambers
    cycles = max(round(config.hold_s / regulator.period_s), 1)
    found = []
    for chamber in range(n):
        samples: list[CycleSample] = []
        # The first steps come from above, so that valves with play start all steps up from the same state.
        high = config.low_pa + config.step_pa
        for level in (high, high, *(config.low_pa, high) * config.repeat, config.low_pa, 0.0):
            wanted = np.zeros(n)
            wanted[chamber] = level
            for _ in range(cycles):
                if stopped():
                    regulator.vent("interrupted")
                samples.append(regulator.cycle(wanted))
                if samples[-1].cause is not None:
                    raise HardwareError(f"vented: {samples[-1].cause}", code="vented")
        found.append(samples)
    return found
