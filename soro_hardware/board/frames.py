"""Frames between the driver and `soro board`.

Every frame is, little-endian:

========  ====  ==========================================================
bytes     type  meaning
========  ====  ==========================================================
2               magic ``sB``
1         u8    version of this format, 2
1         u8    kind, see `FrameType`
2         u16   length of the payload
4         u32   sequence number
8         u64   number that the board drew for this connection and told in WELCOME; 0 in HELLO
length          payload
4         u32   CRC-32 (zlib) of everything before it
========  ====  ==========================================================

`soro_hardware.board.messages` defines the payloads. Version 1 had no number; only its refusal is sent.
"""

from __future__ import annotations

import enum
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

MAGIC = b"sB"
VERSION = 2
_HEADER = struct.Struct("<2sBBHIQ")
_FIRST_SIZE = struct.calcsize("<2sBBHI")  # of the header of version 1
_VERSION_AT = len(MAGIC)
_CRC = struct.Struct("<I")


class FrameType(enum.IntEnum):
    """Kind of a frame; kinds sent by the board have the highest bit set."""

    HELLO = 0x01
    SET = 0x02
    RESET = 0x03
    BYE = 0x04
    WELCOME = 0x81
    STATE = 0x82
    REFUSED = 0x83


@dataclass(frozen=True)
class BoardFrame:
    """One frame with the right CRC."""

    kind: FrameType
    sequence: int
    payload: bytes = b""
    number: int = 0


def encode(frame: BoardFrame, version: int = VERSION) -> bytes:
    """Return the bytes of a frame; for a host of version 1 they are those that it reads."""
    sequence = frame.sequence & 0xFFFFFFFF
    if version != 1:
        version = VERSION
    head = _HEADER.pack(MAGIC, version, frame.kind, len(frame.payload), sequence, frame.number)
    body = (head[:_FIRST_SIZE] if version == 1 else head) + frame.payload
    return body + _CRC.pack(zlib.crc32(body))


class BoardFrameDecoder:
    """Decodes frames from a byte stream; other bytes are dropped and counted.

    Parameters
    ----------
    lengths : mapping
        Length of the payload of each kind. A frame of another length is dropped at once, so that the decoder
        never waits for the bytes of a damaged length.

    Attributes
    ----------
    garbled : int
        Number of byte runs that were no frame.
    other_version : int or None
        Version of the newest frame of another version, which is dropped.
    """

    def __init__(self, lengths: Mapping[FrameType, int]) -> None:
        self._lengths = {int(kind): length for kind, length in lengths.items()}
        self._buffer = bytearray()
        self._in_garbage = False
        self.garbled = 0
        self.other_version: int | None = None

    def feed(self, chunk: bytes) -> list[BoardFrame]:
        """Process bytes; return the complete frames, oldest first."""
        self._buffer += chunk
        found: list[BoardFrame] = []
        while self._buffer:
            if start := self._noise():
                self._drop(start)
                continue
            if len(self._buffer) <= _VERSION_AT:
                break
            if (version := self._buffer[_VERSION_AT]) != VERSION:  # a short one of version 1 is complete
                self.other_version = version
                self._drop(_VERSION_AT)
                continue
            if len(self._buffer) < _HEADER.size:
                break
            _, _, kind, length, sequence, number = _HEADER.unpack_from(self._buffer)
            if self._lengths.get(kind) != length:
                self._drop(2)
                continue
            end = _HEADER.size + length
            if len(self._buffer) < end + _CRC.size:
                break
            if zlib.crc32(self._buffer[:end]) != _CRC.unpack_from(self._buffer, end)[0]:
                # Count every damaged frame, also directly after another one.
                self._in_garbage = False
                self._drop(2)
                continue
            payload = bytes(self._buffer[_HEADER.size : end])
            found.append(BoardFrame(FrameType(kind), sequence, payload, number))
            del self._buffer[: end + _CRC.size]
            self._in_garbage = False
        return found

    def reset(self) -> None:
        """Start with a new connection; the count continues."""
        self._buffer.clear()
        self._in_garbage = False
        self.other_version = None

    def _noise(self) -> int:
        """Return the number of bytes before the possible start of a frame."""
        start = self._buffer.find(MAGIC)
        return start if start >= 0 else len(self._buffer) - self._buffer.endswith(MAGIC[:1])

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self.garbled += not self._in_garbage
        self._in_garbage = True
