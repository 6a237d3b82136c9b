"""The drivers' interface to any python-can bus."""

from __future__ import annotations

import contextlib
import errno
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import NoReturn

import can

from soro_core.errors import HardwareError
from soro_hardware.error_text import reason
from soro_hardware.transport.frame import BUS_OFF, RESTARTED, Frame, letters

_FULL_TRIES, _FULL_WAIT_S = 20, 0.0005
# A bus of 1 Mbit/s carries at most 21,000 frames per second; after a longer stall the limiter has tripped.
_MOST_WAITING = 20_000


class CanLink:
    """Sends and receives frames on a python-can bus; every failure is a `HardwareError`.

    The counts continue after a reopening. A bus with `send_frames` and `recv_frame` (`StreamBus`) is used
    through them, with one write in each cycle.

    Parameters
    ----------
    open_bus : callable
        Opens the bus.
    """

    def __init__(self, open_bus: Callable[[], can.BusABC]) -> None:
        self.open_bus = open_bus
        self._bus: can.BusABC | None = None
        self._send_frames: Callable[[Sequence[Frame]], None] | None = None
        self._recv_frame: Callable[[float], Frame | None] | None = None
        self._closed_counts: Counter[str] = Counter()
        self._error_frames: Counter[str] = Counter()
        self._bus_off = False
        self.sent = 0
        self.received = 0

    @property
    def is_open(self) -> bool:
        """Whether a bus is open; it may have failed since."""
        return self._bus is not None

    @property
    def is_bus_off(self) -> bool:
        """Whether the controller is in bus-off."""
        if self._bus is None:
            return False
        return self._bus_off or bool(self._bus.state == can.BusState.ERROR)

    @property
    def bus(self) -> can.BusABC | None:
        """The open bus, or None."""
        return self._bus

    @property
    def counts(self) -> Counter[str]:
        """Counts of the adapter: garbled (malformed lines), refused (frames), errors (on the bus)."""
        errors = Counter(errors=sum(self._error_frames.values()))
        return self._closed_counts + self._bus_counts() + errors

    def open(self) -> None:
        """Close and open the bus, as an adapter needs it that was unplugged or in bus-off."""
        self.close()
        self._bus, self._bus_off = self.open_bus(), False
        self._send_frames = getattr(self._bus, "send_frames", None)
        self._recv_frame = getattr(self._bus, "recv_frame", None)

    def close(self) -> None:
        """Close the bus; never raises."""
        self._closed_counts += self._bus_counts()
        bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(Exception):
                bus.shutdown()

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in order."""
        bus = self._bus or _closed()
        try:
            if self._send_frames is not None:
                self._send_frames(frames)
            else:
                for frame in frames:
                    _send(bus, to_message(frame))
        except (can.CanError, OSError) as error:
            raise HardwareError(f"sending failed ({reason(error)})", bus.channel_info, "gone") from None
        self.sent += len(frames)

    def receive(self, timeout_s: float) -> Frame | None:
        """Return the next frame, or None after `timeout_s` [s]."""
        bus = self._bus or _closed()
        try:
            if self._recv_frame is not None:
                frame = self._recv_frame(timeout_s)
            else:
                message = bus.recv(timeout_s)
                while message is not None and message.is_error_frame:
                    self._on_error_frame(message)
                    message = bus.recv(0.0)
                frame = None if message is None else from_message(message)
        except (can.CanError, OSError) as error:
            raise HardwareError(f"receiving failed ({reason(error)})", bus.channel_info, "gone") from None
        self.received += frame is not None
        return frame

    def waiting(self) -> Iterator[Frame]:
        """Yield the received frames without waiting.

        Raises
        ------
        HardwareError
            If there are more frames than a bus carries, which would block the control loop.
        """
        for _ in range(_MOST_WAITING):
            if (frame := self.receive(0.0)) is None:
                return
            yield frame
        raise HardwareError(
            "more frames than a bus can carry", (self._bus or _closed()).channel_info, "flood"
        )

    def _on_error_frame(self, message: can.Message) -> None:
        """Process an error frame of the kernel."""
        classes = message.arbitration_id
        self._error_frames.update(letters(classes, bytes(message.data)) or "?")
        if classes & (BUS_OFF | RESTARTED):
            self._bus_off = bool(classes & BUS_OFF)

    def _bus_counts(self) -> Counter[str]:
        return Counter(
            garbled=getattr(self._bus, "frames_garbled", 0),
            refused=getattr(self._bus, "frames_refused", 0),
            errors=sum(getattr(self._bus, "bus_errors", {}).values()),
        )


def _closed() -> NoReturn:
    raise HardwareError("the bus is not open", code="order")


def _send(bus: can.BusABC, message: can.Message) -> None:
    """Send a message; if the kernel's transmit queue is full, wait for a place."""
    for _ in range(_FULL_TRIES):
        try:
            bus.send(message)
        except (can.CanError, OSError) as error:
            if errno.ENOBUFS not in (getattr(error, "errno", 0), getattr(error, "error_code", 0)):
                raise
            time.sleep(_FULL_WAIT_S)
        else:
            return
    bus.send(message)


def to_message(frame: Frame) -> can.Message:
    """Convert a frame to a message of python-can."""
    return can.Message(
        arbitration_id=frame.can_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        dlc=frame.dlc,
        data=None if frame.remote else frame.data,
    )


def from_message(message: can.Message) -> Frame:
    """Convert a message of python-can to a frame."""
    remote = message.is_remote_frame
    data = b"" if remote else bytes(message.data)
    return Frame(message.arbitration_id, data, message.is_extended_id, remote, message.dlc if remote else -1)
