"""Emulated platforms on serial lines: the devices, their lines and the air."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

import numpy as np

from soro_core.hardware.emulation.air import Air
from soro_core.hardware.emulation.devices import EmulatedDevices
from soro_core.hardware.emulation.faults import Injection
from soro_core.hardware.emulation.uart import Uart
from soro_core.hardware.serial_line.config import AlicatPlatform, ItvPlatform, SerialPlatform
from soro_core.hardware.serial_line.emulated_alicat import AlicatBus, EmulatedAlicat
from soro_core.hardware.serial_line.emulated_itv import EmulatedItv
from soro_core.hardware.serial_line.lockstep import MARK, START_MARK

# Without power a device is silent and its valve closed; it comes back with set point 0.
OF_DEVICES = frozenset({"reboot", "mute", "brownout"})


class EmulatedValve(Protocol):
    """What every emulated device here has, whatever the dialect."""

    muted: bool

    def demand_pa(self) -> float | None:
        """What its valve does now."""

    def reboot(self, now_ns: int) -> None:
        """Lose power and come back."""

    def unpower(self, now_ns: int, is_off: bool) -> None:
        """Take the power away, or give it back."""

    def ignore_setpoints(self, is_on: bool) -> None:
        """Take set points and do not follow them."""


class SerialDevices(EmulatedDevices):
    """Devices on serial lines.

    In lockstep the host's mark on every line advances everything by one cycle; the lines are paced all the
    same, so that an answer takes as many cycles as it does in real time.

    Parameters
    ----------
    platform : SerialPlatform
        What is emulated.
    n_lines : int
        Number of lines.
    half_duplex : bool
        Whether a line is shared by both directions.
    lockstep : bool
        Whether the host's marks are the clock.
    """

    lines: tuple[Uart, ...]

    def __init__(self, platform: SerialPlatform, n_lines: int, half_duplex: bool, lockstep: bool) -> None:
        marks = MARK + START_MARK if lockstep else b""
        lines = tuple(
            Uart(platform.baud, half_duplex, now_ns=lambda: self.now_ns, marks=marks) for _ in range(n_lines)
        )
        super().__init__(lines, platform.emulation.step_s)
        self.valves: Sequence[EmulatedValve] = ()
        self._period_ns = round(1e9 / platform.cycle_hz)
        self._marks = [0] * n_lines
        for number, line in enumerate(lines):
            line.on_mark = self._marker(number)

    def connect(self, valves: Sequence[EmulatedValve], platform: SerialPlatform, seed: int) -> None:
        """Put the devices on their air."""
        self.valves = valves
        demands = [valve.demand_pa for valve in valves]
        self.air = Air(platform.emulation.regulator, demands, np.random.default_rng(seed))
        for line in self.lines:
            if line.station is not None:
                line.station.before = self.air.advance

    def connect_faults(self, chambers: tuple[str, ...], seed: int) -> None:
        super().connect_faults(chambers, seed)
        self.faults.supported |= OF_DEVICES
        for name in OF_DEVICES | {"setpoint_ignored"}:
            self.faults.on_start[name] = partial(self._fault, is_on=True)
            self.faults.on_end[name] = partial(self._fault, is_on=False)

    def _fault(self, injection: Injection, is_on: bool) -> None:
        valve = self.valves[self.faults.chambers.index(injection.chamber)]
        if injection.fault == "setpoint_ignored":
            valve.ignore_setpoints(is_on)
        elif injection.fault == "mute":
            valve.muted = is_on
        elif injection.fault == "brownout":
            valve.unpower(self.now_ns, is_on)
        elif is_on:
            valve.reboot(self.now_ns)

    def reading(self, number: int) -> Callable[[], float]:
        """Sensor of one valve."""
        return lambda: self.air.reading_pa(number)

    def due_ns(self) -> int | None:
        return min((due for line in self.lines if (due := line.due_ns()) is not None), default=None)

    def work(self, now_ns: int) -> None:
        while (due := self.due_ns()) is not None and due <= now_ns:
            for line in self.lines:
                if line.due_ns() == due:
                    line.step(due)
                    break

    def poll(self, now_ns: int) -> None:
        """Nothing: these devices have no watchdogs."""

    def _marker(self, number: int) -> Callable[[bytes], None]:
        def on_mark(mark: bytes) -> None:
            self._marks[number] += 1
            if all(self._marks):
                self._marks = [count - 1 for count in self._marks]
                end_ns = self.now_ns + self._period_ns
                self.work(end_ns)
                self.tick(end_ns, is_cycle=mark == MARK)
                for line in self.lines:
                    line.answer_mark(mark)

        return on_mark


def emulate_itv(platform: ItvPlatform, lockstep: bool, seed: int) -> SerialDevices:
    """Emulated ITVs, one a line."""
    devices = SerialDevices(platform, len(platform.valves), half_duplex=False, lockstep=lockstep)
    emulation = platform.emulation
    boot_ns = round(emulation.boot_delay_s * 1e9)
    up_ns = 0 if lockstep else boot_ns
    delay_ns = round(emulation.answer_delay_s * 1e9)
    valves = []
    for number, line in enumerate(devices.lines):
        valve = EmulatedItv(line, platform.full_scale_pa, devices.reading(number), delay_ns, boot_ns, up_ns)
        line.station = valve
        valves.append(valve)
    devices.connect(valves, platform, seed)
    return devices


def emulate_alicat(platform: AlicatPlatform, lockstep: bool, seed: int) -> SerialDevices:
    """Emulated Alicat controllers on one line."""
    devices = SerialDevices(platform, 1, half_duplex=True, lockstep=lockstep)
    emulation = platform.emulation
    boot_ns = round(emulation.boot_delay_s * 1e9)
    up_ns = 0 if lockstep else boot_ns
    units = [
        EmulatedAlicat(
            valve.unit,
            emulation.firmware,
            emulation.unit,
            emulation.full_scale_pa,
            devices.reading(number),
            boot_ns,
            up_ns,
        )
        for number, valve in enumerate(platform.valves)
    ]
    (line,) = devices.lines
    line.station = AlicatBus(line, units, round(emulation.answer_delay_s * 1e9))
    devices.connect(units, platform, seed)
    return devices
