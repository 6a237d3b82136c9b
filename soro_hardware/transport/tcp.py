"""A byte stream to a device over TCP, without a thread and without long blocking.

The next call detects a lost connection.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
from collections.abc import Callable
from typing import Any, Literal, Protocol

from pydantic import Field

from soro_core.config import Strict
from soro_core.errors import HardwareError
from soro_hardware.error_text import reason

_CHUNK = 65536
_LAST_PORT = 65535
FIRST_DELAY_S, LONGEST_DELAY_S = 0.1, 2.0
# More chunks than any device has sent when its host reads again after seconds.
_MOST_CHUNKS = 8


class TcpTransport(Strict):
    """Address of a device."""

    kind: Literal["tcp"]
    host: str | None = Field(None, description="name or address; none: the user gives it with --device")
    port: int = Field(ge=1, le=65535, description="TCP port")
    connect_timeout_s: float = Field(2.0, gt=0, le=30, description="longest time for connecting")

    @property
    def address(self) -> str | None:
        """``host:port``, or None."""
        return None if self.host is None else f"{self.host}:{self.port}"


class ByteLink(Protocol):
    """A connection as the drivers use it; every failure is a `HardwareError` and ends the connection.

    Attributes
    ----------
    before_send : callable
        Called directly before bytes are sent; what it raises keeps them back.
    """

    before_send: Callable[[], None]

    @property
    def is_open(self) -> bool:
        """Whether the connection is open; it may have failed since."""

    def open(self) -> None:
        """Close an older connection, connect, and wait for the connection."""

    def close(self) -> None:
        """Close the connection; never raises."""

    def send(self, data: bytes) -> None:
        """Send all bytes."""

    def receive(self, timeout_s: float) -> bytes:
        """Return the received bytes, waiting at most `timeout_s` [s] for the first; empty for none."""

    def reconnect(self) -> bool:
        """Try once to restore a lost connection, without waiting; return whether it is open."""

    def fileno(self) -> int:
        """Return the descriptor of the connection."""


# Longest time in which the other side accepts the bytes of one `send` [s].
_SEND_S = 0.02


class TcpLink:
    """Connection to ``host:port``.

    Parameters
    ----------
    address : str
        ``192.168.4.3:8888``, ``[::1]:8888``, or the path of a symbolic link with such a target, as
        `soro emulate` makes it.
    connect_timeout_s : float
        Longest time to connect [s].
    clock : callable
        Returns a monotonic time [s].
    """

    def __init__(self, address: str, connect_timeout_s: float, clock: Callable[[], float]) -> None:
        self.address = address
        self._connect_timeout_s, self._clock = connect_timeout_s, clock
        self._target: tuple[int, Any] | None = None  # family and address, resolved by `open`
        self._socket: socket.socket | None = None
        self._pending: socket.socket | None = None  # a connection in progress
        self._pending_since_s = self._next_try_s = 0.0
        self._delay_s = FIRST_DELAY_S
        self.before_send: Callable[[], None] = lambda: None

    @property
    def is_open(self) -> bool:
        return self._socket is not None

    def open(self) -> None:
        self.close()
        self._target = _resolve(self.address)
        family, where = self._target
        sock = socket.socket(family, socket.SOCK_STREAM)
        try:
            sock.settimeout(self._connect_timeout_s)
            sock.connect(where)
        except OSError as error:
            sock.close()
            raise HardwareError(f"cannot connect ({reason(error)})", self.address, "open") from None
        self._take(sock)

    def close(self) -> None:
        for sock in (self._socket, self._pending):
            if sock is not None:
                with contextlib.suppress(OSError):
                    sock.close()
        self._socket = self._pending = None

    def send(self, data: bytes) -> None:
        sock = self._require()
        deadline = self._clock() + _SEND_S
        self.before_send()
        try:
            while data:
                try:
                    data = data[sock.send(data) :]
                except BlockingIOError:
                    left = deadline - self._clock()
                    if left <= 0:
                        raise self._lost("the other side takes no more bytes") from None
                    _wait(sock, select.POLLOUT, left)
        except OSError as error:
            raise self._lost(reason(error)) from None

    def receive(self, timeout_s: float) -> bytes:
        sock = self._require()
        try:
            if timeout_s > 0:
                _wait(sock, select.POLLIN, timeout_s)
            chunk = sock.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._lost(reason(error)) from None
        if not chunk:
            raise self._lost("closed by the other side")
        self._delay_s = FIRST_DELAY_S
        return chunk

    def reconnect(self) -> bool:
        if self._socket is not None:
            return True
        now = self._clock()
        if self._pending is None:
            if now >= self._next_try_s and self._target is not None:
                self._begin(*self._target, now)
            return False
        events = _wait(self._pending, select.POLLOUT, 0.0)
        error = self._pending.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) if events else 0
        if events and not error:
            sock, self._pending = self._pending, None
            self._take(sock)
            return True
        if error or now - self._pending_since_s > self._connect_timeout_s:
            self._back_off(now)
        return False

    def fileno(self) -> int:
        return self._require().fileno()

    def _begin(self, family: int, where: Any, now: float) -> None:
        self._pending, self._pending_since_s = socket.socket(family, socket.SOCK_STREAM), now
        self._pending.setblocking(False)
        try:
            self._pending.connect(where)
        except BlockingIOError:
            return
        except OSError:
            self._back_off(now)

    def _back_off(self, now: float) -> None:
        """Wait before the next attempt, longer each time until bytes arrive."""
        if self._pending is not None:
            self._pending.close()
        self._pending = None
        self._next_try_s = now + self._delay_s
        self._delay_s = min(2 * self._delay_s, LONGEST_DELAY_S)

    def _take(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        # Otherwise a small message waits for the acknowledgement of the last one: 40 ms in each cycle.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = sock

    def _require(self) -> socket.socket:
        if self._socket is None:
            raise HardwareError("not connected", self.address, "gone")
        return self._socket

    def _lost(self, why: str) -> HardwareError:
        self.close()
        self._back_off(self._clock())
        return HardwareError(f"the connection is gone ({why})", self.address, "gone")


def drain(take: Callable[[float], bool]) -> bool:
    """Receive chunks without waiting, at most a fixed number; return whether the device has paused.

    The limit keeps a device that sends without a pause from blocking the caller and its vent.

    Parameters
    ----------
    take : callable
        Receives a chunk within a time [s]; returns whether one arrived.
    """
    return any(not take(0.0) for _ in range(_MOST_CHUNKS))


def link_to(address: str | None, who: str, connect_timeout_s: float, clock: Callable[[], float]) -> TcpLink:
    """Make the link to an address.

    Parameters
    ----------
    address : str or None
        Address as in `TcpLink`.
    who : str
        Name of the device in errors.
    connect_timeout_s : float
        Longest time to connect [s].
    clock : callable
        Returns a monotonic time [s].

    Raises
    ------
    HardwareError
        If there is no address.
    """
    if address is None:
        raise HardwareError("no address: give transport.host in the platform, or an endpoint", who, "setting")
    return TcpLink(address, connect_timeout_s, clock)


def _wait(sock: socket.socket, events: int, timeout_s: float) -> bool:
    """Wait for events or an error, at most `timeout_s` [s]; return whether there is one."""
    poll = select.poll()
    poll.register(sock, events)
    return bool(poll.poll(max(1e3 * timeout_s, 0.0)))


def _resolve(address: str) -> tuple[int, Any]:
    """Return family and socket address."""
    try:
        target = os.readlink(address) if "/" in address else address
        host, _, number = target.rpartition(":")
        if not 1 <= (port := int(number)) <= _LAST_PORT:  # getaddrinfo uses it modulo 65536
            raise ValueError
        found = socket.getaddrinfo(host.strip("[]"), port, type=socket.SOCK_STREAM)
    except ValueError:
        allowed = f"expected host:port, with a port of 1 to {_LAST_PORT}"
        raise HardwareError(f"no such address, {allowed}", address, "setting") from None
    except OSError as error:
        raise HardwareError(
            f"no such address, expected host:port ({reason(error)})", address, "setting"
        ) from None
    return found[0][0], found[0][4]
