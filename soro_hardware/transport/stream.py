"""Base of soro's own CAN buses over byte streams (slcan, socketcand).

They read in chunks and without a thread: the reader of frames polls the file descriptor. So an unplugged
adapter raises in the next call, events have the order of the bytes, and the control loop needs no locks.
"""

from __future__ import annotations

import contextlib
import os
import select
import time
from abc import abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Iterable

import can

from soro_core.errors import HardwareError
from soro_hardware.error_text import reason
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.link import from_message, to_message

CHUNK = 65536


class StreamBus(can.BusABC):  # type: ignore[misc]
    """python-can bus on a file descriptor, which the derived class opens and closes.

    Parameters
    ----------
    channel_info : str
        Name of the adapter in errors.
    timeout_s : float
        Longest time in which the adapter answers a command, or accepts the bytes of a frame [s].

    Attributes
    ----------
    lockstep : bool
        Whether the adapter is an emulated one in lockstep, which acknowledges a frame after all answers to
        it: so after the acknowledgement there is nothing to wait for.
    """

    lockstep = False

    def __init__(self, channel_info: str, timeout_s: float) -> None:
        self.channel_info = channel_info
        self.bus_errors: Counter[str] = Counter()
        self.frames_refused = 0
        self._timeout_s = timeout_s
        self._frames: deque[Frame] = deque()
        self._unacknowledged = 0
        self._poll = select.poll()
        self._fd = -1

    def attach(self, fd: int) -> None:
        """Set the descriptor, with non-blocking reads and writes."""
        self._fd = fd
        os.set_blocking(fd, False)
        self._poll.register(fd, select.POLLIN)

    @property
    @abstractmethod
    def frames_garbled(self) -> int:
        """Number of malformed lines, which were dropped."""

    @abstractmethod
    def encode(self, frame: Frame) -> bytes:
        """Return the bytes that send a frame, with a request to acknowledge it if possible."""

    @abstractmethod
    def take(self, chunk: bytes) -> None:
        """Process bytes from the adapter."""

    @abstractmethod
    def close_descriptor(self) -> None:
        """Close the descriptor; may raise OSError."""

    def acknowledged(self) -> None:
        """Count an acknowledgement of the adapter."""
        self._unacknowledged = max(self._unacknowledged - 1, 0)

    def after_read(self) -> None:
        """Prepare the stream for the next read."""

    def fileno(self) -> int:
        """Return the file descriptor of the stream."""
        return self._fd

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one frame."""
        self.send_frames([from_message(msg)])

    def send_frames(self, frames: Iterable[Frame]) -> None:
        """Send frames in one write, which is one transfer to a USB adapter."""
        messages = [self.encode(frame) for frame in frames]
        self.write(b"".join(messages))
        self._unacknowledged += len(messages) if self.lockstep else 0

    def recv_frame(self, timeout_s: float) -> Frame | None:
        """Return the next frame, or None after `timeout_s` [s]."""
        if not self._frames:
            self.fill()
            if not self._frames and timeout_s > 0:
                self._wait(timeout_s)
        return self._frames.popleft() if self._frames else None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        frame = self.recv_frame(3600.0 if timeout is None else timeout)
        if frame is None:
            return None, False
        message = to_message(frame)
        message.timestamp, message.channel = time.time(), self.channel_info
        return message, False

    def shutdown(self) -> None:
        """Close the bus and its descriptor; idempotent."""
        if not self._is_shutdown:
            super().shutdown()
            with contextlib.suppress(HardwareError):
                self.write(self.farewell)
            self.release()

    farewell = b""

    def release(self) -> None:
        """Close and reset the descriptor, whose number another file may get."""
        with contextlib.suppress(OSError):
            self.close_descriptor()
        self._fd, self._is_shutdown = -1, True

    def poll(self, timeout_s: float) -> bool:
        """Wait until there are bytes to read, at most `timeout_s` [s]."""
        return bool(self._poll.poll(1e3 * timeout_s))

    def fill(self) -> None:
        """Read the received bytes; raises `HardwareError` if the adapter is lost."""
        try:
            chunk = os.read(self._fd, CHUNK)
        except BlockingIOError:
            return
        except OSError as error:
            raise self.gone(reason(error)) from None
        if not chunk:
            raise self.gone("end of file")
        self.after_read()
        self.take(chunk)

    def gone(self, why: str) -> HardwareError:
        """Return the error of a lost adapter."""
        return HardwareError(f"the adapter is gone ({why})", self.channel_info, "gone")

    def write(self, data: bytes) -> None:
        """Write all bytes, with a wait for a slow adapter."""
        deadline = time.monotonic() + self._timeout_s
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise HardwareError(
                        "the adapter takes no more bytes", self.channel_info, "gone"
                    ) from None
                select.select([], [self._fd], [], 0.01)
            except OSError as error:
                raise self.gone(reason(error)) from None

    def read_until(self, is_there: Callable[[], object], deadline_s: float) -> bool:
        """Read until `is_there`, at most until a time of `time.monotonic`; return whether it is."""
        while not is_there():
            if (left_s := deadline_s - time.monotonic()) <= 0:
                return False
            self.poll(left_s)
            self.fill()
        return True

    def _wait(self, timeout_s: float) -> None:
        def is_there() -> object:
            return self._frames or (self.lockstep and not self._unacknowledged)

        if not self.read_until(is_there, time.monotonic() + timeout_s) and timeout_s >= self._timeout_s:
            self._unacknowledged = 0  # a lost acknowledgement
