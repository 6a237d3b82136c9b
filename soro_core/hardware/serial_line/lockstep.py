"""How a serial line keeps lockstep: a mark from the host ends its cycle, the devices' mark answers it.

Real devices know no such thing; it exists between the driver and the emulator only. The emulator advances its
time by one cycle when it has the mark (SYN) on every line, lets out what the line carries in that time, and
then gives the mark back on every line. While devices are started the mark is another one (ENQ): it lets the
same time pass, but no cycle of the control loop, so that the twin of the arm is told nothing of it.
"""

from __future__ import annotations

import select
from collections.abc import Callable

from soro_core.errors import HardwareError
from soro_core.hardware.serial_line.port import BytePort

MARK = b"\x16"  # ASCII SYN, "synchronous idle"
START_MARK = b"\x05"  # ASCII ENQ, "enquiry"


class LockstepPort:
    """A port whose reader does not see the marks."""

    def __init__(self, port: BytePort) -> None:
        self.name = port.name
        self._port = port
        self._bytes = b""
        self._marks = 0

    def read(self) -> bytes:
        """Bytes that came before the last mark."""
        chunk, self._bytes = self._bytes, b""
        return chunk

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._port.write(data)

    def fileno(self) -> int:
        """Descriptor of the port."""
        return self._port.fileno()

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def end_cycle(self, mark: bytes = MARK) -> None:
        """Send the mark."""
        self._port.write(mark)

    def await_cycle(self, timeout_s: float, clock: Callable[[], float]) -> None:
        """Take what has come up to the devices' mark.

        Raises
        ------
        HardwareError
            If it does not come.
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
                raise HardwareError(
                    f"{self.name}: no end of cycle for {timeout_s:g} s; is it an emulator in lockstep?"
                )
            if self._port.fileno() >= 0:
                select.select([self._port.fileno()], [], [], left_s)
