"""Opening an MCAP file by the index at its end, or by its records if the index is incomplete."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

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

from soro_core.bag.blocks import Block
from soro_core.bag.chunks import open_chunk
from soro_core.bag.part import Part, open_stream
from soro_core.bag.prefixes import read_prefix
from soro_core.bag.records import (
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    METADATA,
    PREFIX,
    Damage,
    parse,
    records,
)
from soro_core.bag.scan import scan
from soro_core.errors import BagError

_FOOTER = struct.Struct("<BQQQI")
_TAIL = _FOOTER.size + len(MAGIC)


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
            scan(part)
            return part
        summary.part.problems[:0] = part.problems
        if index and summary.is_complete():
            return summary.part
        # Schemas and channels of the summary replace those of damaged chunks.
        part.schemas, part.channels = summary.part.schemas, summary.part.channels
        scan(part, summary.is_proven)
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
    """Refuse a file that neither starts as an MCAP file, up to one bit, nor ends as one."""
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

    def fill(self, data: memoryview) -> None:
        """Read the records of the summary; raise Damage if one is inconsistent."""
        part = self.part
        for opcode, _, body in records(data):
            if opcode > DATA_END:
                continue  # the format may grow
            record = parse(opcode, body)
            if isinstance(record, Schema):
                part.schemas[record.id] = record
            elif isinstance(record, Channel):
                part.channels[record.id] = record
            elif isinstance(record, Statistics):
                self._statistics = record
                part.counts.update(record.channel_message_counts)
            elif isinstance(record, ChunkIndex):
                part.chunks.append(record)
                part.compression = record.compression
                times = record.message_start_time, record.message_end_time
                part.blocks.append(Block(*times, record.chunk_start_offset, record.chunk_length, open_chunk))
            elif isinstance(record, AttachmentIndex):
                part.attachments.append(record)
            elif isinstance(record, MetadataIndex):
                self._metadata.append(record)

    def is_complete(self) -> bool:
        """Whether the index has all that reading needs; the format allows incomplete ones."""
        part, counted = self.part, self._statistics
        part.indexed = (
            counted is not None
            and counted.message_count == part.message_count
            and counted.chunk_count == len(part.chunks)
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
            walked.problems.append(
                f"{walked.path.name}: {missing} of {self.part.message_count} messages are missing"
            )

    def _all_messages_are_in_chunks(self) -> bool:
        """Whether the rest of the file consists of whole records without messages."""
        part, position = self.part, len(MAGIC)
        known = [
            *(
                (item.chunk_start_offset, item.chunk_length + item.message_index_length)
                for item in part.chunks
            ),
            *((item.offset, item.length) for item in part.attachments),
            *((item.offset, item.length) for item in self._metadata),
        ]
        for offset, length in (*sorted(known), (self.start, 0)):
            while position < offset:
                prefix = read_prefix(part, position)
                if prefix is None or prefix.opcode == MESSAGE:
                    return False
                position = prefix.end
            if position != offset:
                return False
            position += length
        return True

    def _metadata_is_read(self) -> bool:
        part = self.part
        try:
            header = part.record(HEADER, len(MAGIC))
            assert isinstance(header, Header)
            part.profile = header.profile
            for place in self._metadata:
                record = part.record(METADATA, place.offset, place.length)
                assert isinstance(record, Metadata)
                part.metadata.append((record.name, record.metadata))
        except Damage:
            return False
        return True


def _read_summary(part: Part) -> _Summary | None:
    """Read the summary section; return None without one, and note a problem if it is damaged."""
    if part.size < len(MAGIC) + _TAIL:
        return None
    tail = bytes(part.read(part.size - _TAIL, _TAIL))
    opcode, length, start, _, crc = _FOOTER.unpack_from(tail)
    if not tail.endswith(MAGIC) or opcode != FOOTER or length != _FOOTER.size - PREFIX.size or start == 0:
        return None
    end = part.size - _TAIL
    try:
        if not len(MAGIC) < start <= end:
            raise Damage("the index lies outside the file")
        data = part.read(start, end - start)
        # The checksum covers the summary and the footer up to itself.
        if crc and zlib.crc32(tail[: _FOOTER.size - 4], zlib.crc32(data)) != crc:
            raise Damage("the checksum of the index is wrong")
        summary = _Summary(part, start, bool(crc))
        summary.fill(data)
    except Damage as damage:
        part.problems.append(f"{part.path.name}: {damage}; it is ignored")
        return None
    return summary
