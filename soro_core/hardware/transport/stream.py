"""What the own CAN buses over byte streams (slcan, socketcand) have in common.

They read in chunks and without a thread: whoever wants frames polls the file descriptor. So nothing can die
unnoticed between two cycles, an unplugged adapter raises in the very call that touches it, the order of
events is that of the bytes, and no lock or hand-over costs time in the control loop.
"""

from __future__ import annotations

import contextlib
import os
import select
import time
from abc import abstractmethod
from collections import Counter, deque
from collections.abc import Iterable

import can

from soro_core.errors import HardwareError
from soro_core.hardware.reason import reason
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.link import from_message, to_message

CHUNK = 65536


class StreamBus(can.BusABC):  # type: ignore[misc]
    """python-can bus on a file descriptor that is opened and closed by the derived class.

    Parameters
    ----------
    channel_info : str
        How errors name the adapter.
    timeout_s : float
        Time in which it must answer a command, or take the bytes of a frame.

    Attributes
    ----------
    lockstep : bool
        Whether an emulated adapter in lockstep is behind it. That one acknowledges a frame when everything
        that comes of it has been given: what has not come by then never comes, and is not waited for.
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
        """Use a descriptor from now on; reads and writes on it do not block."""
        self._fd = fd
        os.set_blocking(fd, False)
        self._poll.register(fd, select.POLLIN)

    @property
    @abstractmethod
    def frames_garbled(self) -> int:
        """Malformed lines dropped so far."""

    @abstractmethod
    def encode(self, frame: Frame) -> bytes:
        """Bytes that send a frame, and have the adapter acknowledge it where it can."""

    @abstractmethod
    def take(self, chunk: bytes) -> None:
        """Take bytes from the adapter."""

    @abstractmethod
    def let_go(self) -> None:
        """Close the descriptor; may raise OSError."""

    def acknowledged(self) -> None:
        """Note that the adapter has acknowledged a frame."""
        self._unacknowledged = max(self._unacknowledged - 1, 0)

    def after_read(self) -> None:
        """Do what the stream needs after bytes have come."""

    def fileno(self) -> int:
        """File descriptor of the stream."""
        return self._fd

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one frame."""
        self.send_frames([from_message(msg)])

    def send_frames(self, frames: Iterable[Frame]) -> None:
        """Send frames in one write: on USB adapters one transfer in place of many."""
        messages = [self.encode(frame) for frame in frames]
        self.write(b"".join(messages))
        self._unacknowledged += len(messages) if self.lockstep else 0

    def recv_frame(self, timeout_s: float) -> Frame | None:
        """Take the next frame, waiting at most `timeout_s` (0: only what has already come)."""
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
        """Close the bus and what it stands on; safe to call again."""
        if not self._is_shutdown:
            super().shutdown()
            with contextlib.suppress(HardwareError):
                self.write(self.farewell)
            self.release()

    farewell = b""

    def release(self) -> None:
        """Close the descriptor and forget it: its number may soon be another file's."""
        with contextlib.suppress(OSError):
            self.let_go()
        self._fd, self._is_shutdown = -1, True

    def poll(self, timeout_s: float) -> bool:
        """Wait until there are bytes to read."""
        return bool(self._poll.poll(1e3 * timeout_s))

    def fill(self) -> None:
        """Read what has come. A stream that is gone reads as end of file or as an error."""
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
        """Error of an adapter that is no longer there."""
        return HardwareError(f"{self.channel_info}: the adapter is gone ({why})")

    def write(self, data: bytes) -> None:
        """Write everything, waiting for a slow adapter."""
        deadline = time.monotonic() + self._timeout_s
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise HardwareError(f"{self.channel_info}: the adapter takes no more bytes") from None
                select.select([], [self._fd], [], 0.01)
            except OSError as error:
                raise self.gone(reason(error)) from None

    def _wait(self, timeout_s: float) -> None:
        deadline = time.monotonic() + timeout_s
        while not self._frames and not (self.lockstep and not self._unacknowledged):
            left = deadline - time.monotonic()
            if left <= 0:
                if timeout_s >= self._timeout_s:  # got lost on its way: it does not come any more
                    self._unacknowledged = 0
                return
            self.poll(left)
            self.fill()
