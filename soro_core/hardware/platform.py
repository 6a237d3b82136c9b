"""Platform files: which regulators feed which chambers, over which bus, and how they are emulated."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from soro_core.config import Strict, find_config, load, parse
from soro_core.hardware.port import Regulator
from soro_core.pneumatics.regulator import RegulatorModel

# Bit rates of the LAWICEL command S. 800k (S7) is left out: libraries disagree on it (750k in python-can).
BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 1_000_000)

_CHAMBER = re.compile(r"link\d+/chamber\d+")


class SlcanTransport(Strict):
    """A CAN adapter that speaks LAWICEL ASCII (slcan) on a serial port or a pseudo-terminal."""

    kind: Literal["slcan"]
    device: str | None = Field(
        None, description="path of the serial port; none where it is given when opened"
    )
    bitrate: int = Field(1_000_000, description="CAN bit rate [bit/s]")
    serial_baud: int = Field(1_000_000, ge=9600, le=12_000_000, description="baud rate of the serial port")
    open_timeout_s: float = Field(
        1.0, gt=0, le=10, description="time in which the adapter must answer a command"
    )

    @field_validator("bitrate")
    @classmethod
    def _known_bitrate(cls, value: int) -> int:
        if value not in BITRATES:
            raise ValueError(f"one of {', '.join(map(str, BITRATES))} bit/s")
        return value


class Valve(Strict):
    """One regulator: the chamber that it feeds and its node on the bus."""

    chamber: str = Field(description="name of the chamber, for example link0/chamber0")
    node: int = Field(ge=1, le=127, description="CANopen node id")

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


class CanopenOptions(Strict):
    """Times and identities of CANopen; the defaults suit control rates of 50 Hz and more."""

    master_node: int = Field(
        127, ge=1, le=127, description="node id under which the driver sends its heartbeat"
    )
    heartbeat_s: float = Field(0.025, ge=0.005, le=1, description="heartbeat period, both ways")
    heartbeat_consumer_s: float = Field(
        0.1, ge=0.01, le=5, description="silence after which the other side is lost"
    )
    rpdo_deadline_s: float = Field(0.05, ge=0.005, le=5, description="longest time between two set points")
    boot_timeout_s: float = Field(5.0, gt=0, le=60, description="time for a device to boot")
    sdo_timeout_s: float = Field(0.25, gt=0, le=5, description="time for one SDO answer")
    sdo_retries: int = Field(2, ge=0, le=10, description="further attempts after an SDO timeout")
    activation_timeout_s: float = Field(
        0.5, gt=0, le=5, description="time from first set point to state ACTIVE"
    )
    stale_cycles: int = Field(3, ge=1, le=100, description="missed readings in a row that make a fault")
    stale_s: float = Field(0.05, gt=0, le=0.5, description="age of a reading that makes a fault")
    vendor_id: int | None = Field(
        None, ge=0, le=0xFFFFFFFF, description="required vendor (1018:1); none for any"
    )
    product_code: int | None = Field(None, ge=0, le=0xFFFFFFFF, description="required product (1018:2)")
    full_scale_pa: float | None = Field(
        None,
        gt=0,
        le=2e6,
        description="pressure at 16384 counts [Pa]; only for devices with normalised values",
    )


class Emulation(Strict):
    """How the emulated devices of this platform behave."""

    regulator: RegulatorModel = RegulatorModel()
    boot_delay_s: float = Field(0.1, ge=0, le=10, description="time from power-on to boot-up; 0 in lockstep")
    pressure_unit: Literal["pa", "bar", "normalised"] = Field(
        "pa", description="unit of the device's pressures"
    )
    pressure_prefix: int = Field(1, ge=-6, le=6, description="power of ten of the device's pressures")
    full_scale_pa: float = Field(
        100e3, gt=0, le=2e6, description="pressure at 16384 counts, for normalised [Pa]"
    )
    step_s: float = Field(
        0.0025, ge=0.0005, le=0.05, description="step of the air between two SYNC, in real time"
    )


class Platform(Strict):
    """Everything that a driver must know about the hardware of one arm."""

    family: Literal["canopen_408"]
    transport: SlcanTransport
    valves: Annotated[tuple[Valve, ...], Field(strict=False, min_length=1, max_length=126)]
    range: PressureRange
    cycle_hz: float = Field(
        gt=0, le=2000, description="rate of exchanges; written to the devices as SYNC period"
    )
    cycle_budget_s: float = Field(0.004, gt=0, le=0.1, description="longest wait for the answers of a cycle")
    lockstep_timeout_s: float = Field(
        5.0, gt=0, le=60, description="the same in lockstep, where nothing may be lost"
    )
    shutdown_ramp_pa_s: float = Field(
        400e3, gt=0, le=10e6, description="rate at which close() takes pressure out"
    )
    canopen: CanopenOptions = CanopenOptions()
    emulation: Emulation = Emulation()

    @model_validator(mode="after")
    def _consistent(self) -> Platform:
        chambers = [valve.chamber for valve in self.valves]
        nodes = [valve.node for valve in self.valves]
        if len(set(chambers)) < len(chambers):
            raise ValueError(f"valves: each chamber once, not {_repeated(chambers)} twice")
        if len(set(nodes)) < len(nodes):
            raise ValueError(f"valves: each node once, not {_repeated(nodes)} twice")
        times, period = self.canopen, 1.0 / self.cycle_hz
        if times.master_node in nodes:
            raise ValueError(f"canopen.master_node: a node id that no valve has, not {times.master_node}")
        if times.rpdo_deadline_s < 2 * period:
            raise ValueError(f"canopen.rpdo_deadline_s: at least two cycles, {2 * period:.4g} s")
        if times.heartbeat_consumer_s < 2 * max(times.heartbeat_s, period):
            raise ValueError("canopen.heartbeat_consumer_s: at least twice the heartbeat and twice the cycle")
        return self

    @property
    def chamber_names(self) -> tuple[str, ...]:
        """Names of the chambers, in the order of every array."""
        return tuple(valve.chamber for valve in self.valves)

    def at_rate(self, cycle_hz: float) -> Platform:
        """Return the same platform with another rate of exchanges, checked again.

        Raises
        ------
        ConfigError
            If the platform's times do not allow that rate.
        """
        return parse(
            {**self.model_dump(), "cycle_hz": float(cycle_hz)}, Platform, where=f"platform at {cycle_hz} Hz"
        )


def load_platform(name_or_path: str | Path) -> Platform:
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
    return load(find_config(name_or_path, "platforms"), Platform)


def open_regulator(
    platform: Platform,
    endpoint: str | None = None,
    clock: Callable[[], float] = time.monotonic,
    lockstep: bool = False,
) -> Regulator:
    """Make the driver that a platform asks for; nothing is opened before `Regulator.configure`.

    Parameters
    ----------
    platform : Platform
        Description of the hardware.
    endpoint : str, optional
        Path that takes the place of the transport's device, for example the pseudo-terminal of an emulator.
    clock : callable
        Monotonic wall clock [s] for the time limits of blocking steps.
    lockstep : bool
        The devices' time advances by SYNC only: an exchange waits for its answers however long they take (up
        to `lockstep_timeout_s`), and nothing is paced by the wall clock.
    """
    # Imported here because the emulator reads platforms too and must start without a CAN stack.
    from soro_core.hardware.canopen.driver import CanopenRegulator
    from soro_core.hardware.transport.slcan import SlcanBus

    transport = platform.transport
    return CanopenRegulator(
        platform, lambda: SlcanBus.from_transport(transport, endpoint), clock=clock, lockstep=lockstep
    )


def _repeated(values: list[str] | list[int]) -> str | int:
    return next(value for value in values if values.count(value) > 1)  # type: ignore[arg-type]
