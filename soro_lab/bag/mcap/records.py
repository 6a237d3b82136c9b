"""The records of an MCAP file: found by their prefixes, read by the `mcap` package within their bounds."""

from __future__ import annotations

import io
import struct
import zlib
from typing import IO, NamedTuple

from mcap import records as kinds
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader

MAGIC = b"\x89MCAP0\r\n"
PREFIX = struct.Struct("<BQ")
# Kinds of records from here on are private to their writers.
PRIVATE = 0x80
# Longest record that is read, and longest one that describes [B].
_LONGEST, _MOST_DESCRIBED = 1 << 30, 1 << 24
_STEP = 1 << 20
# Least length of the fields of each kind of record [B].
_LEAST = (0, 8, 20, 14, 16, 22, 40, 6, 64, 36, 48, 46, 8, 20, 17, 4)


class Damage(Exception):  # noqa: N818 - internal signal, becomes a problem or a BagError with the place
    """Bytes that are missing, or contradict each other."""


class Prefix(NamedTuple):
    """Kind of a record, and where it begins and ends in its file [B]."""

    opcode: int
    start: int
    end: int


class _Fields(io.BytesIO):
    """The bytes of one record. `StreamReader` takes a short read for a short record: here it is Damage."""

    def read(self, size: int = -1) -> bytes:  # type: ignore[override]
        data = super().read(min(size, _LONGEST))
        if len(data) != size:
            raise Damage("a record ends before its fields do")
        return data


def parse(raw: bytes | memoryview) -> kinds.McapRecord:
    """Return the record in bytes; raise Damage if its fields, or an attachment's checksum, do not fit."""
    reader = StreamReader(_Fields(raw), skip_magic=True, emit_chunks=True, record_size_limit=len(raw))
    try:
        record = next(reader.records)
    except (McapError, ValueError) as error:
        raise Damage(str(error) or "a record has no end") from None
    if isinstance(record, kinds.Attachment):
        names = len((record.name + record.media_type).encode())
        end = PREFIX.size + 32 + names + len(record.data)
        crc = int.from_bytes(raw[end : end + 4], "little")
        if crc and crc != zlib.crc32(memoryview(raw)[PREFIX.size : end]):
            raise Damage("the checksum of an attachment is wrong")
    return record


class Source:
    """An MCAP file from which records are read.

    Parameters
    ----------
    stream : file object
        Binary, open for reading.
    size : int
        Length of the file [B].
    """

    def __init__(self, stream: IO[bytes], size: int) -> None:
        self.stream, self.size = stream, size
        self._last: Prefix | None = None

    def bytes(self, start: int, end: int) -> bytes:
        """Return bytes of the file; raise Damage if it has fewer."""
        self.stream.seek(start)
        data = self.stream.read(end - start)
        if len(data) != end - start:
            raise Damage("the file has become shorter")
        return data

    def prefix(self, position: int) -> Prefix | None:
        """Return the prefix at a position; None where no whole record can be."""
        if self._last is not None and self._last.start == position:
            return self._last
        if position + PREFIX.size > self.size:
            return None
        opcode, length = PREFIX.unpack(self.bytes(position, position + PREFIX.size))
        end = position + PREFIX.size + length
        if not opcode or end > self.size or (opcode < len(_LEAST) and length < _LEAST[opcode]):
            return None
        self._last = Prefix(opcode, position, end)
        return self._last

    def begins(self, position: int) -> bool:
        """Whether a record, or the end of the file, is at a position."""
        if position == self.size:
            return True
        prefix = self.prefix(position)
        if prefix is None or prefix.opcode < len(_LEAST):
            return prefix is not None
        # Most bytes are such a kind, so that the next record has to be there too.
        return prefix.end == self.size or self.prefix(prefix.end) is not None

    def record(self, prefix: Prefix) -> kinds.McapRecord:
        """Return a record that the index or a walk has found; raise Damage if another one is there."""
        most = _LONGEST if prefix.opcode in (Opcode.CHUNK, Opcode.ATTACHMENT) else _MOST_DESCRIBED
        if prefix.end - prefix.start > most:
            raise Damage(f"a record is longer than {most} bytes")
        if self.prefix(prefix.start) != prefix:
            raise Damage("another record is here")
        return parse(self.bytes(prefix.start, prefix.end))

    def checksum(self, end: int) -> int:
        """Return the CRC-32 of the file up to a position."""
        crc = 0
        for start in range(0, end, _STEP):
            crc = zlib.crc32(self.bytes(start, min(start + _STEP, end)), crc)
        return crc
