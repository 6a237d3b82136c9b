"""Protocol of socketcand in raw mode as pure functions: text in angle brackets; no input raises an error.

Host to server: ``< open can0 >``, ``< rawmode >``, ``< send 201 4 7 0 D0 7 >``. Server to host: ``< hi >``,
``< ok >``, ``< frame 181 12.345678 0F01D007 >``, ``< error 20000040 12.345678 >``. An identifier of three
digits is a standard one, of eight an extended one; remote frames do not exist.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TypeAlias

from soro_hardware.transport.frame import Frame

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
