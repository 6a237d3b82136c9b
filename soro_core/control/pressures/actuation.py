"""The section `pressures` of a controller file, completed from the limits and the regulator model.

The limiter's file states the limits, the platform file the lag and the dead time of the regulators. A
controller file may state values of its own; keys that it leaves out are derived from those two.
"""

from __future__ import annotations

from typing import Any

from soro_core.config import parse, with_changes
from soro_core.control.config import AllocationConfig
from soro_core.errors import ConfigError
from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.robot import Robot
from soro_core.safety.limits import Limits, usable_range

# Loop rate where no other is given [Hz].
DEFAULT_RATE_HZ = 200.0


class CompletePressures(AllocationConfig):
    """Section `pressures` with a value for every key."""

    minimum_pa: float
    maximum_pa: float
    rise_pa_s: float
    fall_pa_s: float
    preview_s: float
    lag_s: float
    dead_time_s: float
    play_pa: float


# Keys that `Limits` has too; True for a lower bound, False for an upper one.
_LIMITED = {"minimum_pa": True, "maximum_pa": False, "rise_pa_s": False, "fall_pa_s": False}


def complete_pressures(
    pressures: AllocationConfig,
    limits: Limits | None = None,
    response: RegulatorModel = RegulatorModel(),  # noqa: B008 -- frozen
    rate_hz: float = DEFAULT_RATE_HZ,
    transport_s: float = 0.0,
) -> CompletePressures:
    """Return the pressures with missing keys derived, and values beyond the limits replaced by the limits.

    Parameters
    ----------
    pressures : AllocationConfig
        Section of the controller file.
    limits : Limits, optional
        Limits of the limiter that the set points pass. Without them, missing keys get the defaults of
        `Limits`, and no stated value is replaced.
    response : RegulatorModel
        Lag, dead time and play of the regulators.
    rate_hz : float
        Rate of the loop [Hz].
    transport_s : float
        Time until a set point reaches the regulators: 0 in a bare loop, a tick between nodes [s].

    Returns
    -------
    CompletePressures

    Raises
    ------
    ConfigError
        If the range of pressures is empty.
    """
    values: dict[str, Any] = pressures.model_dump(exclude_none=True)
    beyond = [] if limits is None else _beyond(pressures, limits)
    usual = limits or Limits()
    values |= {name: getattr(usual, name) for name in _LIMITED if name not in values or name in beyond}
    lag_s = values.setdefault("lag_s", response.tau_s)
    # Transport, dead time, and the part of the lag and of half a sample and hold that the lead filter leaves.
    lead = max(lag_s / pressures.lag_filter_s, 1.0)
    late_s = transport_s + response.delay_s
    values.setdefault("preview_s", late_s + (lag_s + 0.5 / rate_hz) / lead)
    values.setdefault("dead_time_s", late_s)
    values.setdefault("play_pa", response.hysteresis_pa)
    return parse(values, CompletePressures, where="controller: pressures")


def with_own_range(pressures: AllocationConfig, robot: Robot) -> AllocationConfig:
    """Return the section with the range of the robot [Pa gauge] where it states none and no limits do."""
    own = zip(("minimum_pa", "maximum_pa"), usable_range(robot.pressure_range_pa), strict=True)
    return with_changes(pressures, **{key: end for key, end in own if getattr(pressures, key) is None})


def contradictions(pressures: AllocationConfig, limits: Limits, response: RegulatorModel) -> list[str]:
    """Return one line for each value of a controller file that contradicts limits or regulators.

    Parameters
    ----------
    pressures : AllocationConfig
        Section of the controller file.
    limits : Limits
        Limits of the limiter.
    response : RegulatorModel
        Regulators of the platform.

    Returns
    -------
    list of str
    """
    lines = []
    for name in _beyond(pressures, limits):
        stated, allowed = getattr(pressures, name), getattr(limits, name)
        lines.append(f"pressures.{name} {stated:g} is beyond the limits: {allowed:g} is used")
    if pressures.lag_s is not None and pressures.lag_s != response.tau_s:
        stated = f"the platform's regulators have {response.tau_s:g} (tau_s)"
        lines.append(f"pressures.lag_s {pressures.lag_s:g} is used, but {stated}")
    return lines


def pressure_bounds(pressures: CompletePressures, robot: Robot) -> tuple[float, float]:
    """Return the lowest and the highest set point [Pa gauge] that file and robot allow.

    Raises
    ------
    ConfigError
        If the two ranges do not overlap.
    """
    low = max(pressures.minimum_pa, robot.pressure_range_pa[0])
    high = min(pressures.maximum_pa, robot.pressure_range_pa[1])
    if not low < high:
        allowed = f"a range that overlaps the robot's, {robot.pressure_range_pa}"
        raise ConfigError("controller", "pressures", (pressures.minimum_pa, pressures.maximum_pa), allowed)
    return low, high


def _beyond(pressures: AllocationConfig, limits: Limits) -> list[str]:
    """Return the keys whose stated values lie beyond the limits."""
    found = []
    for name, is_least in _LIMITED.items():
        stated, allowed = getattr(pressures, name), getattr(limits, name)
        if stated is not None and (stated < allowed if is_least else stated > allowed):
            found.append(name)
    return found
