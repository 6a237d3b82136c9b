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
from soro_lab.bag.mcap.part import BagFile, Block
from soro_lab.bag.mcap.records import MAGIC, PREFIX, Damage, Prefix
from soro_lab.bag.mcap.walk import RECORD_WORK, Walk

_FOOTER = struct.Struct("<BQQQI")
_TAIL = _FOOTER.size + len(MAGIC)
_DATA_END = PREFIX.size + 4
_DATA_END_BEGIN = PREFIX.pack(Opcode.DATA_END, 4)
# Where an index begins at the earliest [B].
_FIRST = len(MAGIC) + _DATA_END + 1
_STEP = 1 << 20
# Longest index that is looked for where the footer does not lead to it [B].
_LONGEST_INDEX = 1 << 24
# Kinds of records that reading needs, so that the index has to name each.
_NAMED = (Opcode.MESSAGE, Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA)


def open_part(path: Path, index: bool = True) -> BagFile:
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
        return _opened(BagFile(path, stream), index)
    except BaseException as error:
        if stream is not None:
            stream.close()
        if isinstance(error, OSError):
            raise BagError(error.strerror or str(error), path, "disk") from None
        raise


def _opened(part: BagFile, index: bool) -> BagFile:
    begin = part.source.bytes(0, min(len(MAGIC), part.size))
    tail = part.source.bytes(max(0, part.size - _TAIL), part.size)
    if not begin:
        raise BagError("the file is empty", part.path, "damaged")
    if MAGIC not in (begin, tail[-len(MAGIC) :]):
        raise BagError(f"no MCAP file: it begins with {begin!r}", part.path, "format")
    if begin != MAGIC:
        part.remark("the first bytes are not those of an MCAP file")
    summary = _read_summary(part, tail)
    if index and summary is not None and not part.problems and summary.is_complete():
        return summary.part
    if summary is not None and summary.is_proven:
        summary.walk(part)
    else:
        Walk(part).run()
    return part


class _Summary:
    """The index of a file: a `BagFile` filled from it, and what its statistics say.

    Parameters
    ----------
    part : BagFile
        The part to fill.
    start, end : int
        Where the records of the index begin and end [B].
    is_proven : bool
        Whether it has a checksum, which fits.
    is_at_place : bool
        Whether it is where the footer says, so that its offsets are right.

    Raises
    ------
    Damage
        If a record is inconsistent, or there are too many.
    """

    def __init__(self, part: BagFile, start: int, end: int, is_proven: bool, is_at_place: bool) -> None:
        self.part, self._start = part, start
        self.is_proven, self._is_at_place = is_proven, is_at_place
        self._statistics: kinds.Statistics | None = None
        self._metadata: list[kinds.MetadataIndex] = []
        # Position and length [B] of what the index names; of a chunk with its message indexes.
        self._places: list[tuple[int, int]] = []
        while start < end:
            prefix = part.source.prefix(start)
            part.work(RECORD_WORK)
            if prefix is None or prefix.end > end or part.over:
                raise Damage(f"the index: {part.over}" if part.over else "a record of the index is cut")
            if prefix.opcode <= Opcode.DATA_END:  # the format may grow
                self._take(part.source.record(prefix), prefix.end - start)
            start = prefix.end

    def _take(self, record: kinds.McapRecord, length: int) -> None:
        part = self.part
        if isinstance(record, kinds.Schema | kinds.Channel):
            part.describe(record, length)
        elif isinstance(record, kinds.Statistics):
            self._statistics = record
            part.counts.update(record.channel_message_counts)
        elif isinstance(record, kinds.ChunkIndex):
            times, offset = (record.message_start_time, record.message_end_time), record.chunk_start_offset
            part.work(RECORD_WORK * len(record.message_index_offsets))
            part.compression = record.compression
            part.blocks.append(Block(*times, offset, record.chunk_length, record.uncompressed_size))
            part.message_indexes.update((at, key) for key, at in record.message_index_offsets.items())
            self._places.append((offset, record.chunk_length + record.message_index_length))
        elif isinstance(record, kinds.AttachmentIndex):
            part.describe(record)
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
            if prefix is None or prefix.opcode != Opcode.HEADER:
                return False
            header = part.source.record(prefix)
            assert isinstance(header, kinds.Header)
            part.profile = header.profile
            for place in self._metadata:
                record = part.source.record(
                    Prefix(Opcode.METADATA, place.offset, place.offset + place.length)
                )
                assert isinstance(record, kinds.Metadata)
                part.describe(record, place.length)
        except Damage:
            return False
        return True

    def walk(self, walked: BagFile) -> None:
        """Fill a `BagFile` from the records of the file, with the help of the index."""
        part, counted, data_end = self.part, self._statistics, self._start - _DATA_END
        first, last = (counted.message_start_time, counted.message_end_time) if counted else (0, 1 << 64)
        outside_ns = range(0) if part.blocks else range(first, last + 1)
        # Schemas and channels of the index replace those of damaged chunks.
        walked.schemas, walked.channels = {**part.schemas}, {**part.channels}
        places: list[int] = []
        if self._is_at_place:
            ends = {block.offset + block.length for block in part.blocks}
            ends |= {end for offset, length in self._places for end in (offset, offset + length)}
            places = [*sorted(place for place in ends if place < data_end), data_end, self._start]
        Walk(walked, places, outside_ns).run()
        if part.message_count > walked.message_count:
            missing = part.message_count - walked.message_count
            walked.lose(self._start, f"{missing} of {part.message_count} messages are missing")


def _read_summary(part: BagFile, tail: bytes) -> _Summary | None:
    """Read the summary section; return None without one, and remark on one that is damaged or missing."""
    if len(tail) < _TAIL or not tail.endswith(MAGIC) or tail[: PREFIX.size] != PREFIX.pack(Opcode.FOOTER, 20):
        part.remark("not closed by its recorder, or cut: the index at the end is missing")
        return None
    *_, start, _, crc = _FOOTER.unpack_from(tail)
    if start == 0:
        return None
    end = part.size - _TAIL

    def fits(begin: int) -> bool:
        """Whether the index begins there by the checksum, of the index and the footer up to itself."""
        return _FIRST <= begin <= end and crc == zlib.crc32(
            tail[: _FOOTER.size - 4], zlib.crc32(part.source.bytes(begin, end))
        )

    stated = start
    try:
        if not crc and not _FIRST <= start <= end:
            raise Damage("the index lies outside the file")
        if crc and not fits(start):
            part.remark("the checksum of the index is wrong; it is ignored")
            # Where bytes are missing from a file, or too many, it still follows the end of the data.
            begin = max(0, end - _LONGEST_INDEX)
            start = begin + part.source.bytes(begin, end).rfind(_DATA_END_BEGIN) + _DATA_END
            if not fits(start):
                return None
        return _Summary(BagFile(part.path, part.stream), start, end, bool(crc), start == stated)
    except Damage as damage:
        part.remark(f"{damage}; it is ignored")
        return None


def _unpacked(path: Path) -> IO[bytes]:
    """Unpack a file into a temporary one.

    Raises
    ------
    BagError
        If it is damaged, or needs more than half of the free space of the temporary folder.
    """
    stream = tempfile.TemporaryFile()  # noqa: SIM115 - closed by its BagFile
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
