"""Opening an MCAP file by the index at its end, or by its records if the index is incomplete."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from soro_core.bag.part import Block, Part, open_stream
from soro_core.bag.records import MAGIC, PREFIX, Damage
from soro_core.bag.walk import walk
from soro_core.errors import BagError

_FOOTER = struct.Struct("<BQQQI")
_TAIL = _FOOTER.size + len(MAGIC)
_DATA_END = PREFIX.size + 4


def open_part(path: Path, index: bool = True) -> Part:
    """Open one MCAP file.

    Parameters
    ----------
    path : Path
        ``NAME_0.mcap``, or ``NAME_0.mcap.zstd`` of rosbag2's file compression.
    index : bool
        Use the index if it is complete; else read all records.

    Raises
    ------
    BagError
        If the file is missing, unreadable, empty or not an MCAP file.
    """
    stream = open_stream(path)
    try:
        part = Part(path, stream, stream.seek(0, 2))
        _check_magic(part)
        summary = _read_summary(part)
        if summary is None:
            walk(part)
            return part
        if index and not part.problems and summary.is_complete():
            return summary.part
        # Schemas and channels of the summary replace those of damaged chunks.
        part.schemas, part.channels = summary.part.schemas, summary.part.channels
        walk(part, summary.places(), bool(summary.part.blocks), summary.is_proven)
        if summary.is_proven:
            summary.compare(part)
    except OSError as error:
        stream.close()
        raise BagError(error.strerror or str(error), path, "disk") from None
    except BaseException:
        stream.close()
        raise
    return part


def _check_magic(part: Part) -> None:
    """Refuse a file that neither starts nor ends as an MCAP file, up to one bit."""
    part.stream.seek(0)
    magic = part.stream.read(len(MAGIC))
    part.stream.seek(max(0, part.size - len(MAGIC)))
    if not magic:
        raise BagError("the file is empty", part.path, "damaged")
    if magic != MAGIC:
        flipped = int.from_bytes(magic, "little") ^ int.from_bytes(MAGIC, "little")
        if flipped.bit_count() > 1 and part.stream.read() != MAGIC:
            raise BagError(f"no MCAP file: it begins with {magic!r}", part.path, "format")
        part.note(0, "the first bytes are not those of an MCAP file", left_out=False)


class _Summary:
    """The index of a file: a Part filled from it, and counts to check it."""

    def __init__(self, part: Part, start: int, is_proven: bool) -> None:
        self.part = Part(part.path, part.stream, part.size)
        self.start, self.is_proven = start, is_proven
        self._statistics: Statistics | None = None
        self._metadata: list[MetadataIndex] = []

    def fill(self, end: int) -> None:
        """Read the records of the summary; raise Damage if one is inconsistent, or there are too many."""
        part, position = self.part, self.start
        most, most_entries, entries = 100_000 + part.size // 200, (1 << 20) + part.size // 3, 0
        for _ in range(most):
            if position == end:
                return
            prefix = part.source.prefix(position)
            if prefix is None or prefix.end > end:
                raise Damage("a record of the index is cut")
            # Of maps, each entry takes its time.
            entries += (
                prefix.end - position if prefix.opcode in (Opcode.CHUNK_INDEX, Opcode.STATISTICS) else 0
            )
            if entries > most_entries:
                raise Damage(f"the index is longer than {most_entries} bytes")
            if prefix.opcode <= Opcode.DATA_END:  # the format may grow
                self._take(part.source.parse(prefix), prefix.end - position)
            position = prefix.end
        raise Damage(f"the index has more than {most} records")

    def _take(self, record: object, length: int) -> None:
        part = self.part
        if isinstance(record, Schema | Channel):
            part.describe(record, length, self.start, proven=False)
        elif isinstance(record, Statistics):
            self._statistics = record
            part.counts.update(record.channel_message_counts)
        elif isinstance(record, ChunkIndex):
            part.compression = record.compression
            places = record.message_index_offsets.items()
            digest = hash((record.compression, record.compressed_size)) + record.message_index_length
            part.blocks.append(
                Block(
                    record.message_start_time,
                    record.message_end_time,
                    record.chunk_start_offset,
                    record.chunk_length,
                    record.uncompressed_size,
                    digest + sum(map(hash, places)),
                    record.message_index_length,
                )
            )
        elif isinstance(record, AttachmentIndex):
            part.attach(record)
        elif isinstance(record, MetadataIndex):
            self._metadata.append(record)

    def is_complete(self) -> bool:
        """Whether the index has all that reading needs; the format allows incomplete ones."""
        part, counted = self.part, self._statistics
        part.indexed = (
            counted is not None
            and counted.message_count == part.message_count
            and counted.chunk_count == len(part.blocks)
            and counted.attachment_count == len(part.attachments)
            and counted.metadata_count == len(self._metadata)
            and all(channel_id in part.channels for channel_id, count in part.counts.items() if count)
            and all(not item.schema_id or item.schema_id in part.schemas for item in part.channels.values())
            and self._all_messages_are_in_chunks()
            and self._metadata_is_read()
        )
        return part.indexed

    def compare(self, walked: Part) -> None:
        """Note messages that the index counts and the records lack."""
        missing = self.part.message_count - walked.message_count
        if missing > 0:
            walked.lossy = True
            walked.remarks.append(f"{missing} of {self.part.message_count} messages are missing")

    def places(self) -> list[int]:
        """Return where records begin by the index, in their order [B]."""
        return sorted({offset for offset, _ in self._known()} | {self.start - _DATA_END})

    def _known(self) -> Iterator[tuple[int, int]]:
        """Yield position and length [B] of what the index names; of a chunk with its message indexes."""
        for block in self.part.blocks:
            yield block.offset, block.length + block.indexes
        yield from ((item.offset, item.length) for item in self.part.attachments)
        yield from ((item.offset, item.length) for item in self._metadata)

    def _all_messages_are_in_chunks(self) -> bool:
        """Whether the rest of the file consists of whole records without messages."""
        source, position = self.part.source, len(MAGIC)
        for offset, length in (*sorted(self._known()), (self.start, 0)):
            while position < offset:
                prefix = source.prefix(position)
                if prefix is None or prefix.opcode == Opcode.MESSAGE:
                    return False
                position = prefix.end
            if position != offset:
                return False
            position += length
        return True

    def _metadata_is_read(self) -> bool:
        part = self.part
        try:
            header = part.record(Opcode.HEADER, len(MAGIC))
            assert isinstance(header, Header)
            part.profile = header.profile
            for place in self._metadata:
                record = part.record(Opcode.METADATA, place.offset, place.offset + place.length)
                assert isinstance(record, Metadata)
                part.describe(record, place.length, place.offset, proven=False)
        except Damage:
            return False
        return True


def _read_summary(part: Part) -> _Summary | None:
    """Read the summary section; return None without one, and note a problem if it is damaged."""
    if part.size < len(MAGIC) + _TAIL:
        return None
    tail = part.source.bytes(part.size - _TAIL, part.size)
    opcode, length, start, _, crc = _FOOTER.unpack_from(tail)
    if (
        not tail.endswith(MAGIC)
        or opcode != Opcode.FOOTER
        or length != _FOOTER.size - PREFIX.size
        or start == 0
    ):
        return None
    end = part.size - _TAIL
    try:
        if not len(MAGIC) < start <= end:
            raise Damage("the index lies outside the file")
        # The checksum covers the summary and the footer up to itself.
        if crc and zlib.crc32(tail[: _FOOTER.size - 4], zlib.crc32(part.source.bytes(start, end))) != crc:
            raise Damage("the checksum of the index is wrong")
        summary = _Summary(part, start, bool(crc))
        summary.fill(end)
    except Damage as damage:
        part.remarks.append(f"{damage}; it is ignored")
        return None
    return summary
