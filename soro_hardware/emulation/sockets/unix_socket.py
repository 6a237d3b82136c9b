"""A Unix socket server in an event loop; it replaces the file of a killed process, not of a running one."""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import stat
from abc import ABC, abstractmethod
from pathlib import Path

from soro_core.errors import HardwareError
from soro_hardware.error_text import no_socket

_CHUNK = 65536


class SocketClient:
    """A client, with bytes received from it and bytes that wait to be sent to it."""

    def __init__(self, connection: socket.socket) -> None:
        self.socket, self.received, self.backlog = connection, b"", bytearray()


class UnixServer(ABC):
    """A Unix socket server; no client can block it.

    Parameters
    ----------
    path : str or Path
        Path of the socket.
    what : str
        What the clients send or are, for messages.
    selector : selector
        Event loop that calls the server when bytes have arrived.

    Raises
    ------
    HardwareError
        If the socket cannot be made, or another process listens there.
    """

    def __init__(self, path: str | Path, what: str, selector: selectors.BaseSelector) -> None:
        self.path, self._selector = Path(path), selector
        self._clients: list[SocketClient] = []
        if not self.path.parent.is_dir():
            raise HardwareError(
                f"cannot listen for {what} (there is no folder {self.path.parent})", path, "open"
            )
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            if self.path.exists() and stat.S_ISSOCK(self.path.stat().st_mode):
                if _answers(self.path):
                    raise HardwareError(
                        f"cannot listen for {what} (another emulator listens there)", path, "open"
                    )
                self.path.unlink()
            former = os.umask(0o177)  # only this user may connect, from the start
            try:
                self._socket.bind(str(self.path))
            finally:
                os.umask(former)
            self._made = self.path.stat().st_ino
            self._socket.listen()
        except OSError as error:
            self._socket.close()
            raise HardwareError(f"cannot listen for {what} ({no_socket(error)})", path, "open") from None
        except HardwareError:
            self._socket.close()
            raise
        self._socket.setblocking(False)
        selector.register(self._socket, selectors.EVENT_READ, self._accept)

    def close(self) -> None:
        """Drop the clients, and remove the file unless another process has replaced it."""
        for client in list(self._clients):
            self.drop(client)
        self._selector.unregister(self._socket)
        self._socket.close()
        with contextlib.suppress(OSError):
            if self.path.stat().st_ino == self._made:
                os.unlink(self.path)

    @abstractmethod
    def take(self, client: SocketClient) -> None:
        """Remove and process the complete messages in `client.received`; a ValueError drops the client."""

    def read(self, client: SocketClient) -> None:
        """Receive and process bytes of a client."""
        try:
            chunk = client.socket.recv(_CHUNK)
            if not chunk:
                raise ConnectionError
            client.received += chunk
            self.take(client)
        except BlockingIOError:
            pass
        except (OSError, ValueError):
            self.drop(client)

    def write(self, client: SocketClient, message: bytes = b"") -> None:
        """Send as much as possible without blocking; the rest follows later."""
        client.backlog += message
        try:
            del client.backlog[: client.socket.send(client.backlog)]
        except BlockingIOError:
            pass
        except OSError:
            self.drop(client)
            return
        wanted = selectors.EVENT_READ | (selectors.EVENT_WRITE if client.backlog else 0)
        key = self._selector.get_key(client.socket)
        if key.events != wanted:
            self._selector.modify(client.socket, wanted, key.data)

    def drop(self, client: SocketClient) -> None:
        """Close the connection of a client."""
        if client in self._clients:
            self._clients.remove(client)
            self._selector.unregister(client.socket)
            client.socket.close()

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            connection, _ = self._socket.accept()
            connection.setblocking(False)
            client = SocketClient(connection)
            self._clients.append(client)
            self._selector.register(connection, selectors.EVENT_READ, lambda: self._serve(client))

    def _serve(self, client: SocketClient) -> None:
        self.read(client)
        if client.backlog and client in self._clients:
            self.write(client)


def _answers(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as caller:
        caller.setblocking(False)
        try:
            caller.connect(str(path))
        except BlockingIOError:  # its backlog is full
            return True
        except OSError:
            return False
    return True
