"""A serial port without waiting: bytes that have come, bytes to send, an error that names it when it goes."""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import termios
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import serial

from soro_core.errors import HardwareError
from soro_core.hardware.reason import reason

_CHUNK = 65536
_FIRST_RETRY_S = 0.05


class BytePort(Protocol):
    """What the driver needs of a port."""

    name: str

    def read(self) -> bytes:
        """Bytes that have come; raises HardwareError when the port has gone."""

    def write(self, data: bytes) -> None:
        """Send bytes, at once or as soon as the port takes them."""

    def fileno(self) -> int:
        """Descriptor that is readable when bytes have come; -1 for none."""

    def close(self) -> None:
        """Close; never raises."""


class SerialPort:
    """A serial port or pseudo-terminal, 8N1, no flow control.

    Modem lines are never read: a pseudo-terminal has none, and many cables do not carry them. The port is
    locked, so that two programs cannot talk to one valve.

    Raises
    ------
    HardwareError
        If it cannot be opened; later, from the call that finds it gone.
    """

    def __init__(self, path: str, baud: int) -> None:
        self.name = path
        self._waiting = b""
        try:
            self._port = serial.Serial(path, baud, timeout=0, exclusive=True)
        except (OSError, serial.SerialException, ValueError, termios.error) as error:
            raise HardwareError(f"{path}: cannot open the port ({reason(error)})") from None
        self._fd: int = self._port.fileno()
        os.set_blocking(self._fd, False)
        # With VMIN = 1 "nothing yet" is EAGAIN, so that an empty read always means that the port is gone.
        attributes = termios.tcgetattr(self._fd)
        attributes[6][termios.VMIN] = 1
        termios.tcsetattr(self._fd, termios.TCSANOW, attributes)

    def fileno(self) -> int:
        """File descriptor."""
        return self._fd

    def read(self) -> bytes:
        """Bytes that have come."""
        self._send()
        try:
            chunk = os.read(self._fd, _CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise HardwareError(f"{self.name}: the port is gone ({reason(error)})") from None
        if not chunk:
            raise HardwareError(f"{self.name}: the port is gone (end of file)")
        return chunk

    def write(self, data: bytes) -> None:
        """Send bytes; what the port does not take now goes out with the next call."""
        self._waiting += data
        self._send()

    def close(self) -> None:
        """Close; never raises."""
        with contextlib.suppress(OSError, serial.SerialException, termios.error):
            fcntl.flock(self._fd, fcntl.LOCK_UN)  # the supervisor may have the port for a moment longer
        with contextlib.suppress(OSError, serial.SerialException, termios.error):
            self._port.close()

    def _send(self) -> None:
        while self._waiting:
            try:
                self._waiting = self._waiting[os.write(self._fd, self._waiting) :]
            except BlockingIOError:
                return
            except OSError as error:
                raise HardwareError(f"{self.name}: the port is gone ({reason(error)})") from None


def open_with_retries(path: str, baud: int, limit_s: float, clock: Callable[[], float]) -> SerialPort:
    """Open a port that may be coming back: again after 50, 100, 200 ms, ... until `limit_s` is over."""
    deadline, pause_s = clock() + limit_s, _FIRST_RETRY_S
    while True:
        try:
            return SerialPort(path, baud)
        except HardwareError:
            if clock() + pause_s > deadline:
                raise
        select.select([], [], [], pause_s)
        pause_s *= 2


def paths_of(endpoint: str, count: int) -> list[str]:
    """Paths of `count` ports: a folder of links 0, 1, ..., or a list with commas.

    Raises
    ------
    HardwareError
        If the endpoint names another number of ports.
    """
    folder = Path(endpoint)
    if folder.is_dir():
        return [str(folder / str(number)) for number in range(count)]
    paths = endpoint.split(",")
    if len(paths) != count:
        raise HardwareError(f"{endpoint}: {len(paths)} ports named, the platform has {count}")
    return paths
