"""The records of an MCAP file, found by the reader of the `mcap` package, one at a time and bounded."""

from __future__ import annotations

import struct
import zlib
from typing import IO, NamedTuple, cast

from mcap import records as kinds
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader

MAGIC = b"\x89MCAP0\r\n"
PREFIX = struct.Struct("<BQ")
# Longest record that is read [B].
LONGEST = 1 << 30
# Kinds of records from here on are private to their writers.
PRIVATE = 0x80
_STEP = 1 << 20
_KINDS: dict[int, type[kinds.McapRecord]] = {
    Opcode.HEADER: kinds.Header,
    Opcode.SCHEMA: kinds.Schema,
    Opcode.CHANNEL: kinds.Channel,
    Opcode.CHUNK: kinds.Chunk,
    Opcode.CHUNK_INDEX: kinds.ChunkIndex,
    Opcode.ATTACHMENT: kinds.Attachment,
    Opcode.ATTACHMENT_INDEX: kinds.AttachmentIndex,
    Opcode.STATISTICS: kinds.Statistics,
    Opcode.METADATA: kinds.Metadata,
    Opcode.METADATA_INDEX: kinds.MetadataIndex,
    Opcode.SUMMARY_OFFSET: kinds.SummaryOffset,
    Opcode.DATA_END: kinds.DataEnd,
}
_LAST = int(Opcode.DATA_END)


class Damage(Exception):  # noqa: N818 - internal signal, becomes a problem or a BagError with the place
    """Bytes that are missing, or contradict each other."""


class Prefix(NamedTuple):
    """Kind of a record, its position, and where it ends by its length [B]."""

    opcode: int
    start: int
    end: int


class Source:
    """A file for `StreamReader`, which takes a short read for a short record: here it is `Damage`.

    Parameters
    ----------
    stream : file object
        Binary, open for reading.
    size : int
        Length of the file [B].
    """

    def __init__(self, stream: IO[bytes], size: int) -> None:
        self.stream, self.size = stream, size
        self._position = self._end = 0

    def read(self, length: int) -> bytes:
        """Return bytes of the record that is being read; raise Damage behind its end."""
        if length < 0 or length > self._end - self._position:
            raise Damage("a record ends before its fields do")
        data = self.stream.read(length)
        if len(data) != length:
            raise Damage("the file has become shorter")
        self._position += length
        return data

    def bytes(self, start: int, end: int) -> bytes:
        """Return bytes of the file; raise Damage if it has fewer."""
        self._seek(start, end)
        return self.read(end - start)

    def prefix(self, position: int) -> Prefix | None:
        """Return the prefix at a position; None where the file ends before."""
        if position + PREFIX.size > self.size:
            return None
        self.stream.seek(position)
        opcode, length = PREFIX.unpack(self.stream.read(PREFIX.size))
        return Prefix(opcode, position, position + PREFIX.size + length)

    def begins_record(self, position: int, is_cut: bool = False) -> bool:
        """Whether a record, or the end of the file, is at a position; `is_cut`: or a record without end."""
        if position >= self.size:
            return position == self.size
        prefix = self.prefix(position)
        if prefix is None:
            return is_cut or self.size - position == len(MAGIC)
        if prefix.opcode >= PRIVATE:
            # Most bytes are such a kind, so that the next record has to be there too.
            following = self.prefix(prefix.end) if prefix.end < self.size else None
            return prefix.end == self.size or (following is not None and following.end <= self.size)
        fits = prefix.end <= self.size or (is_cut and prefix.end - position < 1 << 32)
        return 0 < prefix.opcode <= _LAST and fits

    def parse(self, prefix: Prefix) -> kinds.McapRecord:
        """Return a record; raise Damage if its fields do not fit its length."""
        self._seek(prefix.start, prefix.end)
        reader = StreamReader(
            cast(IO[bytes], self), skip_magic=True, emit_chunks=True, record_size_limit=LONGEST
        )
        try:
            record = next(reader.records)
        except (McapError, ValueError) as error:
            raise Damage(str(error) or "a record has no end") from None
        if isinstance(record, kinds.Attachment):
            self._check(prefix, record)
        return record

    def by_fields(self, prefix: Prefix) -> tuple[kinds.McapRecord | None, int] | None:
        """Return a record (None for a message index) and its end by its fields, whatever its length says.

        Returns
        -------
        tuple or None
            None if the fields make no sense.
        """
        self._seek(prefix.start + PREFIX.size, self.size)
        fields = ReadDataStream(cast(IO[bytes], self))
        record: kinds.McapRecord | None = None
        try:
            if prefix.opcode == Opcode.MESSAGE_INDEX:
                self.read(2)
                self.read(fields.read4())
            elif prefix.opcode in _KINDS:
                record = _KINDS[prefix.opcode].read(fields)  # type: ignore[attr-defined]
            else:
                return None
        except (Damage, McapError, ValueError):
            return None
        return record, self._position

    def checksum(self, end: int) -> int:
        """Return the CRC-32 of the file up to a position."""
        crc = 0
        for start in range(0, end, _STEP):
            crc = zlib.crc32(self.bytes(start, min(start + _STEP, end)), crc)
        return crc

    def _check(self, prefix: Prefix, record: kinds.Attachment) -> None:
        end = prefix.start + length_of(record)
        crc = int.from_bytes(self.bytes(end - 4, end), "little")
        if crc and crc != zlib.crc32(self.bytes(prefix.start + PREFIX.size, end - 4)):
            raise Damage("the checksum of an attachment is wrong")

    def _seek(self, start: int, end: int) -> None:
        if end > self.size:
            raise Damage("a record ends behind the file")
        self.stream.seek(start)
        self._position, self._end = start, end


def length_of(record: kinds.McapRecord) -> int:
    """Return the length of a record's fields, with its prefix [B]."""
    if isinstance(record, kinds.Chunk):
        return PREFIX.size + 40 + len(record.compression.encode()) + len(record.data)
    if isinstance(record, kinds.Attachment):
        return PREFIX.size + 36 + len((record.name + record.media_type).encode()) + len(record.data)
    builder = RecordBuilder()
    record.write(builder)
    return builder.count
