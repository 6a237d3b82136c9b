"""Where a host finds an emulated line: a pseudo-terminal, or a TCP port of this machine."""

from __future__ import annotations

import contextlib
import os
import pty
import selectors
import socket
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable

from soro_core.hardware.emulation.devices import Line
from soro_core.hardware.transport.tcp import hang_up

_CHUNK = 65536
_DRAIN = 16  # chunks of the present host that are taken before the line is asked about a new one


class Endpoint(ABC):
    """One line, served; `before_input` is called before bytes are given to it."""

    def __init__(
        self, line: Line, selector: selectors.BaseSelector, before_input: Callable[[], None]
    ) -> None:
        self.line = line
        self._selector, self._before_input = selector, before_input

    @property
    @abstractmethod
    def address(self) -> str:
        """What the host opens."""

    @abstractmethod
    def write(self) -> None:
        """Give the host what it takes of the line's output, without waiting."""

    @abstractmethod
    def wait_writable(self, timeout_s: float) -> None:
        """Wait until the host may take more."""

    @abstractmethod
    def close(self) -> None:
        """Take the line away from the host."""


class PtyEndpoint(Endpoint):
    """A line on a pseudo-terminal, the stand-in of a serial port."""

    def __init__(
        self, line: Line, selector: selectors.BaseSelector, before_input: Callable[[], None]
    ) -> None:
        super().__init__(line, selector, before_input)
        self._master, self._slave = pty.openpty()
        # The slave stays open here, so that the line outlives a host, as an adapter does.
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._path = os.ttyname(self._slave)
        selector.register(self._master, selectors.EVENT_READ, self._read)

    @property
    def address(self) -> str:
        return self._path

    def write(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while self.line.output:
                del self.line.output[: os.write(self._master, self.line.output)]

    def wait_writable(self, timeout_s: float) -> None:
        _wait_writable(self._master, timeout_s)

    def close(self) -> None:
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(self._master)
        for descriptor in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError):
            chunk = os.read(self._master, _CHUNK)
            self._before_input()
            self.line.feed(chunk)


class TcpEndpoint(Endpoint):
    """A line on a TCP port of this machine; the line decides about a second host."""

    def __init__(
        self, line: Line, selector: selectors.BaseSelector, before_input: Callable[[], None]
    ) -> None:
        super().__init__(line, selector, before_input)
        self._host: socket.socket | None = None
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        selector.register(self._listener, selectors.EVENT_READ, self._accept)

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self._listener.getsockname()[1]}"

    def write(self) -> None:
        if self._host is None:
            self.line.output.clear()
            return
        try:
            while self.line.output:
                del self.line.output[: self._host.send(self.line.output)]
        except BlockingIOError:
            pass
        except OSError:
            self._drop()
        if self.line.hang_up:
            self._drop()

    def wait_writable(self, timeout_s: float) -> None:
        if self._host is not None:
            _wait_writable(self._host.fileno(), timeout_s)

    def close(self) -> None:
        self._drop()
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(self._listener)
        self._listener.close()

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            host, (address, *_) = self._listener.accept()
            host.setblocking(False)
            self._before_input()
            # A host that has just left must not keep the next one out.
            for _ in range(_DRAIN):
                if not self._read():
                    break
            if (told := self.line.turn_away(address)) is not None:
                hang_up(host, told)
                return
            self._drop()
            host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._host = host
            self._selector.register(host, selectors.EVENT_READ, self._read)
            self.line.connected(True)

    def _read(self) -> bool:
        """Take what has come; whether there may be more."""
        if self._host is None:
            return False
        try:
            chunk = self._host.recv(_CHUNK)
        except BlockingIOError:
            return False
        except OSError:
            chunk = b""
        self._before_input()
        if chunk:
            self.line.feed(chunk)
        else:
            self._drop()
        return bool(chunk)

    def _drop(self) -> None:
        host, self._host = self._host, None
        self.line.hang_up = False
        if host is not None:
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(host)
            host.close()
            self.line.output.clear()
            self.line.connected(False)


ENDPOINTS: dict[str, type[PtyEndpoint] | type[TcpEndpoint]] = {"pty": PtyEndpoint, "tcp": TcpEndpoint}


def _wait_writable(descriptor: int, timeout_s: float) -> None:
    with selectors.SelectSelector() as selector:
        selector.register(descriptor, selectors.EVENT_WRITE)
        selector.select(timeout_s)
