"""An emulated serial line with its baud rate; on a half-duplex line bytes can collide.

A pseudo-terminal transfers bytes at once at any baud rate, so this module delays them.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable

from soro_hardware.emulation.line import Line

BITS_PER_BYTE = 10
_PIECE_NS = 1_000_000  # the host receives an answer in pieces of this duration [ns]
_COLLISION = 0x55  # bits that a collision flips
LONGEST_QUEUE = 4096  # bytes from the host that may wait; further ones are lost
_PART = re.compile(rb"[^\r\n]*[\r\n]|[^\r\n]+")


class Station(ABC):
    """All devices on a line.

    Attributes
    ----------
    act_ns : int or None
        Time [ns] of the next `act`, None for none.
    before : callable
        The station calls it with the time [ns] before it changes a valve or reads its pressure.
    """

    act_ns: int | None = None
    before: Callable[[int], None] = staticmethod(lambda now_ns: None)

    @abstractmethod
    def receive(self, chunk: bytes, end_ns: int) -> None:
        """Process bytes without a pause that end at `end_ns` [ns]; a CR or LF is the last byte."""

    def act(self, now_ns: int) -> None:
        """Process the event of `act_ns`."""
        self.act_ns = None


class Uart(Line):
    """One serial line with its devices.

    Parameters
    ----------
    baud : int
        Baud rate [bit/s], with 8N1.
    half_duplex : bool
        Whether host and devices share the wire.
    now_ns : callable
        Returns the emulated time [ns].
    marks : bytes
        Bytes with which the host advances the time in lockstep; empty in real time.

    Attributes
    ----------
    byte_ns : int
        Duration of a byte [ns].
    station : Station or None
        Devices on the line.
    on_mark : callable
        Called with each mark of the host.
    collisions, overruns : int
        Number of collisions, and of bytes lost because the queue was full.
    """

    def __init__(self, baud: int, half_duplex: bool, now_ns: Callable[[], int], marks: bytes = b"") -> None:
        super().__init__()
        self.byte_ns = round(BITS_PER_BYTE * 1e9 / baud)
        self.station: Station | None = None
        self.on_mark: Callable[[bytes], None] = lambda mark: None
        self.collisions = self.overruns = 0
        self._half_duplex, self._now_ns = half_duplex, now_ns
        self._marks = re.compile(b"([%s])" % re.escape(marks)) if marks else None
        self._coming: deque[tuple[int, bytes]] = deque()  # end time, and bytes up to a CR, an LF or a pause
        self._going: deque[tuple[int, bytes]] = deque()
        self._host_ns = self._device_ns = 0  # end of the last byte of each side

    def feed(self, chunk: bytes) -> None:
        """Receive bytes from the host; faults do not act on its marks."""
        if self._marks is None:
            super().feed(chunk)
            return
        for part in self._marks.split(chunk):
            if self._marks.fullmatch(part):
                self.on_mark(part)
            elif part:
                super().feed(part)

    def answer_mark(self, mark: bytes) -> None:
        """Send a mark back to the host."""
        self.output += mark

    def take(self, chunk: bytes) -> None:
        now_ns = self._now_ns()
        for part in _PART.findall(chunk):
            if self._host_ns - now_ns > LONGEST_QUEUE * self.byte_ns:
                self.overruns += len(part)
                continue
            start_ns = max(self._host_ns, now_ns)
            self._host_ns = start_ns + len(part) * self.byte_ns
            if self._half_duplex and start_ns < self._device_ns:
                self._collide(start_ns)
                hit = min(-((start_ns - self._device_ns) // self.byte_ns), len(part))
                part = _flipped(part[:hit]) + part[hit:]
            self._coming.append((self._host_ns, part))

    def send(self, data: bytes, at_ns: int) -> None:
        """Send bytes of the devices from a time [ns]; faults treat them as one message."""
        data = self.to_host(data)
        start_ns = max(at_ns, self._device_ns)
        if self._half_duplex and start_ns < self._host_ns:
            self.collisions += 1
            self._coming = deque((end_ns, _flipped(part)) for end_ns, part in self._coming)
            data = _flipped(data)
        size = max(_PIECE_NS // self.byte_ns, 1)
        for first in range(0, len(data), size):
            piece = data[first : first + size]
            start_ns += len(piece) * self.byte_ns
            self._going.append((start_ns, piece))
        self._device_ns = start_ns

    def due_ns(self) -> int | None:
        """Return the time [ns] of the next event on the line, or None."""
        heads = [queue[0][0] for queue in (self._coming, self._going) if queue]
        if self.station is not None and self.station.act_ns is not None:
            heads.append(self.station.act_ns)
        return min(heads, default=None)

    def step(self, now_ns: int) -> None:
        """Process the one event that is due at a time [ns]."""
        if self._coming and self._coming[0][0] <= now_ns:
            end_ns, part = self._coming.popleft()
            if self.station is not None:
                self.station.receive(part, end_ns)
        elif self._going and self._going[0][0] <= now_ns:
            self.output += self._going.popleft()[1]
        elif self.station is not None and self.station.act_ns is not None and self.station.act_ns <= now_ns:
            self.station.act(self.station.act_ns)

    def _collide(self, start_ns: int) -> None:
        self.collisions += 1
        self._going = deque(
            (end_ns, _flipped(piece) if end_ns > start_ns else piece) for end_ns, piece in self._going
        )


def _flipped(data: bytes) -> bytes:
    return bytes(byte ^ _COLLISION for byte in data)
