"""Platform files: regulators, chambers, bus and emulation; the keys that all families have in common.

The keys of each family are in its folder; the list of families is in `families`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Annotated, Any, ClassVar, Protocol, Self, TypeVar

from pydantic import Field, field_validator, model_validator

from soro_core.config import Strict, parse, with_changes, with_renamed
from soro_core.pneumatics.regulator import RegulatorModel
from soro_core.safety import Limits, Rating, for_regulators, parts_of
from soro_hardware.port import Regulator
from soro_hardware.transport.tcp import TcpTransport

_CHAMBER = re.compile(r"([a-z][a-z0-9_]*/)?link\d+/chamber\d+")

Value = TypeVar("Value")

# Update rate over loop rate below which chambers are served in turn, not in every cycle.
IN_TURN = 0.9


class ValveBase(Strict):
    """One regulator with its chamber; each family adds the address on its bus."""

    chamber: str = Field(
        description="name of the chamber, link0/chamber0; where the valves feed several arms, "
        "left/link0/chamber0"
    )

    @field_validator("chamber")
    @classmethod
    def _named(cls, value: str) -> str:
        if not _CHAMBER.fullmatch(value):
            raise ValueError("a name of the form link0/chamber0, or left/link0/chamber0 with that of an arm")
        return value


class PressureRange(Strict):
    """Range of set points of driver and devices; it contains 0, so that the devices can vent."""

    minimum_pa: float = Field(0.0, ge=-101e3, le=0, description="lowest set point [Pa gauge]")
    maximum_pa: float = Field(gt=0, le=2e6, description="highest set point [Pa gauge]")


class EmulationBase(Strict):
    """Behaviour of emulated devices, beside that of regulators, that all families have in common."""

    step_s: float = Field(0.0025, ge=0.0005, le=0.05, description="step of the air in real time")
    wake_pa: float | None = Field(
        None,
        ge=-101e3,
        le=2e6,
        description="set point [Pa gauge] of the devices at power-on; none: 0, or the default of their chips",
    )


class ReadingAge(Protocol):
    """Limits of the age of a reading."""

    def is_stale(self, missed: int, age_ns: int) -> bool:
        """Whether so many missed readings, or such an age, are too much."""

    def too_old(self, missed: int, age_ns: int) -> str:
        """Return the fault of a stale reading as text."""


class Freshness(Strict):
    """Limits of the age of a reading, in missed cycles and in time."""

    stale_cycles: int = Field(3, ge=1, le=100, description="missed readings in a row that make a fault")
    stale_s: float = Field(0.05, gt=0, le=0.5, description="age of a reading that makes a fault")

    def is_stale(self, missed: int, age_ns: int) -> bool:
        """Whether so many missed readings, or such an age, are too much."""
        return missed >= self.stale_cycles or age_ns >= self.stale_s * 1e9

    def too_old(self, missed: int, age_ns: int) -> str:
        """Return the fault of a stale reading as text."""
        cycles = f"{missed} cycle{'s' if missed > 1 else ''}"
        limit = f"stale_s, {self.stale_s * 1e3:g} ms, or stale_cycles, {self.stale_cycles}"
        return f"no pressure for {age_ns * 1e-6:.0f} ms, {cycles} (limits of the platform: {limit})"


class PlatformBase(Strict):
    """Hardware of one arm, or of several that share it, for all families.

    Attributes
    ----------
    where_device : str
        Key of the device in the family's platform files, for advice.
    start_advice : str
        Advice after a failed start-up.
    where_supervisor : str
        Key that enables the supervisor, the process that vents when the driver dies; empty without one.
    """

    where_device: ClassVar[str] = "transport.device"
    start_advice: ClassVar[str] = "see the lines above, and the device's manual"
    where_supervisor: ClassVar[str] = ""
    family: str = Field(description="the kind of hardware, which decides the other keys")
    valves: Annotated[tuple[ValveBase, ...], Field(strict=False, min_length=1, max_length=126)] = Field(
        description="one a chamber, in the order of the chambers"
    )
    range: PressureRange = Field(description="pressures that the valves regulate")
    cycle_hz: float = Field(gt=0, le=2000, description="rate of exchanges")
    cycle_budget_s: float = Field(0.004, gt=0, le=0.1, description="longest wait for the answers of a cycle")
    lockstep_timeout_s: float = Field(
        5.0, gt=0, le=60, description="longest wait for the answers of a cycle in lockstep"
    )
    shutdown_ramp_pa_s: float = Field(
        400e3, gt=0, le=10e6, description="rate at which the driver lowers the pressures at its end"
    )
    stop_topic: str = Field(
        "",
        pattern=r"^(/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*)?$",
        description="topic of the emergency stop, std_msgs/msg/Bool, true while it is pressed; empty: none",
    )
    stop_timeout_s: float = Field(
        0.5, ge=0.05, le=2, description="silence of that topic that counts as pressed"
    )
    watchdog_test: bool = Field(
        True,
        description="at the first start, at 0 Pa, fall silent once and require that the devices, or the "
        "supervisor beside the driver, vent: 0.1 to 1 s; not in lockstep. Leave it out for devices that need "
        "a hand after their watchdog has vented",
    )
    rating: Rating = Field(Rating(), description="what the arm and the valves withstand")
    regulator: RegulatorModel = Field(RegulatorModel(), description="model of the valves' regulators")
    emulation: EmulationBase = Field(EmulationBase(), description="what emulated devices differ in")

    @model_validator(mode="before")
    @classmethod
    def _renamed(cls, data: Any) -> Any:
        return with_renamed(data, {"emulation.regulator": "regulator"})

    @model_validator(mode="after")
    def _each_chamber_once(self) -> Self:
        require_once("valves: each chamber", self.chamber_names)
        if len({name.count("/") for name in self.chamber_names}) > 1:
            raise ValueError("valves: the name of an arm in front of each chamber, or of none")
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
    def arms(self) -> tuple[str, ...]:
        """Names of the arms that share the valves; empty where they feed one, which has no name here."""
        return tuple(filter(None, parts_of(self.chamber_names)))

    @property
    def update_hz(self) -> float:
        """Rate [Hz] of the set points and readings of one chamber, according to the platform file."""
        return self.cycle_hz

    def response_at(self, rate_hz: float) -> RegulatorModel:
        """Return the response of the regulators in a loop of a rate [Hz]."""
        return in_loop(self.regulator, self.at_rate(rate_hz).update_hz, rate_hz)

    @property
    def device(self) -> str | None:
        """Path or address of the hardware, or None if the platform file states none."""
        return None

    @property
    def missing_device(self) -> str:
        """Message if `device` is None."""
        return "the platform file names none"

    @property
    def reads_stop(self) -> bool:
        """Whether a pressed emergency stop vents by the valves too."""
        return bool(self.stop_topic)

    @property
    def is_supervised(self) -> bool:
        """Whether a supervisor process vents when the driver dies."""
        return False

    def at_rate(self, cycle_hz: float) -> Self:
        """Return the same platform with another rate of cycles [Hz], validated again.

        Raises
        ------
        ConfigError
            If the times of the platform do not allow the rate.
        """
        values = {**dict(self), "cycle_hz": float(cycle_hz)}
        return parse(values, type(self), where=f"platform at {cycle_hz} Hz")


class TcpPlatform(PlatformBase):
    """Devices behind one TCP connection."""

    where_device: ClassVar[str] = "transport.host"
    transport: TcpTransport

    @property
    def device(self) -> str | None:
        return self.transport.address


def in_loop(response: RegulatorModel, update_hz: float, rate_hz: float) -> RegulatorModel:
    """Return the response of regulators in a loop; regulators served in turn respond one update later.

    Parameters
    ----------
    response : RegulatorModel
    update_hz, rate_hz : float
        Rate of the updates of one chamber, and of the loop [Hz].
    """
    if update_hz >= IN_TURN * rate_hz:
        return response
    return with_changes(response, delay_s=response.delay_s + 1.0 / update_hz)


def watched(
    platform: PlatformBase, regulator: Regulator, limits: Limits, rate_hz: float, where: str
) -> tuple[Limits, RegulatorModel]:
    """Return the limits of a loop on a platform, and the response of the valves for its monitors.

    Regulators that are slower than the loop are served in turn: their readings may be older, and the valves
    respond later.

    Parameters
    ----------
    platform : PlatformBase
    regulator : Regulator
        Configured regulator.
    limits : Limits
        Limits before the change for slow devices.
    rate_hz : float
        Rate of the loop [Hz].
    where : str
        Name of the platform in errors.

    Returns
    -------
    limits : Limits
    response : RegulatorModel

    Raises
    ------
    ConfigError
        If the devices are too slow for the monitors.
    """
    update_hz = regulator.update_hz
    response = in_loop(platform.regulator, update_hz, rate_hz)
    return for_regulators(limits, update_hz, regulator.reading_age_s, where), response


def require_once(what: str, values: Sequence[Value], shown: Callable[[Value], object] = str) -> None:
    """Raise an error if a value of a platform file occurs more than once.

    Parameters
    ----------
    what : str
        Begin of the message: key and kind of the values.
    values : sequence
        Values to check.
    shown : callable
        Returns a value as text.

    Raises
    ------
    ValueError
        If a value occurs more than once.
    """
    for value in values:
        if values.count(value) > 1:
            raise ValueError(f"{what} once, not {shown(value)} twice")
