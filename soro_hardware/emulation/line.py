"""A line between emulated devices and their host."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Literal


class Line(ABC):
    """Bytes in both directions between the host and the devices: a serial port, an adapter, a connection.

    All bytes pass through `to_devices` or `to_host`; there faults change, add and drop bytes.

    Attributes
    ----------
    output : bytearray
        Bytes for the host; the process removes those that it has written.
    transport : str
        Transport of this line; empty for that of the devices.
    hang_up : bool
        The devices set it to close the connection; TCP only.
    refuses : bool
        The devices set it while they accept no new connection; TCP only.
    """

    transport: ClassVar[Literal["", "pty", "tcp"]] = ""

    def __init__(self) -> None:
        self.output = bytearray()
        self.hang_up = self.refuses = False
        self.to_devices: Callable[[bytes], bytes] = _unchanged
        self.to_host: Callable[[bytes], bytes] = _unchanged

    def feed(self, chunk: bytes) -> None:
        """Receive bytes from the host, at the emulated time."""
        self.take(self.to_devices(chunk))

    def put(self, chunk: bytes) -> None:
        """Send bytes to the host."""
        self.output += self.to_host(chunk)

    @abstractmethod
    def take(self, chunk: bytes) -> None:
        """Process bytes of the host, after the faults of the line."""

    def refuse_host(self, address: str) -> bytes | None:
        """Return None to accept a new host at an IP address, or the bytes sent to a refused one; TCP only."""
        return b"" if self.refuses else None

    def connected(self, has_host: bool) -> None:  # noqa: B027 - many lines have nothing to do
        """Process that the host has connected or disconnected; TCP only."""


def _unchanged(chunk: bytes) -> bytes:
    return chunk
