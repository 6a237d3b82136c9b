"""A driver's connection straight to an emulated line in this process, for tests in lockstep."""

from __future__ import annotations

from soro_core.errors import HardwareError
from soro_core.hardware.emulation.devices import Line


class LineLink:
    """The host's end of a line; what has not come with the bytes sent never comes."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._open = False

    @property
    def is_open(self) -> bool:
        return self._open

    def open(self) -> None:
        self.close()
        if not self.reconnect():
            raise HardwareError("emulated line: cannot connect (refused)")

    def close(self) -> None:
        if self._open:
            self._open = False
            self._line.connected(False)
        self._line.hang_up = False
        self._line.output.clear()

    def send(self, data: bytes) -> None:
        self._check()
        self._line.feed(data)

    def receive(self, timeout_s: float) -> bytes:
        if not self._line.output:
            self._check()
        chunk = bytes(self._line.output)
        self._line.output.clear()
        return chunk

    def reconnect(self) -> bool:
        if not self._open and not self._line.refuses:
            self._open = True
            self._line.connected(True)
        return self._open

    def fileno(self) -> int:
        return -1

    def _check(self) -> None:
        if self._line.hang_up:
            self.close()
        if not self._open:
            raise HardwareError("emulated line: the connection is gone")
