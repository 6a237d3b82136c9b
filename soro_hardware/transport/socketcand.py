"""CAN over TCP from a socketcand server, as a python-can bus.

The client of python-can (4.6.1) waits ten seconds for a missing server and without end for one that says
nothing or takes no bytes, reads a lost server as silence, returns the frame before a malformed one again and
again, and sends a remote frame as a data frame. Without TCP_NODELAY and quick acknowledgements a cycle of
twelve nodes takes 44 ms.

The protocol, in raw mode, is text in angle brackets; decoding and encoding are pure and never raise.
Host to server: ``< open can0 >``, ``< rawmode >``, ``< send 201 4 7 0 D0 7 >``. Server to host: ``< hi >``,
``< ok >``, ``< frame 181 12.345678 0F01D007 >``, ``< error 20000040 12.345678 >``. An identifier of three
digits is a standard one, of eight an extended one; remote frames do not exist.
"""

from __future__ import annotations

import contextlib
import re
import socket
import time
from collections import deque
from dataclasses import dataclass
from typing import TypeAlias

import can

from soro_core.errors import HardwareError
from soro_hardware.error_text import reason
from soro_hardware.transport.config import SocketcandTransport
from soro_hardware.transport.frame import BUS_OFF, RESTARTED, Frame, letters
from soro_hardware.transport.stream import StreamBus

LONGEST = 200  # characters of one message; the longest good one is a frame with eight bytes

_FRAME = re.compile(r"frame ([0-7][0-9A-F]{2}|[01][0-9A-F]{7}) [0-9]+\.[0-9]+ ?((?:[0-9A-F]{2}){0,8})", re.I)
_SEND = re.compile(r"send ([0-7][0-9A-F]{2}|[01][0-9A-F]{7}) ([0-8])((?: [0-9A-F]{1,2})*)", re.I)
_ERROR = re.compile(r"error ([0-9A-F]{3,8}) [0-9]+\.[0-9]+", re.I)


@dataclass(frozen=True)
class WireError:
    """An error frame of the kernel: `classes` are the bits of linux/can/error.h."""

    classes: int


@dataclass(frozen=True)
class Word:
    """Anything else in angle brackets: ``hi``, ``ok``, ``open can0``, ``rawmode``, ..."""

    text: str


Message: TypeAlias = Frame | WireError | Word


def encode_send(frame: Frame) -> bytes:
    """Return the message with which the server sends a frame."""
    data = "".join(f" {byte:X}" for byte in frame.data)
    return f"< send {_identifier(frame)} {frame.dlc}{data} >".encode()


def encode_frame(frame: Frame, now_ns: int) -> bytes:
    """Return the message to the host with a frame."""
    stamp = f"{now_ns // 1_000_000_000}.{now_ns % 1_000_000_000 // 1000:06d}"
    return f"< frame {_identifier(frame)} {stamp} {frame.data.hex().upper()} >".encode()


def encode_error(classes: int, now_ns: int) -> bytes:
    """Return the message to the host with an error frame."""
    stamp = f"{now_ns // 1_000_000_000}.{now_ns % 1_000_000_000 // 1000:06d}"
    return f"< error {classes | 0x2000_0000:08X} {stamp} >".encode()


class SocketcandDecoder:
    """Splits a byte stream into messages; malformed ones are counted and dropped."""

    def __init__(self) -> None:
        self.garbled = 0
        self._rest = b""

    def feed(self, chunk: bytes) -> list[Message]:
        """Return the messages completed by `chunk`, in order."""
        *parts, self._rest = (self._rest + chunk).split(b">")
        messages = []
        for part in parts:
            before, bracket, text = part.rpartition(b"<")
            self.garbled += bool(before.strip())
            message = _decode(text) if bracket else None
            if message is None:
                self.garbled += 1
            else:
                messages.append(message)
        if len(self._rest) > LONGEST:
            self.garbled, self._rest = self.garbled + 1, b""
        return messages


def _identifier(frame: Frame) -> str:
    return f"{frame.can_id:08X}" if frame.extended else f"{frame.can_id:03X}"


def _decode(raw: bytes) -> Message | None:
    try:
        text = raw.decode("ascii").strip()
    except UnicodeDecodeError:
        return None
    if match := _FRAME.fullmatch(text):
        return Frame(int(match[1], 16), bytes.fromhex(match[2]), len(match[1]) == 8)
    if match := _SEND.fullmatch(text):
        data = bytes(int(digits, 16) for digits in match[3].split())
        return Frame(int(match[1], 16), data, len(match[1]) == 8) if len(data) == int(match[2]) else None
    if match := _ERROR.fullmatch(text):
        return WireError(int(match[1], 16) & 0x1FFF_FFFF)
    if re.fullmatch(r"(hi|ok|echo|rawmode|open [\w.-]{1,15}|error .{1,80})", text):
        return Word(text)
    return None


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
