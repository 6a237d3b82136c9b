"""The emulator's end of the plant link: any number of listeners, and at most one that moves the air."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import stat
from pathlib import Path

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.plant_link import PlantFrame, pack_frame, take_answer
from soro_core.hardware.port import Array
from soro_core.hardware.reason import no_socket
from soro_core.pneumatics.valve_condition import ValveAction

_BACKLOG = 65536  # bytes kept for a client that does not read; further frames are dropped whole


class _Client:
    def __init__(self, connection: socket.socket) -> None:
        self.socket, self.backlog, self.heard = connection, bytearray(), b""


class PlantLinkServer:
    """The emulator's end: no client can hold it up but the one that moves the air, in lockstep.

    Parameters
    ----------
    path : str or Path
        Of the socket; one that a killed emulator left is replaced.
    n : int
        Number of chambers.
    lockstep : bool
        Whether `pressures` waits for the answer to the last frame.
    timeout_s : float
        How long.

    Attributes
    ----------
    dropped : int
        Frames that a client did not read in time.

    Raises
    ------
    HardwareError
        If the socket cannot be made.
    """

    def __init__(self, path: str | Path, n: int, lockstep: bool = False, timeout_s: float = 10.0) -> None:
        self.path = Path(path)
        self.dropped = 0
        self._n, self._lockstep, self._timeout_s = n, lockstep, timeout_s
        self._sequence = self._answered = self._asked = 0
        self._clients: list[_Client] = []
        self._owner: _Client | None = None
        self._pressures: Array = np.zeros(n)
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
                connection, _ = self._listener.accept()
                connection.setblocking(False)
                self._clients.append(_Client(connection))

    def publish(self, time_ns: int, pressures: Array, action: ValveAction) -> None:
        """Send one frame to every client."""
        self._sequence += 1
        self._asked = self._sequence
        if not self._clients:
            return
        frame = pack_frame(PlantFrame(self._sequence, time_ns, pressures, action))
        for client in list(self._clients):
            if len(client.backlog) + len(frame) > _BACKLOG:
                self.dropped += 1
            else:
                client.backlog += frame
            try:
                del client.backlog[: client.socket.send(client.backlog)]
            except BlockingIOError:
                pass
            except OSError:
                self._lose(client)

    def pressures(self) -> Array | None:
        """Pressures [Pa gauge] of the air where a client moves it, None where nobody does.

        In real time these are the last ones; in lockstep those that answer the last frame.

        Raises
        ------
        HardwareError
            If in lockstep no answer comes.
        """
        self.accept()
        for client in list(self._clients):
            self._hear(client)
        while self._lockstep and self._owner is not None and self._answered < self._asked:
            if not select.select([self._owner.socket], [], [], self._timeout_s)[0]:
                raise HardwareError(
                    f"{self.path}: the twin, which moves the air, has not answered for {self._timeout_s:g} s"
                )
            self._hear(self._owner)
        return None if self._owner is None else self._pressures

    def close(self) -> None:
        """Let the clients go and remove the socket."""
        for client in list(self._clients):
            self._lose(client)
        self._listener.close()
        with contextlib.suppress(OSError):
            os.unlink(self.path)

    def _hear(self, client: _Client) -> None:
        """Take what a client has sent; one that sends nonsense, or is the second to move the air, goes."""
        try:
            chunk = client.socket.recv(65536)
            if not chunk:
                raise ConnectionError
            client.heard += chunk
            answer, client.heard = take_answer(client.heard)
            while answer is not None:
                self._obey(client, *answer)
                answer, client.heard = take_answer(client.heard)
        except BlockingIOError:
            pass
        except (OSError, ValueError):
            self._lose(client)

    def _obey(self, client: _Client, sequence: int, pressures: Array) -> None:
        if not pressures.size:
            self._owner = None if client is self._owner else self._owner
            return
        if pressures.shape != (self._n,) or not np.all(np.isfinite(pressures)):
            raise ValueError(f"{pressures} for {self._n} chambers")
        if self._owner is None:
            self._owner, self._asked = client, 0
        elif client is not self._owner:
            raise ValueError("a second one that moves the air")
        self._answered, self._pressures = sequence, pressures

    def _lose(self, client: _Client) -> None:
        client.socket.close()
        self._clients.remove(client)
        if client is self._owner:
            self._owner = None
