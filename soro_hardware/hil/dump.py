"""Prove a dump valve: a chamber must become empty although its regulator is commanded to hold a pressure."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from pydantic import Field

from soro_core import safety
from soro_core.config import Strict, with_changes
from soro_core.errors import ConfigError, HardwareError
from soro_hardware.finding import Finding, Level
from soro_hardware.hil.paced import CycleSample, PacedRegulator, small_limits
from soro_hardware.platform import PlatformBase
from soro_hardware.port import EMPTY_PA

_REST_S, _RISE_S, _STEADY_S, _STAYS_S = 0.5, 5.0, 0.5, 0.5
_LEVEL_PA = 2e3  # distance from the set point within which the chamber holds it
_RISE_PA_S = 50e3
# As wide as the limiter allows: the monitors would else vent by the valves before a slow dump valve has shown
# what it does. The chamber has too little pressure for them to matter.
_WIDE = {"model_pa": 30e3, "leak_pa_s": 20e3, "supply_margin_pa": 0.0, "supply_s": 1.0}
_STOPS = ("stop pressed", "stop silent", "stop_pressed")  # causes of a stop that is an input
_NO_PROOF = "nothing is proved of the dump valve"


class DumpConfig(Strict):
    """Pressure and times of the proof."""

    pressure_pa: float = Field(8e3, ge=5e3, le=20e3, description="pressure of the chamber [Pa gauge]")
    limit_s: float = Field(
        2.0, ge=0.1, le=5.0, description="time in which the chamber must become empty, from its first fall"
    )
    wait_s: float = Field(60.0, ge=1, le=600, description="longest wait for the dump valve to be opened")


def dump_limits(platform: PlatformBase, config: DumpConfig) -> safety.Limits:
    """Return limits just above the pressure of the proof.

    Raises
    ------
    ConfigError
        If the pressure is beyond the platform's range.
    """
    if config.pressure_pa > platform.range.maximum_pa:
        allowed = f"a pressure up to the platform's {platform.range.maximum_pa:g} Pa"
        raise ConfigError("dump valve", "pressure_pa", config.pressure_pa, allowed)
    limits = small_limits(platform, config.pressure_pa, _RISE_PA_S)
    return with_changes(limits, monitors=with_changes(limits.monitors, **_WIDE))


def prove(
    config: DumpConfig,
    name: str,
    chamber: int,
    regulator: PacedRegulator,
    tell: Callable[[str], None],
    stopped: Callable[[], bool] = lambda: False,
) -> Finding:
    """Pressurise one chamber, wait until the dump valve is opened, and judge how the pressure falls.

    The regulator is commanded to hold the pressure all the time, so that only the dump valve can empty the
    chamber. Where something vents by the valves meanwhile (a trip, the input of an emergency stop), there is
    no proof.

    Parameters
    ----------
    config : DumpConfig
        Pressure and times.
    name : str
    chamber : int
        Its number.
    regulator : PacedRegulator
        Regulator behind the limiter; vented at the end.
    tell : callable
        Called with what the operator is to do, as soon as the pressure is there.
    stopped : callable
        Returns whether to vent and end.
    """
    what = f"dump valve at {name}"
    try:
        found = _proved(config, chamber, regulator, tell, stopped)
    except HardwareError as error:
        advice = "remove the cause"
        if any(word in str(error) for word in _STOPS):
            advice = "open the dump valve alone: pull its plug, and leave the emergency stop released"
        return Finding(what, "fail", f"{error}: vented by the valves; {_NO_PROOF}", f"{advice}; then again")
    finally:
        regulator.vent("the dump valve is examined")
    return Finding(what, *found)


def _proved(
    config: DumpConfig,
    chamber: int,
    regulator: PacedRegulator,
    tell: Callable[[str], None],
    stopped: Callable[[], bool],
) -> tuple[Level, str, str]:
    """Level, text and advice of the finding; raises `HardwareError` if something vents."""

    def hold(pressure_pa: float, limit_s: float) -> Iterator[tuple[float, float]]:
        """Time [s] and reading [Pa] of each cycle at a set point that brought one."""
        wanted = np.zeros(regulator.n_chambers)
        wanted[chamber] = pressure_pa
        for _ in range(max(round(limit_s / regulator.period_s), 1)):
            if stopped():
                regulator.vent("interrupted")
            sample: CycleSample = regulator.cycle(wanted)
            if sample.cause is not None:
                raise HardwareError(sample.cause, code="vented")
            if sample.fresh[chamber]:
                yield sample.t_s, float(sample.reading_pa[chamber])

    asked_pa, reading_pa = config.pressure_pa, np.nan
    for _, now_pa in hold(0.0, _REST_S):
        reading_pa = now_pa
    if not abs(reading_pa) < EMPTY_PA:  # also without any reading
        return "fail", f"{_kpa(reading_pa)} at rest; {_NO_PROOF}", "empty the chamber, or zero its sensor"
    steady_s = None
    for t_s, reading_pa in hold(asked_pa, _RISE_S):
        if abs(reading_pa - asked_pa) > _LEVEL_PA:
            steady_s = None
        elif steady_s is None:
            steady_s = t_s
        elif t_s - steady_s >= _STEADY_S:
            break
    else:
        found = f"{_kpa(reading_pa)} at set point {_kpa(asked_pa)}; {_NO_PROOF}"
        return (
            "fail",
            found,
            "shut the dump valve, open the supply; `soro hil first-pressure` looks closer",
        )
    tell(f"the chamber holds {_kpa(reading_pa)}: open the dump valve now, within {config.wait_s:g} s")
    held_s = t_s
    for t_s, reading_pa in hold(asked_pa, config.wait_s):
        if reading_pa > asked_pa - _LEVEL_PA:
            held_s = t_s
        elif reading_pa < EMPTY_PA:
            break
        elif t_s - held_s > config.limit_s:
            found = f"still {_kpa(reading_pa)} {config.limit_s:g} s after the first fall"
            return (
                "fail",
                found,
                "no pressure before it is mended: its way out is too narrow, or it opens in part",
            )
    else:
        found = f"{_kpa(reading_pa)} after {config.wait_s:g} s: it was not opened, or does not open"
        return "fail", found, "no pressure before it opens: look at its coil, its spring and its line"
    took_s = t_s - held_s
    for _, reading_pa in hold(asked_pa, _STAYS_S):
        if reading_pa > EMPTY_PA:
            return "fail", f"empty after {took_s:.2f} s, then {_kpa(reading_pa)} again", "it must stay open"
    return "ok", f"empty in {took_s:.2f} s although the regulator was commanded to hold {_kpa(asked_pa)}", ""


def _kpa(pressure_pa: float) -> str:
    return "no reading" if np.isnan(pressure_pa) else f"{pressure_pa / 1e3:.1f} kPa"
