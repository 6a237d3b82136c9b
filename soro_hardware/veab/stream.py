"""Messages of the VEAB client: sends set points and receives readings.

The number of ports of a server is found from its readings before the driver sends a set point.
The server writes each reading, 8 bytes for each port, in one piece. The network may join pieces, but does not
divide a piece that is shorter than a packet. So a reading ends wherever the stream pauses, and the number of
values received until then is a multiple of the server's number of ports. If it is no multiple of `ports`, the
server has another number of ports. If it is one, the server may still have a divisor of `ports`, for example
half of it, with readings that are joined in pairs. It would then send 500 readings per second, above its
limit of 250: so the rate decides. A server that is slower than 60 % of its rate cannot be distinguished from
one with half of the ports.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from soro_core.arrays import Array
from soro_hardware.transport.tcp import ByteLink, drain
from soro_hardware.veab import protocol
from soro_hardware.veab.config import VeabPlatform


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


_VALUE = 8  # bytes
# The network may divide a longer piece anywhere.
_PACKET = 1200
# Number of pieces after which the number of ports is very probably correct.
_PIECES = 10
# Window of the measurement of the rate [s]. A change of the network delay by 30 ms is 15 % of it.
_WINDOW_S, _EXCESS = 0.2, 1.15


class PortCount:
    """Number of ports of a server, according to the readings of one connection.

    Parameters
    ----------
    ports : int
        Number of ports in the platform file.
    push_hz : float or None
        Highest rate of the server's readings [Hz]; None in lockstep, where readings are not joined.
    """

    def __init__(self, ports: int, push_hz: float | None) -> None:
        self._ports, self._push_hz = ports, push_hz
        self._bytes = self._pieces = self._step = 0
        self._begin_s: float | None = None
        self._begin_bytes = 0
        self._values_hz = 0.0  # fastest of all windows
        self._is_known = False

    def take(self, size: int, now_s: float) -> None:
        """Count a piece of the stream, until the number of ports is known."""
        if self._is_known:
            return
        self._bytes += size
        self._pieces += 1
        if size < _PACKET:
            self._step = math.gcd(self._step, self._bytes)
        if self._begin_s is None:  # the first piece may have been delayed
            self._begin_s, self._begin_bytes = now_s, self._bytes
        elif (span_s := now_s - self._begin_s) >= _WINDOW_S:
            self._values_hz = max(self._values_hz, (self._bytes - self._begin_bytes) / _VALUE / span_s)
            self._begin_s, self._begin_bytes = now_s, self._bytes
        self._is_known = self._is_whole and (self._push_hz is None or self._is_fast)

    @property
    def may_send(self) -> bool:
        """Whether a message for `ports` ports is one or several complete messages for this server."""
        if self._push_hz is None:  # after a lost first reading, the next one follows only after a message
            return self._is_whole or not self._pieces
        if self._is_whole:
            return True
        return self._fits_step and self._is_fast and self._reading_hz < self._push_hz * 2 / _EXCESS

    @property
    def fits(self) -> bool | None:
        """Whether the server has the number of ports in the platform file; None while unknown."""
        if self._is_known or not self._pieces:
            return self._is_known or None
        is_measured = self._push_hz is None or self._values_hz > 0
        if not self._fits_step:
            return False if is_measured or self._pieces >= _PIECES else None
        return False if is_measured and not self.may_send else None

    def __str__(self) -> str:
        stated = f"`ports` of the platform file is {self._ports}"
        if not self._pieces:
            return f"the server sends no readings, and {stated}"
        if self._step % _VALUE:
            return f"the server sends {self._step} bytes where each of its ports has {_VALUE}, and {stated}"
        if self._push_hz is not None and self._is_whole:
            return (
                f"{self._ports} values come {self._reading_hz:.0f} times a second, and the server sends "
                f"{self._push_hz:g} readings: they have {self._likely} values, and {stated}; "
                "if the server is slower, state host.push_hz"
            )
        return f"the server's readings have {self._likely} values, and {stated}"

    @property
    def _is_whole(self) -> bool:
        return self._step == _VALUE * self._ports

    @property
    def _fits_step(self) -> bool:
        return self._step % (_VALUE * self._ports) == 0

    @property
    def _reading_hz(self) -> float:
        return self._values_hz / self._ports

    @property
    def _is_fast(self) -> bool:
        """Whether the rate is too high for a server with half of the ports."""
        return self._push_hz is not None and 2 * self._reading_hz > _EXCESS * self._push_hz

    @property
    def _likely(self) -> int:
        """Likely number of ports of the server, from the rate if it is known."""
        most = self._step // _VALUE
        if self._push_hz is None or not self._values_hz:
            return most
        rough = self._values_hz / self._push_hz
        parts = [n for n in range(1, most + 1) if most % n == 0] or [max(round(rough), 1)]
        return min(parts, key=lambda n: abs(math.log(n / rough)))
