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

What the payloads mean is in `soro_core.hardware.board.messages`.
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
    """Kind of a frame; those of the board have the highest bit set."""

    HELLO = 0x01
    SET = 0x02
    RESET = 0x03
    BYE = 0x04
    WELCOME = 0x81
    STATE = 0x82
    REFUSED = 0x83


@dataclass(frozen=True)
class Frame:
    """One frame, whose CRC was right."""

    kind: Kind
    sequence: int
    payload: bytes = b""


def encode(frame: Frame) -> bytes:
    """Bytes of a frame."""
    head = _HEADER.pack(MAGIC, VERSION, frame.kind, len(frame.payload), frame.sequence & 0xFFFFFFFF)
    body = head + frame.payload
    return body + _CRC.pack(zlib.crc32(body))


class Decoder:
    """Frames out of a byte stream; what is none is dropped and counted.

    Parameters
    ----------
    lengths : mapping
        Length of the payload of every kind. A frame of another length is garbled at once, so that a damaged
        length cannot make the decoder wait for bytes that never come.

    Attributes
    ----------
    garbled : int
        Runs of bytes that were no frame.
    """

    def __init__(self, lengths: Mapping[Kind, int]) -> None:
        self._lengths = {int(kind): length for kind, length in lengths.items()}
        self._buffer = bytearray()
        self._in_garbage = False
        self.garbled = 0

    def feed(self, chunk: bytes) -> list[Frame]:
        """Take bytes; every frame that is complete by now."""
        self._buffer += chunk
        found: list[Frame] = []
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
                # Every damaged frame counts, also right behind another one.
                self._in_garbage = False
                self._drop(2)
                continue
            found.append(Frame(Kind(kind), sequence, bytes(self._buffer[_HEADER.size : end])))
            del self._buffer[: end + _CRC.size]
            self._in_garbage = False
        return found

    def reset(self) -> None:
        """Begin with a new connection; the count goes on."""
        self._buffer.clear()
        self._in_garbage = False

    def _noise(self) -> int:
        """Bytes before the first that may begin a frame."""
        start = self._buffer.find(MAGIC)
        return start if start >= 0 else len(self._buffer) - self._buffer.endswith(MAGIC[:1])

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self.garbled += not self._in_garbage
        self._in_garbage = True
