"""An emulated SMC ITV: commands in lines, a set point of 10 bits, the measured pressure."""

from __future__ import annotations

from soro_hardware.emulation.serial_line.uart import Station, Uart
from soro_hardware.emulation.serial_line.valve import SerialValve, ValveSetup

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
