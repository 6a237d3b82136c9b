"""Emulated Alicat controllers on one half-duplex line: addressing, timing and streaming."""

from __future__ import annotations

import re

from soro_hardware.emulation.serial_line.alicat import EmulatedAlicat
from soro_hardware.emulation.serial_line.uart import Station, Uart

_LONGEST_LINE = 64
_IDLE_BYTES = 3.5


class AlicatBus(Station):
    """All units of a line; they execute a command when the line has been idle for 3.5 bytes after its CR.

    Parameters
    ----------
    line : Uart
        Line of the units.
    units : list of EmulatedAlicat
        Units on the line.
    answer_delay_ns : int
        Time [ns] from a command to its answer.
    """

    def __init__(self, line: Uart, units: list[EmulatedAlicat], answer_delay_ns: int) -> None:
        self._line, self.units = line, units
        self._delay_ns = answer_delay_ns
        self._idle_ns = round(_IDLE_BYTES * line.byte_ns)
        self._buffer = bytearray()
        self._command: tuple[int, bytes] | None = None  # with the time of its execution
        self._stream_ns: int | None = None
        self.hurried = 0  # commands lost because the next byte arrived too early

    def receive(self, chunk: bytes, end_ns: int) -> None:
        start_ns = end_ns - len(chunk) * self._line.byte_ns
        if self._command is not None and start_ns < self._command[0]:
            if chunk == b"\n":  # an Alicat ignores the LF after a CR
                return
            self._command, self.hurried = None, self.hurried + 1
        self._buffer += chunk.rstrip(b"\r\n")[:_LONGEST_LINE]
        del self._buffer[_LONGEST_LINE:]
        if chunk.endswith(b"\r"):
            self._command = (end_ns + self._idle_ns, bytes(self._buffer))
            self._buffer.clear()
        self._plan()

    def act(self, now_ns: int) -> None:
        self.before(now_ns)
        if self._command is not None and self._command[0] <= now_ns:
            line, self._command = self._command[1], None
            self._obey(line, now_ns)
        elif self._stream_ns is not None and self._stream_ns <= now_ns:
            self._stream(now_ns)
        self._plan()

    def _obey(self, line: bytes, now_ns: int) -> None:
        text = line.decode("ascii", "replace").strip().upper()
        if found := re.fullmatch(r"@@[ =]([A-Z])", text):
            for unit in self.units:
                if unit.streaming:
                    unit.streaming, unit.unit = False, found[1]
            return
        for unit in self.units:
            if text[:1] == unit.unit and unit.is_up(now_ns) and not unit.streaming:
                lines = unit.command(text[1:].strip() if len(text) > 1 else "")
                if lines and not unit.muted:
                    self._line.send(b"".join(row + b"\r" for row in lines), now_ns + self._delay_ns)
                if unit.streaming:
                    self._stream_ns = now_ns + unit.interval_ns

    def _stream(self, now_ns: int) -> None:
        self._stream_ns = None
        for unit in self.units:
            if unit.streaming and unit.is_up(now_ns) and not unit.muted:
                self._line.send(unit.frame() + b"\r", now_ns)
            if unit.streaming:
                self._stream_ns = now_ns + unit.interval_ns

    def _plan(self) -> None:
        times = [
            time
            for time in (self._command[0] if self._command else None, self._stream_ns)
            if time is not None
        ]
        self.act_ns = min(times, default=None)
