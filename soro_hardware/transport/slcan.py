"""CAN over LAWICEL ASCII (slcan) on a serial port or a pseudo-terminal, as a python-can bus.

(python-can's own slcan reads byte by byte and its receive thread ends at the first malformed line.)

An adapter acknowledges each command, except a CANable with its stock firmware, which answers only V. The bus
detects this when it is opened; it cannot detect frames that such an adapter loses.

An adapter keeps settings of its last owner, some of them without power (LAWICEL CAN232 and CANUSB: time
stamps, delivery of frames on request only, acceptance filter, open or listening): opening sets each of them.
"""

from __future__ import annotations

import contextlib
import re
import termios
import time
from collections import deque

import can
import serial

from soro_core.errors import HardwareError
from soro_hardware.transport.config import SlcanTransport
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.serial_port import open_serial
from soro_hardware.transport.slcan_codec import SPEEDS, BusErrors, Health, Reply, SlcanDecoder, encode
from soro_hardware.transport.stream import StreamBus

_STATES = {
    "active": can.BusState.ACTIVE,
    "warning": can.BusState.ACTIVE,
    "passive": can.BusState.PASSIVE,
    "bus_off": can.BusState.ERROR,
}


# Longest time to an acknowledgement [s]; after it the bus tests whether the adapter never acknowledges.
_ACKNOWLEDGED_S = 0.25
# Time stamps off, frames without request, acceptance code and mask of every frame. A closed adapter takes
# them once it has its bit rate; one that does not know them answers BEL, or nothing.
_SETTINGS = (b"Z0\r", b"X1\r", b"M00000000\r", b"mFFFFFFFF\r")
# Of a version: text, as "b158aa7 https://github.com/normaldotcom/canable-fw.git".
_VERSION = re.compile(rb"[\x20-\x7e]{2,}")


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
        Longest time in which the adapter answers a command, or accepts the bytes of a frame [s].
    acknowledges : bool, optional
        Whether the adapter acknowledges commands; None to find out.

    Attributes
    ----------
    acknowledges : bool
        Whether the adapter acknowledges commands.

    Raises
    ------
    HardwareError
        If the port cannot be opened or the adapter does not open the bus; in the methods, if the adapter is
        lost.
    """

    farewell = b"C\r"
    encode = staticmethod(encode)

    def __init__(
        self,
        channel: str,
        bitrate: int,
        serial_baud: int = 1_000_000,
        timeout_s: float = 1.0,
        acknowledges: bool | None = None,
    ) -> None:
        super().__init__(channel, timeout_s)
        self.acknowledges = acknowledges is not False
        self.health = Health("active", 0, 0)
        self._running = False
        self._decoder = SlcanDecoder()
        self._replies: deque[Reply] = deque()
        self._line = b""  # received part of an answer to V
        # pyserial sets raw mode and any baud rate; the bytes then go through the descriptor. Modem lines are
        # never read: a pseudo-terminal has none. A second program on the port would close the bus that the
        # first one uses.
        self._port = open_serial(channel, serial_baud)
        self.attach(self._port.fileno())
        try:
            self._start(SPEEDS[bitrate], acknowledges)
        except HardwareError:
            self.release()
            raise
        self._running = True
        can.BusABC.__init__(self, channel)

    @classmethod
    def from_transport(cls, transport: SlcanTransport) -> SlcanBus:
        """Open the adapter of a platform."""
        if transport.device is None:
            text = "no adapter named: give transport.device in the platform, or an endpoint"
            raise HardwareError(text, "slcan", "setting")
        return cls(
            transport.device,
            transport.bitrate,
            transport.serial_baud,
            transport.open_timeout_s,
            transport.acknowledges,
        )

    @property
    def frames_garbled(self) -> int:
        return self._decoder.garbled

    @property
    def state(self) -> can.BusState:
        """State of the CAN controller as the adapter last reported it."""
        return _STATES[self.health.state]

    def take(self, chunk: bytes) -> None:
        self._line = b"" if self._running else (self._line + chunk)[-256:]
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

    def close_descriptor(self) -> None:
        with contextlib.suppress(serial.SerialException, termios.error):
            self._port.close()

    def _start(self, speed: int, acknowledges: bool | None) -> None:
        # The first C ends a half command that a former owner left; a closed adapter may refuse the second. No
        # empty lines: the CANable takes one for the last command over again.
        self.write(b"C\rC\r")
        self._drain(0.02)
        self._decoder.reset()
        self._frames.clear()
        self._command(b"S%d\r" % speed, "set the bit rate", acknowledges)
        if self.acknowledges:
            self.write(b"".join(_SETTINGS))
            self._replies.clear()
            all_there = time.monotonic() + _ACKNOWLEDGED_S
            self.read_until(lambda: len(self._replies) >= len(_SETTINGS), all_there)
        else:  # no more than this: the stock firmware of the CANable takes X for a frame to send
            self.write(_SETTINGS[0])
        self._command(b"O\r", "open the bus", self.acknowledges)
        self._decoder.garbled = 0  # a version is no garbled frame

    def _command(self, command: bytes, what: str, acknowledges: bool | None) -> None:
        """Send a command and wait for its acknowledgement; None: find out whether the adapter gives one."""
        deadline = time.monotonic() + self._timeout_s
        self._replies.clear()
        self._line = b""
        self.write(command)
        if acknowledges is None:
            acknowledges = self.acknowledges = self._acknowledges(deadline)
        if acknowledges:
            self._confirm(command, what, deadline)

    def _confirm(self, command: bytes, what: str, deadline: float) -> None:
        if not self.read_until(lambda: self._replies, deadline):
            raise HardwareError(
                f"the adapter did not answer {command!r} ({what}); "
                "if its firmware never answers, give transport.acknowledges: false",
                self.channel_info,
                "silent",
            )
        if command in self._line:
            text = "the adapter repeats what it is sent, so that own frames would count as received: echo off"
            raise HardwareError(text, self.channel_info, "setting")
        if not self._replies.popleft().ok:
            raise HardwareError(f"the adapter refused {command!r} ({what})", self.channel_info, "refused")

    def _acknowledges(self, deadline: float) -> bool:
        """Return whether the adapter acknowledges the last command; if not, test it with a V command."""
        if self.read_until(lambda: self._replies, min(time.monotonic() + _ACKNOWLEDGED_S, deadline)):
            return True
        self._line = b""
        self.write(b"V\r")
        self.read_until(lambda: self._replies or b"\r" in self._line, deadline)
        line, end, _ = self._line.partition(b"\r")
        return not end or _VERSION.fullmatch(line) is None  # an empty line is a late acknowledgement

    def _drain(self, quiet_s: float) -> None:
        deadline = time.monotonic() + self._timeout_s
        while self.poll(quiet_s) and time.monotonic() < deadline:
            self.fill()
