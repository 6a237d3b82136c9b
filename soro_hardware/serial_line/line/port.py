"""A serial port without blocking reads and writes."""

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
from soro_hardware.error_text import reason
from soro_hardware.transport.serial_port import open_serial

_CHUNK = 65536
_FIRST_RETRY_S = 0.05


class BytePort(Protocol):
    """A port as the driver uses it."""

    name: str

    def read(self) -> bytes:
        """Return the received bytes; raises `HardwareError` if the port is lost."""

    def write(self, data: bytes) -> None:
        """Send bytes, at once or as soon as possible."""

    def fileno(self) -> int:
        """Return the descriptor for `select`; -1 for none."""

    def reopen(self) -> bool:
        """Try once, without waiting, to open a lost port; return whether it is open."""

    def close(self) -> None:
        """Close; never raises."""


class SerialPort:
    """A serial port or pseudo-terminal, 8N1, no flow control.

    Modem lines are never read: a pseudo-terminal has none, and many cables do not carry them. The port is
    locked, so that two programs cannot talk to one valve.

    Parameters
    ----------
    path : str
        Path of the port.
    baud : int
        Baud rate.
    is_there : bool
        False if the port may be missing; then it counts as lost until `reopen` succeeds.

    Raises
    ------
    HardwareError
        If the port cannot be opened; in the methods, if the port is lost.
    """

    def __init__(self, path: str, baud: int, is_there: bool = True) -> None:
        self.name, self._baud = path, baud
        self._waiting = b""
        self._port: serial.Serial | None = None
        self._fd, self._why = -1, ""
        if is_there:
            self._open()
        else:
            self.reopen()

    def _open(self) -> None:
        try:
            self._port = open_serial(self.name, self._baud)
        except HardwareError as error:
            self._why = error.text
            raise
        self._fd = self._port.fileno()

    def fileno(self) -> int:
        """Return the file descriptor."""
        return self._fd

    def reopen(self) -> bool:
        """Try once, without waiting, to open a lost port; return whether it is open."""
        self.close()
        with contextlib.suppress(HardwareError):
            self._open()
        return self._port is not None

    def read(self) -> bytes:
        """Return the received bytes."""
        self._require()
        self._send()
        try:
            chunk = os.read(self._fd, _CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise HardwareError(f"the port is gone ({reason(error)})", self.name, "gone") from None
        if not chunk:
            raise HardwareError("the port is gone (end of file)", self.name, "gone")
        return chunk

    def write(self, data: bytes) -> None:
        """Send bytes; the next call sends those that the port does not accept now."""
        self._require()
        self._waiting += data
        self._send()

    def close(self) -> None:
        """Close; never raises."""
        port, self._port = self._port, None
        if port is None:
            return
        with contextlib.suppress(OSError, serial.SerialException, termios.error):
            fcntl.flock(self._fd, fcntl.LOCK_UN)  # the supervisor may have the port for a moment longer
        with contextlib.suppress(OSError, serial.SerialException, termios.error):
            port.close()
        self._fd, self._waiting = -1, b""

    def _require(self) -> None:
        if self._port is None:
            raise HardwareError(self._why or "the port is closed", self.name, "open" if self._why else "gone")

    def _send(self) -> None:
        while self._waiting:
            try:
                self._waiting = self._waiting[os.write(self._fd, self._waiting) :]
            except BlockingIOError:
                return
            except OSError as error:
                raise HardwareError(f"the port is gone ({reason(error)})", self.name, "gone") from None


def open_with_retries(path: str, baud: int, limit_s: float, clock: Callable[[], float]) -> SerialPort:
    """Open a port that may be missing for some time, with tries after 50, 100, 200 ms and so on.

    Parameters
    ----------
    path : str
    baud : int
        Baud rate.
    limit_s : float
        Time for all tries [s].
    clock : callable
        Returns a monotonic time [s].

    Raises
    ------
    HardwareError
        If the last try fails.
    """
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
    """Return the paths of `count` ports: the links 0, 1, ... in a folder, or a list separated by commas.

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
        raise HardwareError(f"{len(paths)} ports named, the platform has {count}", endpoint, "setting")
    return paths
