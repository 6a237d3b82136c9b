"""Endpoints of emulated lines, which the host opens: pseudo-terminals, or TCP ports of this machine."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import selectors
import socket
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable

from soro_hardware.emulation.line import Line
from soro_hardware.transport.host import accept_host

_CHUNK = 65536
# What a browser can be made to begin a connection with: a request, or the greeting of an encrypted one.
_METHODS = b"GET POST HEAD OPTIONS PUT PATCH DELETE CONNECT TRACE PRI".split()
_WEB = (*(method + b" " for method in _METHODS), b"\x16\x03\x01", b"\x16\x03\x03")


def is_web_request(first: bytes) -> bool | None:
    """Return whether the first bytes of a connection are a browser's; None if they are too few to tell."""
    if first.startswith(_WEB):
        return True
    return None if any(begin.startswith(first) for begin in _WEB) else False


class Endpoint(ABC):
    """Endpoint of a line, which the host opens.

    Parameters
    ----------
    line : Line
        Line that is served.
    selector : selector
        Event loop that calls the endpoint when bytes have arrived.
    before_input : callable
        Called before the line receives bytes, to advance the devices to the present.
    """

    def __init__(
        self, line: Line, selector: selectors.BaseSelector, before_input: Callable[[], None]
    ) -> None:
        self.line = line
        self._selector, self._before_input = selector, before_input
        self._descriptor = -1  # descriptor of the host; -1 while there is no host

    @property
    @abstractmethod
    def address(self) -> str:
        """Path or address that the host opens."""

    @abstractmethod
    def close(self) -> None:
        """Close the endpoint."""

    @abstractmethod
    def lose(self) -> None:
        """End the connection: the host has disconnected, or the line ends it."""

    def write(self) -> None:
        """Write as much of the line's output as possible without blocking."""
        if self._descriptor < 0:
            self.line.output.clear()
        try:
            while self.line.output:
                del self.line.output[: os.write(self._descriptor, self.line.output)]
        except BlockingIOError:
            pass
        except OSError:
            self.lose()
        if self.line.hang_up:
            self.lose()

    def wait_writable(self, timeout_s: float) -> None:
        """Wait until the host can receive more bytes, at most `timeout_s` [s]."""
        if self._descriptor >= 0:
            select.select([], [self._descriptor], [], timeout_s)

    def read(self) -> bool:
        """Pass received bytes to the line; return whether there may be more."""
        if self._descriptor < 0:
            return False
        try:
            chunk = os.read(self._descriptor, _CHUNK)
        except BlockingIOError:
            return False
        except OSError:
            chunk = b""
        self._before_input()
        admitted = self.admit(chunk) if chunk else None
        if admitted is None:
            self.lose()
            return False
        if admitted:
            self.line.feed(admitted)
        return True

    def admit(self, chunk: bytes) -> bytes | None:
        """Return the bytes that may reach the line now; None ends the connection."""
        return chunk

    def serve(self, descriptor: int) -> None:
        """Start to serve the host at a descriptor."""
        self._descriptor = descriptor
        self._selector.register(descriptor, selectors.EVENT_READ, self.read)

    def unregister(self, descriptor: int) -> None:
        """Stop reading from a descriptor."""
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(descriptor)


class PtyEndpoint(Endpoint):
    """A line on a pseudo-terminal, in place of a serial port; parameters as in `Endpoint`."""

    def __init__(
        self, line: Line, selector: selectors.BaseSelector, before_input: Callable[[], None]
    ) -> None:
        super().__init__(line, selector, before_input)
        master, self._slave = pty.openpty()
        # The slave stays open here, so that the line stays when a host closes it, as an adapter does.
        tty.setraw(self._slave)
        os.set_blocking(master, False)
        self._path = os.ttyname(self._slave)
        self.serve(master)

    @property
    def address(self) -> str:
        return self._path

    def close(self) -> None:
        self.unregister(self._descriptor)
        for descriptor in (self._descriptor, self._slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    def lose(self) -> None:
        """Do nothing: a serial port has no connection to end."""


class TcpEndpoint(Endpoint):
    """A line on a TCP port of this machine; parameters as in `Endpoint`.

    The line accepts or refuses a second host. A web page that is open on this machine reaches the port too:
    it can send bytes of its choice behind the head of a request, so a connection that begins as one ends.
    """

    def __init__(
        self, line: Line, selector: selectors.BaseSelector, before_input: Callable[[], None]
    ) -> None:
        super().__init__(line, selector, before_input)
        self._host: socket.socket | None = None
        self._first: bytes | None = b""  # of the connection, until they have shown who sends them
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        selector.register(self._listener.fileno(), selectors.EVENT_READ, self._accept)

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self._listener.getsockname()[1]}"

    def close(self) -> None:
        self.lose()
        self.unregister(self._listener.fileno())
        self._listener.close()

    def lose(self) -> None:
        host, self._host = self._host, None
        self.line.hang_up = False
        if host is not None:
            self.unregister(self._descriptor)
            self._descriptor = -1
            host.close()
            self.line.output.clear()
            self.line.connected(False)

    def admit(self, chunk: bytes) -> bytes | None:
        if self._first is None:
            return chunk
        self._first += chunk
        if (is_web := is_web_request(self._first)) is not False:
            return None if is_web else b""
        first, self._first = self._first, None
        return first

    def _accept(self) -> None:
        self._before_input()
        host = accept_host(self._listener, self.read, self.line.refuse_host)
        if host is not None:
            self.lose()
            self._host, self._first = host, b""
            self.serve(host.fileno())
            self.line.connected(True)


ENDPOINTS: dict[str, type[PtyEndpoint] | type[TcpEndpoint]] = {"pty": PtyEndpoint, "tcp": TcpEndpoint}
