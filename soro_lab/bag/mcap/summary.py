"""Opening an MCAP file by the index at its end, or by its records if the index is incomplete."""

from __future__ import annotations

import shutil
import struct
import tempfile
import zlib
from pathlib import Path
from typing import IO

import zstandard
from mcap import records as kinds
from mcap.opcode import Opcode

from soro_core.errors import BagError
from soro_lab.bag.mcap.part import Block, Part
from soro_lab.bag.mcap.records import MAGIC, PREFIX, Damage
from soro_lab.bag.mcap.walk import Walk

_FOOTER = struct.Struct("<BQQQI")
_TAIL = _FOOTER.size + len(MAGIC)
_DATA_END = PREFIX.size + 4
_DATA_END_BEGIN = PREFIX.pack(Opcode.DATA_END, 4)
_STEP = 1 << 20
# Longest index in which topics are looked for where the footer does not lead to it [B].
_LONGEST_INDEX = 1 << 24
# Kinds of records that reading needs, so that the index has to name each.
_NAMED = (Opcode.MESSAGE, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA)


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
    stream = None
    try:
        stream = path.open("rb") if path.suffix != ".zstd" else _unpacked(path)
        return _opened(Part(path, stream), index)
    except BaseException as error:
        if stream is not None:
            stream.close()
        if isinstance(error, OSError):
            raise BagError(error.strerror or str(error), path, "disk") from None
        raise


def _opened(part: Part, index: bool) -> Part:
    begin = part.source.bytes(0, min(len(MAGIC), part.size))
    end = part.source.bytes(max(0, part.size - _TAIL), part.size)
    if not begin:
        raise BagError("the file is empty", part.path, "damaged")
    if MAGIC not in (begin, end[-len(MAGIC) :]):
        raise BagError(f"no MCAP file: it begins with {begin!r}", part.path, "format")
    if begin != MAGIC:
        part.remark("the first bytes are not those of an MCAP file")
    summary = _read_summary(part, end)
    if summary is None:
        return _walked(part)
    if index and not part.problems and summary.is_complete():
        return summary.part
    summary.walk(part)
    return part


def _walked(part: Part) -> Part:
    """Return the part, filled by a walk; of an index elsewhere than the footer says, only topics count.

    Where bytes are missing from a file, or too many, the chunk that describes the topics may be lost. What
    the walk itself finds precedes such an index, whose checksum does not fit.
    """
    again = Part(part.path, part.stream)
    again.remarks = part.remarks[:]
    Walk(part).run()
    if part.losses and not part.over:
        again.schemas, again.channels = {**part.schemas}, {**part.channels}
        _describe_topics(again)
        if again.channels.keys() > part.channels.keys():
            Walk(again).run()
            return again
    return part


def _describe_topics(part: Part) -> None:
    """Add the schemas and channels behind the end of the data, wherever that is."""
    begin = max(0, part.size - _LONGEST_INDEX)
    at = bytes(part.source.bytes(begin, part.size)).rfind(_DATA_END_BEGIN)
    position = begin + at + _DATA_END
    while at >= 0 and (prefix := part.source.prefix(position)) is not None and prefix.end <= part.size:
        if prefix.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            try:
                record = part.source.parse(prefix)
                assert isinstance(record, kinds.Schema | kinds.Channel)
                part.describe(record, prefix.end - position)
            except Damage:
                return
        position = prefix.end


