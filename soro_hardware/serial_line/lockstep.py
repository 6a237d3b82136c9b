"""Lockstep on a serial line: a mark of the host ends its cycle, and the emulator returns the mark.

Marks exist only between the driver and the emulator. When the emulator has received the mark (SYN) on every
line, it advances its time by one cycle, sends the bytes of that time, and returns the mark on every line.
During the start-up the mark is ENQ: the time advances without a cycle of the control loop, and the twin of
the arm makes no step.
"""

from __future__ import annotations

import select
from collections.abc import Callable

from soro_core.errors import HardwareError
from soro_hardware.serial_line.line.port import BytePort

MARK = b"\x16"  # ASCII SYN, "synchronous idle"
START_MARK = b"\x05"  # ASCII ENQ, "enquiry"


class LockstepPort:
    """A port that hides the marks from its reader."""

    def __init__(self, port: BytePort) -> None:
        self.name = port.name
        self._port = port
        self._bytes = b""
        self._marks = 0
        self._gone: HardwareError | None = None

    def read(self) -> bytes:
        """Return the bytes received before the last mark."""
        if self._gone is not None:
            raise self._gone
        chunk, self._bytes = self._bytes, b""
        return chunk

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._port.write(data)

    def fileno(self) -> int:
        """Descriptor of the port."""
        return self._port.fileno()

    def reopen(self) -> bool:
        """Try once to open the port again; return whether it is open."""
        if not self._port.reopen():
            return False
        self._bytes, self._marks, self._gone = b"", 0, None
        return True

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def end_cycle(self, mark: bytes = MARK) -> None:
        """Send the mark."""
        try:
            self._port.write(mark)
        except HardwareError as error:
            self._gone = error
            raise

    def await_cycle(self, timeout_s: float, clock: Callable[[], float]) -> None:
        """Receive bytes up to the mark of the devices.

        Raises
        ------
        HardwareError
            If the mark does not arrive within `timeout_s` [s].
        """
        deadline = clock() + timeout_s
        while True:
            chunk = self._port.read()
            bare = chunk.translate(None, MARK + START_MARK)
            self._marks += len(chunk) - len(bare)
            self._bytes += bare
            if self._marks:
                self._marks -= 1
                return
            left_s = deadline - clock()
            if left_s <= 0:
                text = f"no end of cycle for {timeout_s:g} s; is it an emulator in lockstep?"
                raise HardwareError(text, self.name, "silent")
            if self._port.fileno() >= 0:
                select.select([self._port.fileno()], [], [], left_s)
