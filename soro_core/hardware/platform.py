"""Platform files: which regulators feed which chambers, over which bus, and how they are emulated.

What all families have in common; each one's own keys are in its folder (see `soro_core.hardware.families`).
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeAlias, TypeVar

from pydantic import Field, field_validator, model_validator

from soro_core.config import Strict, find_config, parse, read_yaml
from soro_core.errors import ConfigError
from soro_core.hardware.families import FAMILIES
from soro_core.hardware.port import Regulator
from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.safety import Limits, Rating, for_regulators

_CHAMBER = re.compile(r"link\d+/chamber\d+")

Value = TypeVar("Value")

# Part of a loop's rate below which chambers are served in turn, not in every cycle.
IN_TURN = 0.9


class ValveBase(Strict):
    """One regulator: the chamber that it feeds; where it is on the bus is the family's."""

    chamber: str = Field(description="name of the chamber, for example link0/chamber0")

    @field_validator("chamber")
    @classmethod
    def _named(cls, value: str) -> str:
        if not _CHAMBER.fullmatch(value):
            raise ValueError("a name of the form link0/chamber0")
        return value


class PressureRange(Strict):
    """Set points that the driver accepts and the devices are limited to; 0 lies inside, so they can vent."""

    minimum_pa: float = Field(0.0, ge=-101e3, le=0, description="lowest set point [Pa gauge]")
    maximum_pa: float = Field(gt=0, le=2e6, description="highest set point [Pa gauge]")


class EmulationBase(Strict):
    """How the emulated devices of a platform behave: their air, whatever the family."""

    regulator: RegulatorModel = RegulatorModel()
    step_s: float = Field(0.0025, ge=0.0005, le=0.05, description="step of the air in real time")


class Freshness(Strict):
    """When a chamber's reading is no longer one."""

    stale_cycles: int = Field(3, ge=1, le=100, description="missed readings in a row that make a fault")
    stale_s: float = Field(0.05, gt=0, le=0.5, description="age of a reading that makes a fault")

    def is_stale(self, missed: int, age_ns: int) -> bool:
        """Whether so many missed readings, or such an age, are too much."""
        return missed >= self.stale_cycles or age_ns >= self.stale_s * 1e9

    def too_old(self, missed: int, age_ns: int) -> str:
        """What is wrong with a reading that is stale."""
        cycles = f"{missed} cycle{'s' if missed > 1 else ''}"
        limit = f"{self.stale_s * 1e3:g} ms or {self.stale_cycles} cycles"
        return f"no pressure for {age_ns * 1e-6:.0f} ms, {cycles} (stale at {limit})"


class PlatformBase(Strict):
    """What a driver must know about the hardware of one arm, whatever the family.

    Attributes
    ----------
    where_device : str
        Key under which the family's platform files name the hardware, for advice.
    start_advice : str
        What to look at when the devices cannot be started.
    where_supervisor : str
        Key under which they switch on the process that vents when the driver dies; empty without one.
    """

    where_device: ClassVar[str] = "transport.device"
    start_advice: ClassVar[str] = "see the lines above, and the device's manual"
    where_supervisor: ClassVar[str] = ""
    family: str
    valves: Annotated[tuple[ValveBase, ...], Field(strict=False, min_length=1, max_length=126)]
    range: PressureRange
    cycle_hz: float = Field(gt=0, le=2000, description="rate of exchanges")
    cycle_budget_s: float = Field(0.004, gt=0, le=0.1, description="longest wait for the answers of a cycle")
    lockstep_timeout_s: float = Field(
        5.0, gt=0, le=60, description="the same in lockstep, where nothing may be lost"
    )
    shutdown_ramp_pa_s: float = Field(
        400e3, gt=0, le=10e6, description="rate at which close() takes pressure out"
    )
    rating: Rating = Rating()
    emulation: EmulationBase = EmulationBase()

    @model_validator(mode="after")
    def _each_chamber_once(self) -> Self:
        chambers = self.chamber_names
        if len(set(chambers)) < len(chambers):
            raise ValueError(f"valves: each chamber once, not {repeated(chambers)} twice")
        return self

    @model_validator(mode="after")
    def _within_rating(self) -> Self:
        low, high = self.rating.minimum_pa, self.rating.maximum_pa
        if self.range.minimum_pa < low or self.range.maximum_pa >= high:
            raise ValueError(f"range: within the platform's rating, {low:g} to below {high:g} Pa")
        return self

    @property
    def chamber_names(self) -> tuple[str, ...]:
        """Names of the chambers, in the order of every array."""
        return tuple(valve.chamber for valve in self.valves)

    @property
    def device(self) -> str | None:
        """Path or address of the hardware, or None where it is given when opened."""
        return None

    @property
    def missing_device(self) -> str:
        """What the platform file lacks where `device` is None."""
        return "the platform file names none"

    @property
    def is_supervised(self) -> bool:
        """Whether a process beside the driver vents when the driver dies."""
        return False

    def at_rate(self, cycle_hz: float) -> Self:
        """Return the same platform with another rate of exchanges, checked again.

        Raises
        ------
        ConfigError
            If the platform's times do not allow that rate.
        """
        changed = {**self.model_dump(), "cycle_hz": float(cycle_hz)}
        return parse(changed, type(self), where=f"platform at {cycle_hz} Hz")