class _Summary:
    """The index of a file: a Part filled from it, and what its statistics say."""

    def __init__(self, part: Part, start: int, is_proven: bool) -> None:
        self.part, self._start, self._is_proven = Part(part.path, part.stream), start, is_proven
        self._statistics: kinds.Statistics | None = None
        self._metadata: list[kinds.MetadataIndex] = []
        # Position and length [B] of what the index names; of a chunk with its message indexes.
        self._places: list[tuple[int, int]] = []

    def fill(self, end: int) -> None:
        """Read the records of the summary; raise Damage if one is inconsistent, or there are too many."""
        part, position = self.part, self._start
        most = 100_000 + part.size // 200
        for _ in range(most):
            if position == end:
                return
            prefix = part.source.prefix(position)
            if prefix is None or prefix.end > end:
                raise Damage("a record of the index is cut")
            if prefix.opcode <= Opcode.DATA_END:  # the format may grow
                self._take(part.source.parse(prefix), prefix.end - position)
            position = prefix.end
        raise Damage(f"the index has more than {most} records")

    def _take(self, record: kinds.McapRecord, length: int) -> None:
        part = self.part
        if isinstance(record, kinds.Schema | kinds.Channel):
            part.describe(record, length)
        elif isinstance(record, kinds.Statistics):
            self._statistics = record
            part.counts.update(record.channel_message_counts)
        elif isinstance(record, kinds.ChunkIndex):
            times, offset = (record.message_start_time, record.message_end_time), record.chunk_start_offset
            part.compression = record.compression
            part.blocks.append(Block(*times, offset, record.chunk_length, record.uncompressed_size))
            part.message_indexes.update((at, key) for key, at in record.message_index_offsets.items())
            self._places.append((offset, record.chunk_length + record.message_index_length))
        elif isinstance(record, kinds.AttachmentIndex):
            part.attach(record)
            self._places.append((record.offset, record.length))
        elif isinstance(record, kinds.MetadataIndex):
            self._metadata.append(record)
            self._places.append((record.offset, record.length))

    def is_complete(self) -> bool:
        """Whether the index has all that reading needs; the format allows incomplete ones."""
        part, counted = self.part, self._statistics
        part.indexed = (
            counted is not None
            and counted.message_count == part.message_count
            and all(key in part.channels for key, count in part.counts.items() if count)
            and all(not item.schema_id or item.schema_id in part.schemas for item in part.channels.values())
            and self._names_all()
            and self._metadata_is_read()
        )
        return part.indexed

    def _names_all(self) -> bool:
        """Whether the rest of the file consists of whole records that reading does not need."""
        position = len(MAGIC)
        for offset, length in (*sorted(self._places), (self._start, 0)):
            while position < offset:
                prefix = self.part.source.prefix(position)
                if prefix is None or prefix.opcode in _NAMED:
                    return False
                position = prefix.end
            if position != offset:
                return False
            position += length
        return True

    def _metadata_is_read(self) -> bool:
        part = self.part
        try:
            prefix = part.source.prefix(len(MAGIC))
            if prefix is None or not isinstance(header := part.source.parse(prefix), kinds.Header):
                return False
            part.profile = header.profile
            for place in self._metadata:
                record = part.record(Opcode.METADATA, place.offset, place.length)
                assert isinstance(record, kinds.Metadata)
                part.describe(record, place.length)
        except Damage:
            return False
        return True

    def walk(self, walked: Part) -> None:
        """Fill a Part from the records of the file, with the help of the index if a checksum proves it."""
        part, counted, data_end = self.part, self._statistics, self._start - _DATA_END
        if not self._is_proven:
            Walk(walked).run()
            return
        ends = {block.offset + block.length for block in part.blocks}
        ends |= {end for offset, length in self._places for end in (offset, offset + length)}
        places = [*sorted(place for place in ends if place < data_end), data_end, self._start]
        # Schemas and channels of the index replace those of damaged chunks.
        walked.schemas, walked.channels = {**part.schemas}, {**part.channels}
        span = (counted.message_start_time, counted.message_end_time) if counted else (0, 1 << 64)
        Walk(walked, places, bool(part.blocks), span).run()
        if part.message_count > walked.message_count:
            missing = part.message_count - walked.message_count
            walked.lose(self._start, f"{missing} of {part.message_count} messages are missing")


def _read_summary(part: Part, tail: bytes) -> _Summary | None:
    """Read the summary section; return None without one, and remark on one that is damaged or missing."""
    if len(tail) < _TAIL or not tail.endswith(MAGIC) or tail[: PREFIX.size] != PREFIX.pack(Opcode.FOOTER, 20):
        part.remark("not closed by its recorder, or cut: the index at the end is missing")
        return None
    *_, start, _, crc = _FOOTER.unpack_from(tail)
    if start == 0:
        return None
    end = part.size - _TAIL
    try:
        if not len(MAGIC) + _DATA_END < start <= end:
            raise Damage("the index lies outside the file")
        # The checksum covers the summary and the footer up to itself.
        if crc and zlib.crc32(tail[: _FOOTER.size - 4], zlib.crc32(part.source.bytes(start, end))) != crc:
            raise Damage("the checksum of the index is wrong")
        summary = _Summary(part, start, bool(crc))
        summary.fill(end)
    except Damage as damage:
        part.remark(f"{damage}; it is ignored")
        return None
    return summary


def _unpacked(path: Path) -> IO[bytes]:
    """Unpack a file into a temporary one.

    Raises
    ------
    BagError
        If it is damaged, or needs more than half of the free space of the temporary folder.
    """
    stream = tempfile.TemporaryFile()  # noqa: SIM115 - closed by its Part
    folder = tempfile.gettempdir()
    limit = shutil.disk_usage(folder).free // 2
    unpacker = zstandard.ZstdDecompressor()
    try:
        with path.open("rb") as packed, unpacker.stream_reader(packed, read_across_frames=True) as pieces:
            while piece := pieces.read(_STEP):
                if stream.tell() + len(piece) > limit:
                    text = f"unpacks to more than {limit} bytes, half of the free space in {folder}; "
                    raise BagError(f"{text}unpack it elsewhere ('zstd -d')", path, "disk")
                stream.write(piece)
    except BaseException as error:
        stream.close()
        if isinstance(error, zstandard.ZstdError):
            raise BagError("the zstd data is damaged", path, "damaged") from None
        raise
    return stream
