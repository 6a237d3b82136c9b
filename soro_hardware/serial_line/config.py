"""Platform files of the families itv_rs232 and alicat."""

from __future__ import annotations

import re
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from soro_core.config import Strict
from soro_hardware.platform import EmulationBase, PlatformBase, ValveBase, require_once
from soro_hardware.serial_line import pace

Baud = Literal[2400, 4800, 9600, 19200, 38400, 57600, 115200]


class LineOptions(Strict):
    """Times of a serial line; the defaults suit a cable or a USB adapter."""

    answer_timeout_s: float = Field(
        0.05, gt=0, le=2, description="longest time from the end of a request to the end of its answer"
    )
    quiet_s: float = Field(
        0.01, ge=0, le=1, description="silence after a lost or garbled answer before the next request"
    )
    silent_after: int = Field(3, ge=1, le=100, description="missed answers in a row that make a fault")
    stale_s: float = Field(0.5, gt=0, le=5, description="age of a reading that makes a fault")
    check_s: float = Field(
        0.2, gt=0, le=2, description="period of the check that a device still has its set point"
    )
    slew_pa_s: float = Field(
        400e3, gt=0, le=10e6, description="largest rate of the sent set point; a vent is not limited"
    )
    boot_timeout_s: float = Field(
        2.0, gt=0, le=60, description="longest time from power-on to the first answer of a device"
    )
    reconnect_s: float = Field(
        1.0, ge=0, le=60, description="time for which the start-up tries to open a missing port"
    )
    vent_s: float = Field(0.5, gt=0, le=5, description="longest time that a vent waits for its confirmation")
    supervisor: bool = Field(
        True, description="run a process beside the driver that vents when the driver dies"
    )

    @property
    def patience_s(self) -> float:
        """Time after which a device that answers nothing is silent."""
        return self.silent_after * (self.answer_timeout_s + self.quiet_s)

    def is_stale(self, missed: int, age_ns: int) -> bool:
        """Whether a reading of such an age is too old; devices that are served in turn miss many cycles."""
        return age_ns > self.stale_s * 1e9

    def too_old(self, missed: int, age_ns: int) -> str:
        """Return the fault of a stale reading as text."""
        limit = f"limit of the platform: stale_s, {self.stale_s * 1e3:g} ms"
        return f"no pressure for {age_ns * 1e-6:.0f} ms ({limit})"


class LineEmulation(EmulationBase):
    """How the emulated devices of a serial line behave."""

    boot_delay_s: float = Field(
        0.1, ge=0, le=10, description="silence after power-on; in lockstep after a restart only"
    )
    answer_delay_s: float = Field(0.001, ge=0, le=0.1, description="time from a request to its answer")


class AlicatEmulation(LineEmulation):
    """How emulated Alicat controllers behave."""

    firmware: str = Field(
        "10v20.0-R24", description="firmware version that the devices report, for example 5v12.0-R22"
    )
    unit: Literal["kPaG", "barG", "PSIG"] = Field("kPaG", description="unit of the pressures")
    full_scale_pa: float = Field(103.4e3, gt=0, le=2e6, description="range of the devices [Pa gauge]")


class SerialPlatform(PlatformBase):
    """Keys of both dialects. `cycle_hz` is the rate of exchanges, not of the devices' updates."""

    where_supervisor: ClassVar[str] = "line.supervisor"

    baud: Baud
    cycle_budget_s: float = Field(
        0.002, ge=0, le=0.1, description="longest wait of an exchange for bytes that are on their way"
    )
    line: LineOptions = LineOptions()

    @property
    def is_supervised(self) -> bool:
        return self.line.supervisor


class ItvValve(ValveBase):
    """One SMC ITV with its own port."""

    port: str | None = Field(
        None, description="path of the serial port; none: the user gives it with --device"
    )


class ItvPlatform(SerialPlatform):
    """SMC ITV electro-pneumatic regulators with RS-232C, one port each."""

    where_device: ClassVar[str] = "`port` of every valve"

    family: Literal["itv_rs232"]
    valves: Annotated[tuple[ItvValve, ...], Field(strict=False, min_length=1, max_length=32)]
    baud: Baud = 9600
    full_scale_pa: float = Field(
        gt=0,
        le=2e6,
        description="pressure at 1023 counts: 100e3 for ITVx01, 500e3 for ITVx03, 900e3 for ITVx05",
    )
    emulation: LineEmulation = LineEmulation()

    @property
    def update_hz(self) -> float:
        return pace.update_hz(self.baud, pace.ITV_BYTES)

    @property
    def device(self) -> str | None:
        ports = [valve.port for valve in self.valves if valve.port is not None]
        return ",".join(ports) if len(ports) == len(self.valves) else None

    @property
    def missing_device(self) -> str:
        without = [valve.chamber for valve in self.valves if valve.port is None]
        if len(without) == len(self.valves):
            return super().missing_device
        return f"the platform file names no port for {', '.join(without)}"

    @model_validator(mode="after")
    def _consistent(self) -> ItvPlatform:
        require_once("valves: each port", [valve.port for valve in self.valves if valve.port is not None])
        if self.range.maximum_pa > self.full_scale_pa:
            raise ValueError(f"range.maximum_pa: at most full_scale_pa, {self.full_scale_pa:g} Pa")
        if self.range.minimum_pa != 0.0:
            raise ValueError("range.minimum_pa: 0, the counts of an ITV begin there")
        return self


class AlicatValve(ValveBase):
    """One Alicat pressure controller on the line."""

    unit: str = Field(pattern=re.compile("^[A-Z]$"), description="letter of the device on the line, A to Z")


class AlicatPlatform(SerialPlatform):
    """Alicat pressure controllers, up to 26 on one port."""

    where_device: ClassVar[str] = "`port`"

    family: Literal["alicat"]
    port: str | None = Field(
        None, description="path of the serial port; none: the user gives it with --device"
    )
    valves: Annotated[tuple[AlicatValve, ...], Field(strict=False, min_length=1, max_length=26)]
    baud: Baud = 19200
    setpoint_command: Literal["by_firmware", "S"] = Field(
        "by_firmware",
        description="by_firmware: LS from firmware 9v00 on, S below; S: always S, which newer firmware also "
        "accepts. The answer to S contains the pressure, which doubles the rate of a chamber",
    )
    emulation: AlicatEmulation = AlicatEmulation()

    @property
    def update_hz(self) -> float:
        return self.served_hz(self.setpoint_command != "S")

    def served_hz(self, with_ls: bool) -> float:
        """Rate [Hz] at which a chamber is served; the command of the set point is known from the firmware."""
        one = pace.LS_BYTES if with_ls else pace.S_BYTES
        return pace.update_hz(self.baud, one * len(self.valves))

    @property
    def device(self) -> str | None:
        return self.port

    @model_validator(mode="after")
    def _consistent(self) -> AlicatPlatform:
        require_once("valves: each unit", [valve.unit for valve in self.valves])
        return self
