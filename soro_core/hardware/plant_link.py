"""Plant link: the emulator's true chamber pressures on a Unix stream socket, for the twin that owns the arm.

One frame after each SYNC (lockstep) or each step (real time): magic, number of chambers, sequence, time, and
the gauge pressures as float64, little-endian.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import stat
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.port import Array
from soro_core.hardware.reason import no_socket, reason

_HEADER = struct.Struct("<4sIQq")
_MAGIC = b"SPL1"
_BACKLOG = 65536  # bytes kept for a client that does not read; further frames are dropped whole


class PlantFrame(NamedTuple):
    """True pressures [Pa gauge] at a time of the emulated world; `sequence` counts the frames from 1."""

    sequence: int
    time_ns: int
    pressures: Array


class PlantLinkServer:
    """The emulator's end: any number of clients, none of which can hold it up."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.dropped = 0
        self._sequence = 0
        self._clients: dict[socket.socket, bytearray] = {}
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            if self.path.exists() and stat.S_ISSOCK(self.path.stat().st_mode):
                self.path.unlink()  # left by one that was killed
            self._listener.bind(str(self.path))
            self._listener.listen()
        except OSError as error:
            self._listener.close()
            raise HardwareError(
                f"{path}: cannot listen for plant link clients ({no_socket(error)})"
            ) from None
        self._listener.setblocking(False)

    def fileno(self) -> int:
        """Descriptor that is readable when a client waits."""
        return self._listener.fileno()

    def accept(self) -> None:
        """Take the clients that wait; they get the frames from now on."""
        with contextlib.suppress(BlockingIOError):
            while True:
                client, _ = self._listener.accept()
                client.setblocking(False)
                self._clients[client] = bytearray()

    def publish(self, time_ns: int, pressures: Array) -> None:
        """Send one frame to every client."""
        self._sequence += 1
        if not self._clients:
            return
        values = np.ascontiguousarray(pressures, dtype="<f8")
        frame = _HEADER.pack(_MAGIC, values.size, self._sequence, time_ns) + values.tobytes()
        for client, backlog in list(self._clients.items()):
            if len(backlog) + len(frame) > _BACKLOG:
                self.dropped += 1
            else:
                backlog += frame
            try:
                del backlog[: client.send(backlog)]
            except BlockingIOError:
                pass
            except OSError:
                client.close()
                del self._clients[client]

    def close(self) -> None:
        """Let the clients go and remove the socket."""
        for sock in (*self._clients, self._listener):
            sock.close()
        self._clients.clear()
        with contextlib.suppress(OSError):
            os.unlink(self.path)


class PlantLinkClient:
    """The twin's end.

    Raises
    ------
    HardwareError
        If no emulator listens at the path; later, when it has gone or sends something else.
    """

    def __init__(self, path: str | Path) -> None:
        self._path, self._buffer = str(path), b""
        self._last: PlantFrame | None = None
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(self._path)
        except OSError as error:
            self._socket.close()
            raise HardwareError(f"{path}: no emulator serves this plant link ({reason(error)})") from None
        self._socket.setblocking(False)
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def fileno(self) -> int:
        """Descriptor that is readable when a frame waits."""
        return self._socket.fileno()

    def receive(self, timeout_s: float) -> PlantFrame:
        """Take the next frame, in order.

        Raises
        ------
        HardwareError
            If none comes in time, or the emulator has gone.
        """
        frame = self.wait(timeout_s)
        if frame is None:
            raise HardwareError(f"{self._path}: no pressures from the emulator for {timeout_s:g} s")
        return frame

    def wait(self, timeout_s: float) -> PlantFrame | None:
        """Take the next frame, in order, or None if none comes in time; raises if the emulator has gone."""
        while (frame := self._take()) is None:
            if not self._poll.poll(1e3 * timeout_s):
                return None
            self._read()
        return frame

    def latest(self) -> PlantFrame | None:
        """Newest frame that has come, without waiting; None if there has never been one."""
        while self._poll.poll(0):
            self._read()
            while self._take() is not None:
                pass
        while self._take() is not None:
            pass
        return self._last

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _read(self) -> None:
        try:
            chunk = self._socket.recv(65536)
        except BlockingIOError:
            return
        except OSError as error:
            raise HardwareError(f"{self._path}: plant link broken ({reason(error)})") from None
        if not chunk:
            raise HardwareError(f"{self._path}: the emulator has gone")
        self._buffer += chunk

    def _take(self) -> PlantFrame | None:
        if len(self._buffer) < _HEADER.size:
            return None
        magic, n, sequence, time_ns = _HEADER.unpack_from(self._buffer)
        if magic != _MAGIC:
            raise HardwareError(f"{self._path}: this is no plant link (starts with {magic!r})")
        end = _HEADER.size + 8 * n
        if len(self._buffer) < end:
            return None
        pressures = np.frombuffer(self._buffer, "<f8", n, _HEADER.size).astype(np.float64)
        self._buffer = self._buffer[end:]
        self._last = PlantFrame(sequence, time_ns, pressures)
        return self._last
