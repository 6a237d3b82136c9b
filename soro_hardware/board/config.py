"""Platform files of the family soro_board: analog regulators behind DACs and ADCs, served by `soro board`.

Host and board use the same file, so that both agree on ports, scales and range.
"""

from __future__ import annotations

from bisect import bisect_right
from functools import cached_property
from ipaddress import ip_address, ip_network
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from soro_core.config import Strict
from soro_hardware.board.chips import CODES, FULL_SCALES_V, RATES_SPS
from soro_hardware.platform import EmulationBase, Freshness, TcpPlatform, ValveBase, require_once

Point = Annotated[tuple[float, float], Field(strict=False)]
Table = Annotated[tuple[Point, ...], Field(strict=False, min_length=2, max_length=64)]


class Scale(Strict):
    """Scale of one kind of regulator: tables of voltage and pressure, with linear interpolation."""

    output: Table = Field(description="set point: [volts, Pa gauge] ..., volts and pressure strictly rising")
    input: Table = Field(description="reading: [volts, Pa gauge] ..., volts and pressure strictly rising")

    @field_validator("output", "input")
    @classmethod
    def _monotone(cls, table: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for (v0, p0), (v1, p1) in pairwise(table):
            if not (v1 > v0 and p1 > p0):
                raise ValueError("volts and pressures that rise from point to point")
        if table[0][0] < 0.0 or table[-1][0] > 10.0:
            raise ValueError("volts from 0 to 10")
        return table

    @field_validator("output")
    @classmethod
    def _can_vent(cls, table: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if not table[0][1] <= 0.0 < table[-1][1]:
            raise ValueError("a table that 0 Pa lies in, so that the port can vent")
        return table

    def to_volts(self, pressure_pa: float) -> float:
        """Return the voltage [V] of a set point [Pa gauge], clipped to the table."""
        limited = min(max(pressure_pa, self.output[0][1]), self.output[-1][1])
        return interpolate(self._volts_of_output, limited)

    def asked_pa(self, volts: float) -> float:
        """Return the set point [Pa gauge] of a voltage [V]."""
        return interpolate(self.output, volts)

    def read_pa(self, volts: float) -> float:
        """Return the pressure [Pa gauge] of a sensor voltage [V], extrapolated beyond the table."""
        return interpolate(self.input, volts)

    def sensor_volts(self, pressure_pa: float) -> float:
        """Return the sensor voltage [V] of a pressure [Pa gauge], for emulated boards."""
        return interpolate(self._volts_of_input, pressure_pa)

    @cached_property
    def _volts_of_output(self) -> list[tuple[float, float]]:
        return [(p, v) for v, p in self.output]

    @cached_property
    def _volts_of_input(self) -> list[tuple[float, float]]:
        return [(p, v) for v, p in self.input]


def interpolate(table: list[tuple[float, float]] | tuple[tuple[float, float], ...], x: float) -> float:
    """Return the value of a piecewise linear function, extrapolated beyond its ends."""
    i = min(max(bisect_right(table, x, key=lambda point: point[0]), 1), len(table) - 1)
    (x0, y0), (x1, y1) = table[i - 1], table[i]
    return y0 + (y1 - y0) * (x - x0) / (x1 - x0)


# Upper bound of the board's watchdog for every configuration, as for commands in `soro_core.safety`.
LONGEST_WATCHDOG_S = 0.5


class BoardValve(ValveBase):
    """One regulator with its chamber and its port on the board."""

    port: int = Field(ge=0, description="number in the list `ports`, from 0")


class BoardPort(Strict):
    """Addresses of one DAC and its ADC, and the scale of their voltages."""

    bus: int = Field(ge=0, le=99, description="number of the I2C bus, as in /dev/i2c-1")
    dac: int = Field(ge=0x60, le=0x67, description="address of the MCP4725")
    adc: int = Field(ge=0x48, le=0x4B, description="address of the ADS1013, ADS1014 or ADS1015")
    scale: str = Field(description="name of the scale of the regulator at this port")


class StopContact(Strict):
    """The contact of the emergency stop between a GPIO and ground: closed at rest, open when pressed."""

    chip: str = Field("/dev/gpiochip0", description="GPIO chip, as `gpiodetect` lists them")
    line: int = Field(ge=0, le=511, description="number of the line, on a Raspberry Pi that of the GPIO")
    debounce_s: float = Field(
        0.01, ge=0, le=0.05, description="time for which the contact must read open, or closed, to count"
    )


class BoardOptions(Strict):
    """Converters and times of the board."""

    watchdog_s: float = Field(
        0.1, ge=0.01, le=LONGEST_WATCHDOG_S, description="silence of the host after which the board vents"
    )
    hang_s: float = Field(
        0.2,
        ge=0.05,
        le=1,
        description="silence of the server's loop after which a second process vents",
    )
    heartbeat_s: float = Field(0.025, ge=0.005, le=0.05, description="longest silence of the board")
    refresh_hz: float = Field(
        250.0, ge=20, le=1000, description="rate of DACs and ADCs while no set points arrive"
    )
    tolerated_errors: int = Field(
        3, ge=1, le=10, description="number of cycles in a row that a chip may miss before the board vents"
    )
    dac_full_scale_v: float = Field(10.0, gt=0, le=20, description="voltage at the valve at code 4096")
    adc_full_scale_v: float = Field(2.048, description="range of the ADC's amplifier")
    adc_divider: float = Field(
        5.0, ge=1, le=20, description="ratio of the voltage of the sensor to the voltage at the ADC"
    )
    adc_rate_sps: int = Field(490, description="conversions a second")
    hosts: tuple[str, ...] = Field(
        (), strict=False, description="addresses and networks whose hosts may connect; empty: every host"
    )

    stop: StopContact | None = Field(
        None, description="contact of the emergency stop, at which the board vents; none: not wired"
    )

    def admits(self, address: str) -> bool:
        """Return whether a host at an IP address may connect."""
        return not self.hosts or any(ip_address(address) in ip_network(host) for host in self.hosts)

    @field_validator("hosts")
    @classmethod
    def _networks(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for host in value:
            try:
                ip_network(host)
            except ValueError:
                raise ValueError("addresses as 192.168.4.3, or networks as 192.168.4.0/24") from None
        return value

    @field_validator("adc_full_scale_v")
    @classmethod
    def _known_scale(cls, value: float) -> float:
        if value not in FULL_SCALES_V:
            raise ValueError(f"one of {', '.join(map(str, FULL_SCALES_V))} V")
        return value

    @field_validator("adc_rate_sps")
    @classmethod
    def _known_rate(cls, value: int) -> int:
        if value not in RATES_SPS:
            raise ValueError(f"one of {', '.join(map(str, RATES_SPS))} a second")
        return value


class HostOptions(Freshness):
    """Times of the driver."""

    heartbeat_consumer_s: float = Field(
        0.1, ge=0.01, le=5, description="silence after which the board is lost"
    )
    start_timeout_s: float = Field(2.0, gt=0, le=30, description="longest wait for an answer at start-up")


class BoardPlatform(TcpPlatform):
    """Analog regulators behind one board."""

    start_advice: ClassVar[str] = "see the lines above; `soro board CONFIG --check` on the Pi"

    family: Literal["soro_board"]
    valves: Annotated[tuple[BoardValve, ...], Field(strict=False, min_length=1, max_length=126)]
    ports: Annotated[tuple[BoardPort, ...], Field(strict=False, min_length=1, max_length=64)]
    scales: dict[str, Scale]
    board: BoardOptions = BoardOptions()
    host: HostOptions = HostOptions()
    emulation: EmulationBase = EmulationBase()

    @property
    def reads_stop(self) -> bool:
        return super().reads_stop or self.board.stop is not None

    def scale_of(self, port: int) -> Scale:
        """Return the scale of the regulator at a port."""
        return self.scales[self.ports[port].scale]

    def resolution_pa(self, port: int) -> float:
        """Return the largest change of a set point [Pa] by one count of the DAC at a port."""
        table = self.scale_of(port).output
        slope = max((p1 - p0) / (v1 - v0) for (v0, p0), (v1, p1) in pairwise(table))
        return slope * self.board.dac_full_scale_v / CODES

    @model_validator(mode="after")
    def _consistent(self) -> BoardPlatform:
        numbers = [valve.port for valve in self.valves]
        require_once("valves: each port", numbers)
        if max(numbers) >= len(self.ports):
            raise ValueError(f"valves: ports 0 to {len(self.ports) - 1}, not {max(numbers)}")
        chips = [(port.bus, chip) for port in self.ports for chip in (port.dac, port.adc)]
        require_once("ports: each chip", chips, lambda chip: f"0x{chip[1]:02X} on bus {chip[0]}")
        for number, port in enumerate(self.ports):
            if port.scale not in self.scales:
                known = ", ".join(self.scales) or "none"
                raise ValueError(f"ports[{number}].scale: one of the scales ({known}), not {port.scale}")
            table = self.scale_of(number).output
            if table[0][1] > self.range.minimum_pa or table[-1][1] < self.range.maximum_pa:
                raise ValueError(f"range: within the output of scale {port.scale}")
            if table[-1][0] > self.board.dac_full_scale_v:
                raise ValueError(f"scales.{port.scale}.output: at most board.dac_full_scale_v")
            full_scale_v = self.board.adc_full_scale_v * self.board.adc_divider
            if self.scale_of(number).input[-1][0] > full_scale_v:
                raise ValueError(f"scales.{port.scale}.input: at most {full_scale_v:g} V, the ADC's range")
        if self.board.adc_rate_sps < 1.5 * self.cycle_hz:
            raise ValueError("board.adc_rate_sps: at least 1.5 times cycle_hz")
        if self.board.watchdog_s < 3 / self.cycle_hz:
            raise ValueError(f"board.watchdog_s: at least three cycles, {3 / self.cycle_hz:.4g} s")
        if self.host.heartbeat_consumer_s < 2 * self.board.heartbeat_s:
            raise ValueError("host.heartbeat_consumer_s: at least twice board.heartbeat_s")
        return self
