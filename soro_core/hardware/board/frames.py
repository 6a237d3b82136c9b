"""Frames between the driver and `soro board`.

Every frame is, little-endian:

========  ====  ==========================================================
bytes     type  meaning
========  ====  ==========================================================
2               magic ``sB``
1         u8    version of this format, 1
1         u8    kind, see `Kind`
2         u16   length of the payload
4         u32   sequence number
length          payload
4         u32   CRC-32 (zlib) of everything before it
========  ====  ==========================================================

`soro_core.hardware.board.messages` defines the payloads.
"""

from __future__ import annotations

import enum
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

MAGIC = b"sB"
VERSION = 1
_HEADER = struct.Struct("<2sBBHI")
_CRC = struct.Struct("<I")


class Kind(enum.IntEnum):
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

    kind: Kind
    sequence: int
    payload: bytes = b""


def encode(frame: BoardFrame) -> bytes:
    """Return the bytes of a frame."""
    head = _HEADER.pack(MAGIC, VERSION, frame.kind, len(frame.payload), frame.sequence & 0xFFFFFFFF)
    body = head + frame.payload
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
    """

    def __init__(self, lengths: Mapping[Kind, int]) -> None:
        self._lengths = {int(kind): length for kind, length in lengths.items()}
        self._buffer = bytearray()
        self._in_garbage = False
        self.garbled = 0

    def feed(self, chunk: bytes) -> list[BoardFrame]:
        """Process bytes; return the complete frames, oldest first."""
        self._buffer += chunk
        found: list[BoardFrame] = []
        while self._buffer:
            if start := self._noise():
                self._drop(start)
                continue
            if len(self._buffer) < _HEADER.size:
                break
            _, version, kind, length, sequence = _HEADER.unpack_from(self._buffer)
            if version != VERSION or self._lengths.get(kind) != length:
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
            found.append(BoardFrame(Kind(kind), sequence, bytes(self._buffer[_HEADER.size : end])))
            del self._buffer[: end + _CRC.size]
            self._in_garbage = False
        return found

    def reset(self) -> None:
        """Start with a new connection; the count continues."""
        self._buffer.clear()
        self._in_garbage = False

    def _noise(self) -> int:
        """Return the number of bytes before the possible start of a frame."""
        start = self._buffer.find(MAGIC)
        return start if start >= 0 else len(self._buffer) - self._buffer.endswith(MAGIC[:1])

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self.garbled += not self._in_garbage
        self._in_garbage = True
