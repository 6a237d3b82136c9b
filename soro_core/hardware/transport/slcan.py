"""CAN over LAWICEL ASCII (slcan) on a serial port or a pseudo-terminal, as a python-can bus.

(python-can's own slcan reads byte by byte and its receive thread ends at the first malformed line.)
"""

from __future__ import annotations

import contextlib
import termios
import time
from collections import deque

import can
import serial

from soro_core.errors import HardwareError
from soro_core.hardware.reason import reason
from soro_core.hardware.transport.config import SlcanTransport
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.slcan_codec import SPEEDS, BusErrors, Decoder, Health, Reply, encode
from soro_core.hardware.transport.stream import StreamBus

_STATES = {
    "active": can.BusState.ACTIVE,
    "warning": can.BusState.ACTIVE,
    "passive": can.BusState.PASSIVE,
    "bus_off": can.BusState.ERROR,
}


class SlcanBus(StreamBus):
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

    farewell = b"C\r"

    def __init__(
        self, channel: str, bitrate: int, serial_baud: int = 1_000_000, timeout_s: float = 1.0
    ) -> None:
        super().__init__(channel, timeout_s)
        self.health = Health("active", 0, 0)
        self._running = False
        self._decoder = Decoder()
        self._replies: deque[Reply] = deque()
        try:
            # pyserial sets raw mode and any baud rate; the bytes then go through the descriptor. Modem lines
            # are never read: a pseudo-terminal has none.
            # A second program on the port would take the adapter off the bus under the first one's feet.
            self._port = serial.Serial(channel, serial_baud, timeout=0, exclusive=True)
        except (OSError, serial.SerialException, ValueError, termios.error) as error:
            raise HardwareError(f"{channel}: cannot open the adapter's port ({reason(error)})") from None
        self.attach(self._port.fileno())
        # With VMIN = 1 "nothing yet" is EAGAIN, so that an empty read always means that the adapter is gone.
        attributes = termios.tcgetattr(self.fileno())
        attributes[6][termios.VMIN] = 1
        termios.tcsetattr(self.fileno(), termios.TCSANOW, attributes)
        try:
            self._start(SPEEDS[bitrate])
        except HardwareError:
            self.release()
            raise
        self._running = True
        can.BusABC.__init__(self, channel)

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
        return self._decoder.garbled

    @property
    def state(self) -> can.BusState:
        """State of the CAN controller as the adapter last reported it."""
        return _STATES[self.health.state]

    def encode(self, frame: Frame) -> bytes:
        return encode(frame)

    def take(self, chunk: bytes) -> None:
        for event in self._decoder.feed(chunk):
            if isinstance(event, Frame):
                self._frames.append(event)
            elif isinstance(event, Reply):
                self._replies.append(event)
                self.acknowledged()
                self.frames_refused += self._running and not event.ok
            elif isinstance(event, Health):
                self.health = event
            elif isinstance(event, BusErrors):
                self.bus_errors.update(event.codes)
        # Replies are of interest while a command waits for one; a running bus acknowledges every frame.
        while len(self._replies) > 16:
            self._replies.popleft()

    def let_go(self) -> None:
        with contextlib.suppress(serial.SerialException, termios.error):
            self._port.close()

    def _start(self, speed: int) -> None:
        # The empty lines end whatever half command a former owner left; a closed adapter may refuse C.
        self.write(b"\r\rC\r")
        self._drain(0.02)
        self._decoder.reset()
        self._frames.clear()
        for command, what in ((b"S%d\r" % speed, "set the bit rate"), (b"O\r", "open the bus")):
            self._replies.clear()
            self.write(command)
            self._confirm(command, what)

    def _confirm(self, command: bytes, what: str) -> None:
        deadline = time.monotonic() + self._timeout_s
        while not self._replies:
            left = deadline - time.monotonic()
            if left <= 0:
                raise HardwareError(f"{self.channel_info}: the adapter did not answer {command!r} ({what})")
            self.poll(left)
            self.fill()
        if not self._replies.popleft().ok:
            raise HardwareError(f"{self.channel_info}: the adapter refused {command!r} ({what})")

    def _drain(self, quiet_s: float) -> None:
        deadline = time.monotonic() + self._timeout_s
        while self.poll(quiet_s) and time.monotonic() < deadline:
            self.fill()
