"""A connection and a serial port to an emulated line in the same process, for tests in lockstep."""

from __future__ import annotations

from collections.abc import Callable

from soro_core.errors import HardwareError
from soro_hardware.emulation.line import Line


class LineLink:
    """A connection to an emulated line; all answers arrive during `send`.

    Attributes
    ----------
    line : Line
        Line of the devices; another one in its place is that of other devices at the same address.
    """

    def __init__(self, line: Line) -> None:
        self.line = line
        self._open = False
        self.before_send: Callable[[], None] = lambda: None

    @property
    def is_open(self) -> bool:
        return self._open

    def open(self) -> None:
        self.close()
        if not self.reconnect():
            raise HardwareError("cannot connect (refused)", "emulated line", "open")

    def close(self) -> None:
        if self._open:
            self._open = False
            self.line.connected(False)
        self.line.hang_up = False
        self.line.output.clear()

    def send(self, data: bytes) -> None:
        self._check()
        self.before_send()
        self.line.feed(data)

    def receive(self, timeout_s: float) -> bytes:
        if not self.line.output:
            self._check()
        chunk = bytes(self.line.output)
        self.line.output.clear()
        return chunk

    def reconnect(self) -> bool:
        if not self._open and not self.line.refuses:
            self._open = True
            self.line.connected(True)
        return self._open

    def fileno(self) -> int:
        return -1

    def _check(self) -> None:
        if self.line.hang_up:
            self.close()
        if not self._open:
            raise HardwareError("the connection is gone", "emulated line", "gone")


class LinePort:
    """A serial port to an emulated line; `gone` removes it from the host until the port is opened again."""

    def __init__(self, line: Line, name: str) -> None:
        self.name = name
        self.gone = self._is_lost = False
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

    def reopen(self) -> bool:
        self._is_lost = self.gone
        return not self.gone

    def close(self) -> None:
        self._is_lost = False  # the next one to open it gets this port
        self._line.output.clear()

    def _check(self) -> None:
        self._is_lost = self._is_lost or self.gone
        if self._is_lost:
            raise HardwareError("the port is gone (unplugged)", self.name, "gone")
