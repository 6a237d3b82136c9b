"""The adapter's end of a LAWICEL line: commands in, frames and replies out; the process moves the bytes."""

from __future__ import annotations

from collections.abc import Callable

from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.slcan_codec import BEL, CR, LONGEST_LINE, decode_frame, encode

LONGEST_OUTPUT = 65536  # bytes kept for a host that does not read; lines beyond are lost


class SlcanServer:
    """State of an emulated adapter.

    Parameters
    ----------
    send : callable
        Takes the frames that the host sends.
    """

    def __init__(self, send: Callable[[Frame], None]) -> None:
        self.output = bytearray()
        self.overruns = 0
        self._send = send
        self._open = self._listen_only = False
        self._rest = b""

    def feed(self, chunk: bytes) -> None:
        """Take bytes from the host."""
        *lines, self._rest = (self._rest + chunk).split(CR)
        if len(self._rest) > LONGEST_LINE:
            self._rest = b"?"  # noise: refused as one bad command when its CR comes
        for line in lines:
            if line:  # python-can sends an empty line when it opens; it is no command
                self._put(self._command(line))

    def deliver(self, frame: Frame) -> None:
        """Take a frame from the bus."""
        if self._open:
            self._put(encode(frame))

    def _put(self, line: bytes) -> None:
        if len(self.output) > LONGEST_OUTPUT:
            self.overruns += 1
        else:
            self.output += line

    def _command(self, line: bytes) -> bytes:
        kind = line[:1]
        if kind in b"tTrR":
            frame = decode_frame(line)
            if frame is None or not self._open or self._listen_only:
                return BEL
            self._send(frame)
            return b"z\r" if kind in b"tr" else b"Z\r"
        if line == b"C":
            self._open = False
            self.output.clear()  # what waits for a host that has gone is not for the next one
            return CR
        if line in (b"O", b"L"):
            self._open, self._listen_only = True, line == b"L"  # a second O is python-can's habit
            return CR
        if len(line) == 2 and kind == b"S" and line[1:] in b"0123456789"[:9]:
            return BEL if self._open else CR
        return {b"V": b"V1013\r", b"N": b"NA408\r", b"F": b"F00\r" if self._open else BEL}.get(line, BEL)
