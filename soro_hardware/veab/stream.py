"""Messages of the VEAB client: sends set points and receives readings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from soro_core.arrays import Array
from soro_hardware.transport.tcp import ByteLink, drain
from soro_hardware.veab import protocol
from soro_hardware.veab.config import VeabPlatform
from soro_hardware.veab.count import PortCount


class MessageStream:
    """Messages over one connection; every failure of the connection is a `HardwareError` of the link.

    Parameters
    ----------
    platform : VeabPlatform
        Ports and valves.
    link : ByteLink
        Connection to the server.
    clock : callable
        Returns a monotonic time [s].
    lockstep : bool
        Whether each message has one reading as answer.

    Attributes
    ----------
    pressure_pa : ndarray (n,)
        Newest reading [Pa gauge] of each valve, NaN before the first.
    sent, received, garbled : int
        Number of messages, and of times that the stream has become invalid.
    late, refused : int
        0: the server answers no message.
    sent_s : float
        Time of the last message with set points [s].
    count : PortCount
        Number of ports of the server, according to the readings of this connection.
    """

    def __init__(
        self, platform: VeabPlatform, link: ByteLink, clock: Callable[[], float], lockstep: bool
    ) -> None:
        self.sent = self.received = self._taken = 0
        self.late = self.garbled = self.refused = 0
        self.sent_s = 0.0
        self._link, self._clock, self._size = link, clock, platform.ports
        self._ports = [valve.port for valve in platform.valves]
        self._decoder = protocol.ReadingDecoder(platform.ports)
        self._push_hz = None if lockstep else platform.push_hz
        self.count = PortCount(platform.ports, self._push_hz)
        self.pressure_pa: Array = np.full(len(self._ports), np.nan)

    @property
    def broken(self) -> str | None:
        """Why the readings are invalid, or None."""
        return self._decoder.broken

    @property
    def has_new(self) -> bool:
        """Whether a reading has arrived since `take_new`."""
        return self.received != self._taken

    def take_new(self) -> bool:
        """Return whether a reading has arrived since the last call."""
        new, self._taken = self.has_new, self.received
        return new

    def begin(self) -> None:
        """Start with a new connection."""
        self._decoder.reset()
        self.count = PortCount(self._size, self._push_hz)

    def skip(self) -> None:
        """Continue at the next reading, because another process has received some."""
        self._decoder.reset()

    def send(self, setpoint_pa: Array) -> bool:
        """Send set points (n,) [Pa gauge], and 0 Pa for unused ports; return False if `count` forbids it.

        The server ends at a message of another length than its own. Before the first message, it commands
        0 Pa by itself.
        """
        if not self.count.may_send:
            return False
        values = [0.0] * self._size
        for port, value in zip(self._ports, setpoint_pa.tolist(), strict=True):
            values[port] = value
        self.sent_s = self._clock()
        self._link.send(protocol.encode(values))
        self.sent += 1
        return True

    def receive(self, timeout_s: float) -> bool:
        """Receive bytes, waiting at most `timeout_s` [s]; return whether any arrived."""
        chunk = self._link.receive(timeout_s)
        if chunk:
            self.count.take(len(chunk), self._clock())
        for reading in self._decoder.feed(chunk):
            self.received += 1
            self.pressure_pa = np.array([reading[port] for port in self._ports])
        return bool(chunk)

    def drain(self) -> None:
        """Receive without waiting; a stream without pauses is invalid."""
        if not drain(self.receive):
            self._decoder.broken = self._decoder.broken or "readings without a pause"