Platform: TypeAlias = PlatformBase


def parse_platform(data: Mapping[str, Any], where: str) -> PlatformBase:
    """Check a mapping against the model of its family.

    Raises
    ------
    ConfigError
        One line that names `where`, key, what was found and what is allowed.
    """
    found = data.get("family", "nothing")
    family = FAMILIES.get(found) if isinstance(found, str) else None
    if family is None:
        raise ConfigError(where, "family", found, f"one of {', '.join(FAMILIES)}")
    return parse(data, family.platform_model(), where)


def load_platform(name_or_path: str | Path) -> PlatformBase:
    """Read a platform file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a shipped file (``emulated_canopen``) or a path that ends in .yaml.

    Raises
    ------
    ConfigError
        One line that names file, key, what was found and what is allowed.
    """
    path = find_config(name_or_path, "platforms")
    return parse_platform(read_yaml(path), where=str(path))


def open_regulator(
    platform: PlatformBase,
    endpoint: str | None = None,
    clock: Callable[[], float] = time.monotonic,
    lockstep: bool = False,
) -> Regulator:
    """Make the driver that a platform asks for; nothing is opened before `Regulator.configure`.

    Parameters
    ----------
    platform : PlatformBase
        Description of the hardware.
    endpoint : str, optional
        What takes the place of the platform's device, for example the pseudo-terminal of an emulator.
    clock : callable
        Monotonic wall clock [s] for the time limits of blocking steps.
    lockstep : bool
        The devices' time advances with the exchanges only: one waits for its answers however long they take
        (up to `lockstep_timeout_s`), and nothing is paced by the wall clock.
    """
    return FAMILIES[platform.family].open(platform, endpoint, clock, lockstep)


def watched(
    platform: PlatformBase, regulator: Regulator, limits: Limits, rate_hz: float, where: str
) -> tuple[Limits, RegulatorModel]:
    """Limits of a loop on this platform, and the response that its monitors expect of the valves.

    Regulators that are slower than the loop are served in turn: their readings may be older, and a set point
    waits for its turn, so that the valves answer an update later.

    Parameters
    ----------
    limits : Limits
        As asked for.
    rate_hz : float
        Rate of the loop.
    where : str
        What the platform is called in errors.

    Raises
    ------
    ConfigError
        If the devices are too slow to be watched.
    """
    update_hz, response = regulator.update_hz, platform.emulation.regulator
    if update_hz < IN_TURN * rate_hz:
        response = response.model_copy(update={"delay_s": response.delay_s + 1.0 / update_hz})
    return for_regulators(limits, update_hz, regulator.reading_age_s, where), response


def repeated(values: Sequence[Value]) -> Value:
    """First value that stands more than once."""
    return next(value for value in values if values.count(value) > 1)
