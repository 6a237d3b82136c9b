"""An emulated SMC ITV: commands in lines, a set point of 10 bit, the monitored pressure."""

from __future__ import annotations

from collections.abc import Callable

from soro_core.hardware.emulation.uart import FOREVER_NS, Station, Uart

FULL_COUNTS = 1023
_LONGEST_LINE = 64


class EmulatedItv(Station):
    """One ITV on its line.

    Parameters
    ----------
    line : Uart
        Its line.
    full_scale_pa : float
        Pressure at 1023 counts.
    reading_pa : callable
        Measured pressure now.
    answer_delay_ns, boot_ns
        Time from a command to its answer; silence after power-on.
    up_ns : int
        Time at which it is up for the first time.
    """

    def __init__(
        self,
        line: Uart,
        full_scale_pa: float,
        reading_pa: Callable[[], float],
        answer_delay_ns: int,
        boot_ns: int,
        up_ns: int = 0,
    ) -> None:
        self._line, self._full_scale_pa, self._reading_pa = line, full_scale_pa, reading_pa
        self._delay_ns, self._boot_ns = answer_delay_ns, boot_ns
        self._up_ns = up_ns
        self._buffer = bytearray()
        self.counts = 0
        self.muted = self.ignores_setpoint = False

    def demand_pa(self) -> float:
        """Set point [Pa gauge]; it has no other state, and no watchdog."""
        return self.counts * self._full_scale_pa / FULL_COUNTS

    def reboot(self, now_ns: int) -> None:
        """Lose power and come back, at set point 0."""
        self.counts, self._up_ns = 0, now_ns + self._boot_ns
        self._buffer.clear()

    def unpower(self, now_ns: int, is_off: bool) -> None:
        """Be without power, or start again."""
        self.reboot(now_ns)
        if is_off:
            self._up_ns = FOREVER_NS

    def ignore_setpoints(self, is_on: bool) -> None:
        """Confirm set points and keep the last one."""
        self.ignores_setpoint = is_on

    def receive(self, chunk: bytes, end_ns: int) -> None:
        if end_ns < self._up_ns:
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
        """Answer to one command, without its end."""
        word, _, argument = line.partition(b" ")
        if word == b"SET" and argument.isdigit():
            return self._set(int(argument[:6]))
        if not argument:
            if word == b"REQ":
                return b"%d" % self.counts
            if word == b"MON":
                counts = int(self._reading_pa() / self._full_scale_pa * FULL_COUNTS)
                return b"%d" % min(max(counts, 0), FULL_COUNTS)
            if word in (b"INC", b"DEC"):
                return self._set(min(max(self.counts + (1 if word == b"INC" else -1), 0), FULL_COUNTS))
        return b"UNKNOWN COMMAND"

    def _set(self, counts: int) -> bytes:
        if counts > FULL_COUNTS:
            return b"OUT OF RANGE"
        if not self.ignores_setpoint:
            self.counts = counts
        return b"%d" % counts
