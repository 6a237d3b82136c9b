"""A byte stream to a device over TCP: never blocks for long, says at once when the other side is gone.

Like the slcan bus it has no thread: a connection that breaks is noticed by the call that touches it.
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
from soro_core.hardware.reason import reason

_CHUNK = 65536
_LAST_PORT = 65535
FIRST_DELAY_S, LONGEST_DELAY_S = 0.1, 2.0
# More than any device has sent when its host comes back after seconds.
_MOST_CHUNKS = 8


class TcpTransport(Strict):
    """Where a device listens."""

    kind: Literal["tcp"]
    host: str | None = Field(None, description="name or address; none where it is given when opened")
    port: int = Field(ge=1, le=65535, description="TCP port")
    connect_timeout_s: float = Field(2.0, gt=0, le=30, description="longest time for connecting")

    @property
    def address(self) -> str | None:
        """``host:port``, or None."""
        return None if self.host is None else f"{self.host}:{self.port}"


class ByteLink(Protocol):
    """What the drivers need of a connection; every failure is a `HardwareError` and ends the connection."""

    @property
    def is_open(self) -> bool:
        """Whether there is a connection; it may have failed since."""

    def open(self) -> None:
        """Connect, waiting for it; an older connection is closed."""

    def close(self) -> None:
        """Close the connection; never raises."""

    def send(self, data: bytes) -> None:
        """Send all of it."""

    def receive(self, timeout_s: float) -> bytes:
        """What has come, waiting at most `timeout_s` for the first byte; empty if nothing came."""

    def reconnect(self) -> bool:
        """Take one step, without waiting, to get a lost connection back; True once it stands."""

    def fileno(self) -> int:
        """Descriptor of the connection."""


class TcpLink:
    """Connection to ``host:port``.

    Parameters
    ----------
    address : str
        ``192.168.4.3:8888``, ``[::1]:8888``, or the path of a symbolic link that reads so, as `soro emulate`
        makes it.
    connect_timeout_s : float
        Longest time for making the connection.
    send_timeout_s : float
        Longest time in which the other side must take the bytes of one `send`.
    clock : callable
        Monotonic time [s].
    """

    def __init__(
        self,
        address: str,
        connect_timeout_s: float,
        clock: Callable[[], float],
        send_timeout_s: float = 0.02,
    ) -> None:
        self.address = address
        self._connect_timeout_s, self._send_timeout_s, self._clock = connect_timeout_s, send_timeout_s, clock
        self._target: tuple[int, Any] | None = None  # family and address, resolved by `open`
        self._socket: socket.socket | None = None
        self._pending: socket.socket | None = None  # a connection that is being made
        self._pending_since_s = self._next_try_s = 0.0
        self._delay_s = FIRST_DELAY_S

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
            raise HardwareError(f"{self.address}: cannot connect ({reason(error)})") from None
        self._take(sock)

    def close(self) -> None:
        for sock in (self._socket, self._pending):
            if sock is not None:
                with contextlib.suppress(OSError):
                    sock.close()
        self._socket = self._pending = None

    def send(self, data: bytes) -> None:
        sock = self._require()
        deadline = self._clock() + self._send_timeout_s
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
        """Wait before the next attempt, longer each time until bytes have come."""
        if self._pending is not None:
            self._pending.close()
        self._pending = None
        self._next_try_s = now + self._delay_s
        self._delay_s = min(2 * self._delay_s, LONGEST_DELAY_S)

    def _take(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        # Without this a small message waits for the acknowledgement of the one before: 40 ms a cycle.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = sock

    def _require(self) -> socket.socket:
        if self._socket is None:
            raise HardwareError(f"{self.address}: not connected")
        return self._socket

    def _lost(self, why: str) -> HardwareError:
        self.close()
        self._back_off(self._clock())
        return HardwareError(f"{self.address}: the connection is gone ({why})")


def drain(take: Callable[[float], bool]) -> bool:
    """Take what has come, without waiting; whether there is an end to it.

    Who sends faster than it is read would keep the caller, and its vent, for ever.

    Parameters
    ----------
    take : callable
        Takes a chunk, given a time to wait; whether one came.
    """
    return any(not take(0.0) for _ in range(_MOST_CHUNKS))


def link_to(address: str | None, who: str, connect_timeout_s: float, clock: Callable[[], float]) -> TcpLink:
    """Link to what a platform or a caller names; `who` is named where neither does.

    Raises
    ------
    HardwareError
        If there is no address.
    """
    if address is None:
        raise HardwareError(f"{who}: no address: give transport.host in the platform, or an endpoint")
    return TcpLink(address, connect_timeout_s, clock)


def _wait(sock: socket.socket, events: int, timeout_s: float) -> bool:
    """Whether something of `events`, or an error, is there within the time."""
    poll = select.poll()
    poll.register(sock, events)
    return bool(poll.poll(max(1e3 * timeout_s, 0.0)))


def _resolve(address: str) -> tuple[int, Any]:
    """Family and socket address."""
    try:
        target = os.readlink(address) if "/" in address else address
        host, _, number = target.rpartition(":")
        if not 1 <= (port := int(number)) <= _LAST_PORT:  # it would be taken modulo 65536
            raise ValueError
        found = socket.getaddrinfo(host.strip("[]"), port, type=socket.SOCK_STREAM)
    except ValueError:
        allowed = f"expected host:port, with a port of 1 to {_LAST_PORT}"
        raise HardwareError(f"{address}: no such address, {allowed}") from None
    except OSError as error:
        raise HardwareError(f"{address}: no such address, expected host:port ({reason(error)})") from None
    return found[0][0], found[0][4]


def hang_up(host: socket.socket, told: bytes) -> None:
    """End a connection that has just come, after telling it why."""
    with contextlib.suppress(OSError):
        host.send(told)
    host.close()
