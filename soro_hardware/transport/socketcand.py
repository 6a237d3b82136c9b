"""CAN over TCP from a socketcand server, as a python-can bus.

The client of python-can (4.6.1) waits ten seconds for a missing server and without end for one that says
nothing or takes no bytes, reads a lost server as silence, returns the frame before a malformed one again and
again, and sends a remote frame as a data frame. Without TCP_NODELAY and quick acknowledgements a cycle of
twelve nodes takes 44 ms.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections import deque

import can

from soro_core.errors import HardwareError
from soro_hardware.error_text import reason
from soro_hardware.transport.config import SocketcandTransport
from soro_hardware.transport.error_frames import BUS_OFF, RESTARTED, letters
from soro_hardware.transport.frame import Frame
from soro_hardware.transport.socketcand_codec import SocketcandDecoder, WireError, Word, encode_send
from soro_hardware.transport.stream import StreamBus

# The server answers this command; it does not answer a frame.
_ECHO = b"< echo >"


class SocketcandBus(StreamBus):
    """python-can bus on a socketcand server.

    Parameters
    ----------
    host : str
        Name or address of the server.
    port : int
        Its TCP port.
    channel : str
        Its name of the bus.
    timeout_s : float
        Longest time to an answer [s].

    Raises
    ------
    HardwareError
        If no server answers or it does not open the bus; in the methods, if the server is lost.
    """

    def __init__(self, host: str, port: int, channel: str, timeout_s: float = 1.0) -> None:
        super().__init__(f"socketcand {host}:{port} {channel}", timeout_s)
        self._bus_off = False
        self._decoder = SocketcandDecoder()
        self._words: deque[str] = deque()
        try:
            self._socket = socket.create_connection((host, port), timeout_s)
        except OSError as error:
            text = f"no socketcand server answers ({reason(error)})"
            raise HardwareError(text, self.channel_info, "open") from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.attach(self._socket.fileno())
        try:
            self._expect("hi", "greet")
            for command in (f"open {channel}", "rawmode"):
                self.write(f"< {command} >".encode())
                self._expect("ok", command)
        except HardwareError:
            self.release()
            raise
        can.BusABC.__init__(self, channel)

    @classmethod
    def from_transport(cls, transport: SocketcandTransport) -> SocketcandBus:
        """Connect to the server of a platform."""
        if transport.host is None:
            raise HardwareError(
                "no server named: give transport.host, or an endpoint host:port", "socketcand", "setting"
            )
        return cls(transport.host, transport.port, transport.channel, transport.open_timeout_s)

    @property
    def frames_garbled(self) -> int:
        return self._decoder.garbled

    @property
    def state(self) -> can.BusState:
        """State of the server's controller: ERROR after a report of bus-off."""
        return can.BusState.ERROR if self._bus_off else can.BusState.ACTIVE

    def encode(self, frame: Frame) -> bytes:
        if frame.remote:
            raise HardwareError("socketcand sends no remote frames", self.channel_info, "refused")
        return encode_send(frame) + (_ECHO if self.lockstep else b"")

    def take(self, chunk: bytes) -> None:
        for message in self._decoder.feed(chunk):
            if isinstance(message, Frame):
                self._frames.append(message)
            elif isinstance(message, WireError):
                self.bus_errors.update(letters(message.classes))
                if message.classes & (BUS_OFF | RESTARTED):
                    self._bus_off = bool(message.classes & BUS_OFF)
            elif isinstance(message, Word):
                if message.text == "echo":
                    self.acknowledged()
                else:
                    self._words.append(message.text)

    def after_read(self) -> None:
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)

    def close_descriptor(self) -> None:
        self._socket.close()

    def _expect(self, word: str, what: str) -> None:
        if not self.read_until(lambda: self._words, time.monotonic() + self._timeout_s):
            raise HardwareError(f"the server did not answer ({what})", self.channel_info, "silent")
        found = self._words.popleft()
        if found != word:
            raise HardwareError(f"the server refused ({what}): {found}", self.channel_info, "refused")
