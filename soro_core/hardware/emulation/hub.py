"""The emulated wire: arbitration by identifier, one frame at a time, each as long as its bits take."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from soro_core.hardware.transport.frame import Frame, frame_bits

QUEUE_LENGTH = 256  # frames that a port holds; further ones are lost, as in a full transmit buffer


class _Sending(NamedTuple):
    frame: Frame
    port: Port
    end_ns: int


class Port:
    """One participant: a queue of frames to send, and a function that takes what the others send."""

    def __init__(self, receive: Callable[[Frame, int], None]) -> None:
        self.receive = receive
        self.queue: deque[tuple[int, Frame]] = deque()
        self.overruns = 0


class Hub:
    """A CAN bus.

    Parameters
    ----------
    bitrate : int
        Bit rate [bit/s] that paces the frames; 0 for frames that take no time (lockstep).
    """

    def __init__(self, bitrate: int) -> None:
        self._bitrate = bitrate
        self._ports: list[Port] = []
        self._sending: _Sending | None = None
        self._idle_ns = 0
        self.frames = 0

    def attach(self, receive: Callable[[Frame, int], None]) -> Port:
        """Add a participant; `receive(frame, time_ns)` is called at the end of every frame of another one."""
        port = Port(receive)
        self._ports.append(port)
        return port

    def send(self, port: Port, frame: Frame, now_ns: int) -> None:
        """Queue a frame."""
        if len(port.queue) >= QUEUE_LENGTH:
            port.overruns += 1
        else:
            port.queue.append((now_ns, frame))

    def run(self, now_ns: int) -> None:
        """Carry everything that ends by now."""
        while True:
            if self._sending is None:
                self._arbitrate()
            sending = self._sending
            if sending is None or sending.end_ns > now_ns:
                return
            self._sending, self._idle_ns = None, sending.end_ns
            self.frames += 1
            for port in self._ports:
                if port is not sending.port:
                    port.receive(sending.frame, sending.end_ns)

    @property
    def next_event_ns(self) -> int | None:
        """End of the frame on the wire, or None while the bus is idle."""
        return self._sending.end_ns if self._sending else None

    def _arbitrate(self) -> None:
        waiting = [port for port in self._ports if port.queue]
        if not waiting:
            return
        start = max(self._idle_ns, min(port.queue[0][0] for port in waiting))
        # Of those that are ready when the wire becomes free the lowest identifier wins; a standard frame wins
        # over an extended one with the same leading bits, a data frame over a remote one.
        port = min((p for p in waiting if p.queue[0][0] <= start), key=lambda p: _priority(p.queue[0][1]))
        _, frame = port.queue.popleft()
        duration = frame_bits(frame) * 1_000_000_000 // self._bitrate if self._bitrate else 0
        self._sending = _Sending(frame, port, start + duration)


def _priority(frame: Frame) -> tuple[int, bool, int, bool]:
    leading = frame.can_id >> 18 if frame.extended else frame.can_id
    return leading, frame.extended, frame.can_id, frame.remote
