"""CAN over TCP from a socketcand server, as a python-can bus.

python-can's own client waits ten seconds for a server that is not there, and takes a server that has gone for
a silent bus. Without TCP_NODELAY and quick acknowledgements a cycle of twelve nodes takes 44 ms.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections import deque

import can

from soro_core.errors import HardwareError
from soro_core.hardware.reason import reason
from soro_core.hardware.transport.config import SocketcandTransport
from soro_core.hardware.transport.error_frames import BUS_OFF, RESTARTED, letters
from soro_core.hardware.transport.frame import Frame
from soro_core.hardware.transport.socketcand_codec import Decoder, WireError, Word, encode_send
from soro_core.hardware.transport.stream import StreamBus

# The server answers it, and a frame it does not.
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
        Time in which it must answer.

    Raises
    ------
    HardwareError
        If there is no server or it does not open the bus; later by every call that finds it gone.
    """

    def __init__(self, host: str, port: int, channel: str, timeout_s: float = 1.0) -> None:
        super().__init__(f"socketcand {host}:{port} {channel}", timeout_s)
        self._bus_off = False
        self._decoder = Decoder()
        self._words: deque[str] = deque()
        try:
            self._socket = socket.create_connection((host, port), timeout_s)
        except OSError as error:
            raise HardwareError(
                f"{self.channel_info}: no socketcand server answers ({reason(error)})"
            ) from None
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
    def from_transport(cls, transport: SocketcandTransport, endpoint: str | None = None) -> SocketcandBus:
        """Connect to the server of a platform; `endpoint` (host:port) takes the place of its address."""
        address = endpoint or transport.address
        if address is None:
            raise HardwareError("socketcand: no server named: give transport.host, or an endpoint host:port")
        host, _, port = address.rpartition(":")
        if not host or not port.isdigit() or not 0 < int(port) < 65536:
            raise HardwareError(f"socketcand: {address!r} is no address of the form host:port")
        return cls(host, int(port), transport.channel, transport.open_timeout_s)

    @property
    def frames_garbled(self) -> int:
        return self._decoder.garbled

    @property
    def state(self) -> can.BusState:
        """Whether the server has reported that its controller is off the bus."""
        return can.BusState.ERROR if self._bus_off else can.BusState.ACTIVE

    def encode(self, frame: Frame) -> bytes:
        if frame.remote:
            raise HardwareError(f"{self.channel_info}: socketcand sends no remote frames")
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

    def let_go(self) -> None:
        self._socket.close()

    def _expect(self, word: str, what: str) -> None:
        deadline = time.monotonic() + self._timeout_s
        while not self._words:
            left = deadline - time.monotonic()
            if left <= 0:
                raise HardwareError(f"{self.channel_info}: the server did not answer ({what})")
            self.poll(left)
            self.fill()
        found = self._words.popleft()
        if found != word:
            raise HardwareError(f"{self.channel_info}: the server refused ({what}): {found}")
