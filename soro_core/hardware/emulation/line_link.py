"""A driver's end of an emulated line in this process, for tests in lockstep: a connection, a serial port."""

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


class LinePort:
    """The same as a serial port; `gone` takes it away from the host."""

    def __init__(self, line: Line, name: str) -> None:
        self.name = name
        self.gone = False
        self._line = line

    def read(self) -> bytes:
        self._check()
        chunk = bytes(self._line.output)
        self._line.output.clear()
        return chunk

    def write(self, data: bytes) -> None:
        self._check()
        self._line.feed(data)

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        self._line.output.clear()

    def _check(self) -> None:
        if self.gone:
            raise HardwareError(f"{self.name}: the port is gone (unplugged)")
