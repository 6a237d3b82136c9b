"""Emulated devices on serial lines, for a platform."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import partial
from typing import Any

from soro_hardware.emulation.devices import EmulatedDevices
from soro_hardware.emulation.serial_line.alicat import AlicatBus, EmulatedAlicat
from soro_hardware.emulation.serial_line.uart import Station, Uart
from soro_hardware.emulation.serial_line.valve import SerialValve, ValveSetup
from soro_hardware.serial_line.config import AlicatPlatform, ItvPlatform
from soro_hardware.serial_line.lockstep import MARK, START_MARK

FULL_COUNTS = 1023
_LONGEST_LINE = 64


class EmulatedItv(SerialValve, Station):
    """One ITV on its line.

    Parameters
    ----------
    line : Uart
        Line of the device.
    setup : ValveSetup
        Range, sensor and times; 1023 counts are its full scale.
    answer_delay_ns : int
        Time [ns] from a command to its answer.
    """

    def __init__(self, line: Uart, setup: ValveSetup, answer_delay_ns: int) -> None:
        super().__init__(setup)
        self._line, self._delay_ns = line, answer_delay_ns
        self._buffer = bytearray()

    def to_unit(self, pressure_pa: float) -> int:
        return round(pressure_pa / self._full_scale_pa * FULL_COUNTS)

    def demand_pa(self) -> float:
        return self.setpoint * self._full_scale_pa / FULL_COUNTS

    def reboot(self, now_ns: int) -> None:
        super().reboot(now_ns)
        self._buffer.clear()

    def receive(self, chunk: bytes, end_ns: int) -> None:
        if not self.is_up(end_ns):
            return
        self._buffer += chunk[:_LONGEST_LINE]
        if not chunk.endswith(b"\n"):
            del self._buffer[_LONGEST_LINE:]
            return
        line = bytes(self._buffer).strip(b"\r\n ")
        self._buffer.clear()
        if line:
            self.before(end_ns)
            answer = self.command(line)
            if not self.muted:
                self._line.send(answer + b"\r\n", end_ns + self._delay_ns)

    def command(self, line: bytes) -> bytes:
        """Return the answer to one command, without line end."""
        word, _, argument = line.partition(b" ")
        if word == b"SET" and argument.isdigit():
            return self._set(int(argument[:6]))
        if not argument:
            if word == b"REQ":
                return b"%d" % self.setpoint
            if word == b"MON":
                counts = int(self.reading_pa() / self._full_scale_pa * FULL_COUNTS)
                return b"%d" % min(max(counts, 0), FULL_COUNTS)
            if word in (b"INC", b"DEC"):
                return self._set(min(max(int(self.setpoint) + (1 if word == b"INC" else -1), 0), FULL_COUNTS))
        return b"UNKNOWN COMMAND"

    def _set(self, counts: int) -> bytes:
        if counts > FULL_COUNTS:
            return b"OUT OF RANGE"
        if not self.ignores_setpoint:
            self.setpoint = counts
        return b"%d" % counts


class SerialDevices(EmulatedDevices):
    """Devices on serial lines; a subclass makes those of its dialect; parameters as in `EmulatedDevices`.

    In lockstep a mark of the host on every line advances the time by one cycle. The baud rate still counts,
    so that an answer takes as many cycles as in real time.
    """

    lines: tuple[Uart, ...]

    def __init__(self, platform: ItvPlatform | AlicatPlatform, lockstep: bool, seed: int = 0) -> None:
        super().__init__(platform, lockstep, seed)
        emulation, self._baud = platform.emulation, platform.baud
        self._boot_ns = round(emulation.boot_delay_s * 1e9)
        self._answer_ns = round(emulation.answer_delay_s * 1e9)
        self._up_ns = 0 if lockstep else self._boot_ns
        self.valves = self.connect(platform)
        for valve in self.valves:
            valve.wake(emulation.wake_pa or 0.0)
        self.connect_air([valve.demand_pa for valve in self.valves])
        for line in self.lines:
            if line.station is not None:
                line.station.before = self.air.advance
        self._marks = [0] * len(self.lines)
        self.on_fault("reboot", lambda place: self.valves[place].reboot(self.now_ns))
        self.while_fault("mute", lambda place, is_on: self.valves[place].mute(is_on))
        self.while_fault("brownout", lambda place, is_on: self.valves[place].power(self.now_ns, not is_on))
        self.while_fault("setpoint_ignored", lambda place, is_on: self.valves[place].ignore_setpoints(is_on))

    @abstractmethod
    def connect(self, platform: Any) -> Sequence[SerialValve]:
        """Make the devices of a platform and connect them to lines."""

    def new_line(self, half_duplex: bool) -> Uart:
        """Add a line; `half_duplex` is whether both directions share the wire."""
        marks = MARK + START_MARK if self.lockstep else b""
        line = Uart(self._baud, half_duplex, now_ns=lambda: self.now_ns, marks=marks)
        line.on_mark = partial(self._on_mark, len(self.lines))
        self.add_line(line)
        return line

    def setup(self, number: int, full_scale_pa: float) -> ValveSetup:
        """Return range [Pa gauge], sensor and times of a valve."""
        return ValveSetup(full_scale_pa, lambda: self.air.reading_pa(number), self._boot_ns, self._up_ns)

    def give_setpoint(self, place: int, pressure_pa: float) -> None:
        self.valves[place].give(pressure_pa)

    def due_ns(self) -> int | None:
        return min((due for line in self.lines if (due := line.due_ns()) is not None), default=None)

    def work(self, now_ns: int) -> None:
        while (due := self.due_ns()) is not None and due <= now_ns:
            next(line for line in self.lines if line.due_ns() == due).step(due)

    def _on_mark(self, number: int, mark: bytes) -> None:
        self._marks[number] += 1
        if all(self._marks):
            self._marks = [count - 1 for count in self._marks]
            self.work(self.now_ns + self.period_ns)
            self.end_cycle(is_cycle=mark == MARK)
            for line in self.lines:
                line.answer_mark(mark)


class ItvDevices(SerialDevices):
    """ITVs, one on each line."""

    def connect(self, platform: ItvPlatform) -> Sequence[SerialValve]:
        valves = []
        for number in range(len(platform.valves)):
            line = self.new_line(half_duplex=False)
            line.station = valve = EmulatedItv(
                line, self.setup(number, platform.full_scale_pa), self._answer_ns
            )
            valves.append(valve)
        return valves


class AlicatDevices(SerialDevices):
    """Alicat controllers on one line."""

    def connect(self, platform: AlicatPlatform) -> Sequence[SerialValve]:
        emulation, line = platform.emulation, self.new_line(half_duplex=True)
        setups = [self.setup(number, emulation.full_scale_pa) for number in range(len(platform.valves))]
        units = [
            EmulatedAlicat(valve.unit, emulation.firmware, emulation.unit, setup)
            for valve, setup in zip(platform.valves, setups, strict=True)
        ]
        line.station = AlicatBus(line, units, self._answer_ns)
        self.while_fault("overheat", lambda place, is_on: units[place].overheat(is_on))
        return units
