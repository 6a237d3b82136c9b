"""The ports of a board: conversion of set points and readings, and a test of every chip."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

from soro_core.errors import HardwareError
from soro_hardware.board import chips
from soro_hardware.board.config import BoardPlatform
from soro_hardware.board.messages import PortFlag

_HIGHEST_CODE = chips.CODES - 1
_RAIL = 2047  # counts of the ADC at the end of its range


@dataclass(frozen=True)
class PortReading:
    """Result of a cycle at one port [Pa gauge]; `pressure_pa` is None without an answer of the ADC."""

    applied_pa: float
    pressure_pa: float | None
    flags: PortFlag


@dataclass(frozen=True)
class PortReport:
    """Self-test of one port; `error` is empty after success, and the port works with a `warning`."""

    port: int
    pressure_pa: float | None
    error: str
    warning: str = ""


class ConverterPair:
    """One DAC and one ADC.

    Parameters
    ----------
    platform : BoardPlatform
        Ports, scales and converters.
    number : int
        Number of the port.
    bus : I2cBus
        Bus of its chips.
    """

    def __init__(self, platform: BoardPlatform, number: int, bus: chips.I2cBus) -> None:
        wiring, options = platform.ports[number], platform.board
        self.number, self.wiring, self.bus = number, wiring, bus
        self._scale = platform.scale_of(number)
        self._volts_per_code = options.dac_full_scale_v / chips.CODES
        self._volts_per_count = options.adc_full_scale_v / 2048 * options.adc_divider
        self._config = chips.adc_config(options.adc_rate_sps, options.adc_full_scale_v)
        # The ends of the range, rounded to codes of the DAC.
        self._lowest_pa = self.applied_pa(self._nearest(platform.range.minimum_pa))
        self._highest_pa = self.applied_pa(self._nearest(platform.range.maximum_pa))
        self.safe_code = self._nearest(0.0)
        self._written: int | None = None

    def code(self, setpoint_pa: float) -> int:
        """Return the DAC code of a set point [Pa gauge], clipped to the range; NaN gives 0 Pa."""
        if setpoint_pa != setpoint_pa:
            return self.safe_code
        return self._nearest(min(max(setpoint_pa, self._lowest_pa), self._highest_pa))

    def applied_pa(self, code: int) -> float:
        """Return the set point [Pa gauge] of a DAC code."""
        return self._scale.asked_pa(code * self._volts_per_code)

    def exchange(self, setpoint_pa: float) -> PortReading:
        """Write the DAC and read the ADC."""
        flags, code, pressure = PortFlag.NONE, self.code(setpoint_pa), None
        if self._works(lambda: chips.write_dac(self.bus, self.wiring.dac, code)):
            self._written = code
        else:
            flags |= PortFlag.DAC_ERROR
        counts = 0

        def read() -> None:
            nonlocal counts
            counts = chips.read_adc(self.bus, self.wiring.adc)

        if self._works(read):
            pressure = self._scale.read_pa(counts * self._volts_per_count)
            if abs(counts) >= _RAIL:
                flags |= PortFlag.OUT_OF_RANGE
        else:
            flags |= PortFlag.ADC_ERROR
        return PortReading(self.applied_pa(code), pressure, flags)

    def vent(self) -> bool:
        """Write 0 Pa; return whether the DAC answered. The next cycle reports a DAC without an answer."""
        try:
            chips.write_dac(self.bus, self.wiring.dac, self.safe_code)
        except OSError:
            return False
        self._written = self.safe_code
        return True

    def lost_its_setting(self) -> bool:
        """Return whether a chip has lost its last code or configuration, by a loss of power."""
        try:
            dac = chips.read_dac(self.bus, self.wiring.dac)
            config = chips.read_adc_config(self.bus, self.wiring.adc)
        except OSError:
            return False  # `exchange` reports it
        return dac.code != self._written or not chips.same_config(config, self._config)

    def start(self) -> str:
        """Write and read back the DAC near 0 Pa, and start the ADC; return the error, empty for none."""
        dac, adc = self.wiring.dac, self.wiring.adc
        beside = self.safe_code + (1 if self.safe_code < _HIGHEST_CODE else -1)
        try:
            for code in (beside, self.safe_code):
                chips.write_dac(self.bus, dac, code)
                found = chips.read_dac(self.bus, dac)
                if found.code != code or not found.on or not found.ready:
                    return f"DAC 0x{dac:02X}: wrote {code}, read {found}"
                self._written = code
        except OSError as error:
            return f"DAC 0x{dac:02X}: {error.strerror}"
        try:
            chips.start_adc(self.bus, adc, self._config)
            config = chips.read_adc_config(self.bus, adc)
        except OSError as error:
            return f"ADC 0x{adc:02X}: {error.strerror}"
        if not chips.same_config(config, self._config):
            return f"ADC 0x{adc:02X}: wrote 0x{self._config:04X}, read 0x{config:04X}"
        return ""

    def report(self, error: str) -> PortReport:
        """Read the first conversion of the ADC, and the power-on code of the DAC."""
        if error:
            return PortReport(self.number, None, error)
        try:
            counts = chips.read_adc(self.bus, self.wiring.adc)
            stored = chips.read_dac(self.bus, self.wiring.dac).stored_code
        except OSError as found:
            return PortReport(self.number, None, f"read back: {found.strerror}")
        pressure = self._scale.read_pa(counts * self._volts_per_count)
        if abs(counts) >= _RAIL:
            return PortReport(self.number, pressure, f"ADC 0x{self.wiring.adc:02X}: at the end of its range")
        warning = "" if stored == self.safe_code else self._power_up_warning(stored)
        return PortReport(self.number, pressure, "", warning)

    def _power_up_warning(self, stored: int) -> str:
        pressure = self.applied_pa(stored)
        return f"the DAC asks for {pressure / 1e3:.1f} kPa after power-up; `soro board --store-safe` mends it"

    def _nearest(self, pressure_pa: float) -> int:
        return min(max(round(self._scale.to_volts(pressure_pa) / self._volts_per_code), 0), _HIGHEST_CODE)

    def _works(self, transfer: Callable[[], None]) -> bool:
        """Try a transfer at most twice; return whether it succeeded."""
        for attempt in range(2):
            try:
                transfer()
            except OSError as error:
                # A blocked bus takes the whole timeout at each try: the other ports cannot wait for it.
                if attempt or error.errno == errno.ETIMEDOUT:
                    return False
            else:
                return True
        return False


class Ports:
    """All ports of a board, grouped by bus.

    Parameters
    ----------
    platform : BoardPlatform
        Ports, scales and converters.
    open_bus : callable
        Opens an I2C bus by its number.
    wait : callable
        Waits for a time [s].
    executor : Executor, optional
        Serves the buses in parallel; without one they are served in sequence.

    Raises
    ------
    HardwareError
        If a bus cannot be opened.
    """

    def __init__(
        self,
        platform: BoardPlatform,
        open_bus: Callable[[int], chips.I2cBus],
        wait: Callable[[float], None],
        executor: Executor | None = None,
    ) -> None:
        self._wait, self._executor = wait, executor
        self._settle_s = 2.0 / platform.board.adc_rate_sps
        numbers = sorted({port.bus for port in platform.ports})
        self._buses = {number: open_bus(number) for number in numbers}
        self.ports = [ConverterPair(platform, n, self._buses[p.bus]) for n, p in enumerate(platform.ports)]
        self._groups = [[port for port in self.ports if port.wiring.bus == number] for number in numbers]
        self._checked = 0

    def __len__(self) -> int:
        return len(self.ports)

    def self_test(self) -> list[PortReport]:
        """Set every port to 0 Pa, write and read back every DAC, start and read every ADC."""
        errors = [port.start() for port in self.ports]
        self._wait(self._settle_s)
        return [port.report(error) for port, error in zip(self.ports, errors, strict=True)]

    def exchange(self, setpoint_pa: Sequence[float]) -> list[PortReading]:
        """Write every DAC, read every ADC, and check the settings of one port, in turn."""
        checked, self._checked = self._checked, (self._checked + 1) % len(self.ports)

        def serve(group: list[ConverterPair]) -> list[tuple[int, PortReading]]:
            found = []
            for port in group:
                lost = port.number == checked and port.lost_its_setting()
                reading = port.exchange(setpoint_pa[port.number])
                if lost:
                    reading = replace(reading, flags=reading.flags | PortFlag.CHIP_RESET)
                found.append((port.number, reading))
            return found

        groups = (
            map(serve, self._groups) if self._executor is None else self._executor.map(serve, self._groups)
        )
        return [reading for _, reading in sorted((item for group in groups for item in group), key=_number)]

    def store_safe(self) -> None:
        """Store 0 Pa as power-on value of every DAC that has another one.

        Raises
        ------
        HardwareError
            If a DAC does not store it.
        """
        for port in self.ports:
            try:
                if chips.read_dac(port.bus, port.wiring.dac).stored_code == port.safe_code:
                    continue
                chips.store_dac(port.bus, port.wiring.dac, port.safe_code)
                self._wait(0.06)
                stored = chips.read_dac(port.bus, port.wiring.dac).stored_code
            except OSError as error:
                raise HardwareError(f"DAC: {error.strerror}", f"port {port.number}", "silent") from None
            if stored != port.safe_code:
                text = f"DAC: stored {port.safe_code}, read {stored}"
                raise HardwareError(text, f"port {port.number}", "refused")

    def vent(self) -> tuple[int, ...]:
        """Set every port to 0 Pa; return the ports that do not answer."""
        return tuple(port.number for port in self.ports if not port.vent())

    def close(self) -> None:
        """Close the buses; the DACs keep their codes."""
        for bus in self._buses.values():
            with contextlib.suppress(OSError):
                bus.close()


def _number(item: tuple[int, PortReading]) -> int:
    return item[0]
