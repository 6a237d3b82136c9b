"""The adapter's end of a LAWICEL line: commands in, frames and replies out; the process moves the bytes."""

from __future__ import annotations

from collections.abc import Callable

from soro_core.hardware.emulation.adapter import Adapter
from soro_core.hardware.emulation.error_counters import ErrorCounters
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.slcan_codec import BEL, CR, LONGEST_LINE, decode_frame, encode

_STATES = {"active": b"a", "warning": b"w", "passive": b"p", "bus_off": b"b"}
_FLAGS = {"active": 0x00, "warning": 0x04, "passive": 0x24, "bus_off": 0xA4}


class SlcanServer(Adapter):
    """State of an emulated adapter."""

    def __init__(self, send: Callable[[Frame], bool]) -> None:
        super().__init__(send)
        self._open = self._listen_only = False
        self._flags = 0
        self._rest = b""

    def take(self, chunk: bytes) -> None:
        *lines, self._rest = (self._rest + chunk).split(CR)
        if len(self._rest) > LONGEST_LINE:
            self._rest = b"?"  # noise: refused as one bad command when its CR comes
        for line in lines:
            if line:  # python-can sends an empty line when it opens; it is no command
                self.say(self._command(line))

    def deliver(self, frame: Frame, now_ns: int) -> None:
        if self._open:
            self.say(encode(frame))

    def report(self, errors: ErrorCounters, letter: str) -> None:
        self._flags = _FLAGS[errors.state]
        if not self._open:
            return
        if letter:
            self.say(b"e1%s\r" % letter.encode())
        counters = b"%03d%03d" % (min(errors.receive, 255), min(errors.transmit, 255))
        self.say(b"s%s%s\r" % (_STATES[errors.state], counters))

    def _command(self, line: bytes) -> bytes:
        kind = line[:1]
        if kind in b"tTrR":
            frame = decode_frame(line)
            if frame is None or not self._open or self._listen_only or not self.send(frame):
                return BEL
            return b"z\r" if kind in b"tr" else b"Z\r"
        if line == b"C":
            self._open = False
            self.output.clear()  # what waits for a host that has gone is not for the next one
            return CR
        if line in (b"O", b"L"):
            if not self._open:  # a second O is python-can's habit
                self.rejoin()
            self._open, self._listen_only = True, line == b"L"
            return CR
        if len(line) == 2 and kind == b"S" and line[1:] in b"0123456789"[:9]:
            return BEL if self._open else CR
        flags = b"F%02X\r" % self._flags if self._open else BEL
        return {b"V": b"V1013\r", b"N": b"NA408\r", b"F": flags}.get(line, BEL)
