"""CAN over LAWICEL ASCII (slcan) on a serial port or a pseudo-terminal, as a python-can bus.

It reads in chunks and without a thread: whoever wants frames polls the file descriptor. So nothing can die
unnoticed between two cycles, an unplugged adapter raises in the very call that touches it, the order of
events is that of the bytes, and no lock or hand-over costs time in the control loop. (python-can's own slcan
reads byte by byte and its receive thread ends at the first malformed line.)
"""

from __future__ import annotations

import contextlib
import os
import select
import termios
import time
from collections import Counter, deque
from collections.abc import Iterable
from typing import TYPE_CHECKING

import can
import serial

from soro_core.errors import HardwareError
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.link import from_message, to_message
from soro_core.hardware.transport.slcan_codec import SPEEDS, BusErrors, Decoder, Health, Reply, encode

if TYPE_CHECKING:
    from soro_core.hardware.platform import SlcanTransport

_STATES = {
    "active": can.BusState.ACTIVE,
    "warning": can.BusState.ACTIVE,
    "passive": can.BusState.PASSIVE,
    "bus_off": can.BusState.ERROR,
}
_CHUNK = 65536


class SlcanBus(can.BusABC):  # type: ignore[misc]
    """python-can bus on an slcan adapter.

    Parameters
    ----------
    channel : str
        Path of the serial port or pseudo-terminal.
    bitrate : int
        CAN bit rate [bit/s].
    serial_baud : int
        Baud rate of the serial port; without effect on a pseudo-terminal and on USB adapters.
    timeout_s : float
        Time in which the adapter must answer a command, or take the bytes of a frame.

    Raises
    ------
    HardwareError
        If the port cannot be opened or the adapter does not open the bus; later by every call that finds the
        adapter gone.
    """

    def __init__(
        self, channel: str, bitrate: int, serial_baud: int = 1_000_000, timeout_s: float = 1.0
    ) -> None:
        self.channel_info = channel
        self.health = Health("active", 0, 0)
        self.bus_errors: Counter[str] = Counter()
        self.frames_refused = 0
        self._timeout_s = timeout_s
        self._running = False
        self._decoder = Decoder()
        self._frames: deque[Frame] = deque()
        self._replies: deque[Reply] = deque()
        try:
            # pyserial sets raw mode and any baud rate; the bytes then go through the descriptor. Modem lines
            # are never read: a pseudo-terminal has none.
            self._port = serial.Serial(channel, serial_baud, timeout=0)
        except (OSError, serial.SerialException, ValueError, termios.error) as error:
            raise HardwareError(f"{channel}: cannot open the adapter's port ({error})") from None
        self._fd: int = self._port.fileno()
        os.set_blocking(self._fd, False)
        # With VMIN = 1 "nothing yet" is EAGAIN, so that an empty read always means that the adapter is gone.
        attributes = termios.tcgetattr(self._fd)
        attributes[6][termios.VMIN] = 1
        termios.tcsetattr(self._fd, termios.TCSANOW, attributes)
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        try:
            self._start(SPEEDS[bitrate])
        except HardwareError:
            self._port.close()
            raise
        self._running = True
        super().__init__(channel)

    @classmethod
    def from_transport(cls, transport: SlcanTransport, endpoint: str | None = None) -> SlcanBus:
        """Open the adapter of a platform; `endpoint` takes the place of its device."""
        device = endpoint or transport.device
        if device is None:
            raise HardwareError(
                "slcan: no adapter named: give transport.device in the platform, or an endpoint"
            )
        return cls(device, transport.bitrate, transport.serial_baud, transport.open_timeout_s)

    @property
    def frames_garbled(self) -> int:
        """Malformed lines dropped so far."""
        return self._decoder.garbled

    @property
    def state(self) -> can.BusState:
        """State of the CAN controller as the adapter last reported it."""
        return _STATES[self.health.state]

    def fileno(self) -> int:
        """File descriptor of the port."""
        return self._fd

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send one frame."""
        self.send_frames([from_message(msg)])

    def send_frames(self, frames: Iterable[Frame]) -> None:
        """Send frames in one write: on USB adapters one transfer in place of many."""
        self._write(b"".join(map(encode, frames)))

    def recv_frame(self, timeout_s: float) -> Frame | None:
        """Take the next frame, waiting at most `timeout_s` (0: only what has already come)."""
        if not self._frames:
            self._fill()
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
        """Close the bus and the port; safe to call again."""
        if not self._is_shutdown:
            super().shutdown()
            with contextlib.suppress(HardwareError):
                self._write(b"C\r")
            with contextlib.suppress(OSError, serial.SerialException, termios.error):
                self._port.close()

    def _start(self, speed: int) -> None:
        # The empty lines end whatever half command a former owner left; a closed adapter may refuse C.
        self._write(b"\r\rC\r")
        self._drain(0.02)
        self._decoder.reset()
        self._frames.clear()
        for command, what in ((b"S%d\r" % speed, "set the bit rate"), (b"O\r", "open the bus")):
            self._replies.clear()
            self._write(command)
            self._confirm(command, what)

    def _confirm(self, command: bytes, what: str) -> None:
        deadline = time.monotonic() + self._timeout_s
        while not self._replies:
            left = deadline - time.monotonic()
            if left <= 0:
                raise HardwareError(f"{self.channel_info}: the adapter did not answer {command!r} ({what})")
            self._poll.poll(1e3 * left)
            self._fill()
        if not self._replies.popleft().ok:
            raise HardwareError(f"{self.channel_info}: the adapter refused {command!r} ({what})")

    def _drain(self, quiet_s: float) -> None:
        deadline = time.monotonic() + self._timeout_s
        while self._poll.poll(1e3 * quiet_s) and time.monotonic() < deadline:
            self._fill()

    def _wait(self, timeout_s: float) -> None:
        deadline = time.monotonic() + timeout_s
        while not self._frames and (left := deadline - time.monotonic()) > 0:
            self._poll.poll(1e3 * left)
            self._fill()

    def _fill(self) -> None:
        """Read what has come. A port that is gone reads as end of file or EIO."""
        try:
            chunk = os.read(self._fd, _CHUNK)
        except BlockingIOError:
            return
        except OSError as error:
            raise HardwareError(f"{self.channel_info}: the adapter is gone ({error.strerror})") from None
        if not chunk:
            raise HardwareError(f"{self.channel_info}: the adapter is gone (end of file)")
        for event in self._decoder.feed(chunk):
            if isinstance(event, Frame):
                self._frames.append(event)
            elif isinstance(event, Reply):
                self._replies.append(event)
                self.frames_refused += self._running and not event.ok
            elif isinstance(event, Health):
                self.health = event
            elif isinstance(event, BusErrors):
                self.bus_errors.update(event.codes)
        # Replies are of interest while a command waits for one; a running bus acknowledges every frame.
        while len(self._replies) > 16:
            self._replies.popleft()

    def _write(self, data: bytes) -> None:
        deadline = time.monotonic() + self._timeout_s
        while data:
            try:
                data = data[os.write(self._fd, data) :]
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise HardwareError(f"{self.channel_info}: the adapter takes no more bytes") from None
                select.select([], [self._fd], [], 0.01)
            except OSError as error:
                raise HardwareError(f"{self.channel_info}: the adapter is gone ({error.strerror})") from None
