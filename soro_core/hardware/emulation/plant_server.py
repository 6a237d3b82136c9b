"""The emulator's end of the plant link: any number of listeners, and at most one that moves the air."""

from __future__ import annotations

import select
import selectors
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.emulation.unix_socket import UnixListener
from soro_core.hardware.plant_link import Message, PlantFrame, Says, pack_frame, take_message
from soro_core.hardware.port import Array
from soro_core.pneumatics.valve_condition import ValveAction, healthy

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
    present_pa : callable
        Gives the true pressures [Pa gauge] of the chambers now.
    selector : selector
        The loop that calls back when something has come.
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

    def __init__(
        self,
        path: str | Path,
        present_pa: Callable[[], Array],
        selector: selectors.BaseSelector,
        lockstep: bool = False,
        timeout_s: float = 10.0,
    ) -> None:
        self.dropped = 0
        self._present_pa, self._selector = present_pa, selector
        self._lockstep, self._timeout_s = lockstep, timeout_s
        self._sequence = self._asked = self._answered = self._time_ns = 0
        self._clients: list[_Client] = []
        self._owner: _Client | None = None
        self._pressures: Array = np.empty(0)
        self._left: Array | None = None
        """The last pressures of one that has let the air go; the devices may not have read them yet."""
        self._listener = UnixListener(path, "a twin")
        selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def publish(self, time_ns: int, pressures: Array, action: ValveAction) -> None:
        """Send one frame to every client."""
        self._sequence += 1
        self._asked, self._time_ns = self._sequence, time_ns
        if not self._clients:
            return
        frame = pack_frame(PlantFrame(self._sequence, time_ns, pressures, action))
        for client in list(self._clients):
            if len(client.backlog) + len(frame) > _BACKLOG:
                self.dropped += 1
            else:
                client.backlog += frame
            self._write(client)

    def pressures(self) -> Array | None:
        """Pressures [Pa gauge] of the air where a client moves it, None where nobody does.

        In real time these are the last ones; in lockstep those that answer the last frame. The last ones of a
        client that has let the air go are given once more.

        Raises
        ------
        HardwareError
            If in lockstep no answer comes.
        """
        while self._lockstep and self._owner is not None and self._answered < self._asked:
            if not select.select([self._owner.socket], [], [], self._timeout_s)[0]:
                raise HardwareError(
                    f"{self._listener.path}: the twin, which moves the air, has not answered for "
                    f"{self._timeout_s:g} s"
                )
            self._read(self._owner)
        if self._owner is not None:
            return self._pressures
        left, self._left = self._left, None
        return left

    def close(self) -> None:
        """Let the clients go and remove the socket."""
        for client in list(self._clients):
            self._lose(client)
        self._selector.unregister(self._listener)
        self._listener.close()

    def _accept(self) -> None:
        if (connection := self._listener.accept()) is not None:
            client = _Client(connection)
            self._clients.append(client)
            self._selector.register(connection, selectors.EVENT_READ, lambda: self._serve(client))

    def _serve(self, client: _Client) -> None:
        self._read(client)
        if client.backlog and client in self._clients:
            self._write(client)

    def _read(self, client: _Client) -> None:
        """Take what a client has sent; one that sends nonsense goes."""
        try:
            chunk = client.socket.recv(65536)
            if not chunk:
                raise ConnectionError
            client.heard += chunk
            message, client.heard = take_message(client.heard)
            while message is not None:
                self._obey(client, message)
                message, client.heard = take_message(client.heard)
        except BlockingIOError:
            pass
        except (OSError, ValueError):
            self._lose(client)

    def _obey(self, client: _Client, message: Message) -> None:
        if message.says is Says.ANSWER:
            self._take(client, message)
            return
        if message.says is Says.CLAIM and self._owner in (None, client):
            # From where the air is, and not before the next frame.
            self._pressures, self._asked = self._present_pa(), 0
            self._owner, self._left = client, None
        elif client is self._owner:
            self._let_go()
        if message.says is not Says.RELEASE:
            is_refused = message.says is Says.CLAIM and self._owner is not client
            self._tell_present(client, np.empty(0) if is_refused else self._present_pa())

    def _take(self, client: _Client, message: Message) -> None:
        pressures = message.pressures
        if client is not self._owner:
            raise ValueError("an answer from one that does not move the air")
        if pressures.shape != self._pressures.shape or not np.all(np.isfinite(pressures)):
            raise ValueError(f"{pressures} for {self._pressures.size} chambers")
        self._answered, self._pressures = message.sequence, pressures

    def _tell_present(self, client: _Client, pressures: Array) -> None:
        nothing = ValveAction((), healthy(pressures.size))
        client.backlog += pack_frame(PlantFrame(0, self._time_ns, pressures, nothing))
        self._write(client)

    def _write(self, client: _Client) -> None:
        """Send what fits, and the rest when there is room."""
        try:
            del client.backlog[: client.socket.send(client.backlog)]
        except BlockingIOError:
            pass
        except OSError:
            self._lose(client)
            return
        wanted = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.backlog else 0)
        key = self._selector.get_key(client.socket)
        if key.events != wanted:
            self._selector.modify(client.socket, wanted, key.data)

    def _lose(self, client: _Client) -> None:
        if client not in self._clients:
            return
        self._clients.remove(client)
        self._selector.unregister(client.socket)
        client.socket.close()
        if client is self._owner:
            self._let_go()

    def _let_go(self) -> None:
        self._owner = None
        if self._answered >= self._asked:
            self._left = self._pressures
