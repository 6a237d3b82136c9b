"""Opening an MCAP file through the index at its end; where that cannot be relied on, through its records."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

from soro_core.bag.part import Block, Part, open_stream
from soro_core.bag.records import (
    CHANNEL,
    CHUNK_INDEX,
    FOOTER,
    MAGIC,
    PREFIX,
    SCHEMA,
    STATISTICS,
    Cursor,
    Damage,
    parse_channel,
    parse_schema,
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
        ``NAME_0.mcap``, or ``NAME_0.mcap.zstd`` as rosbag2's file compression leaves it.
    index : bool
        Trust the index where it is whole; else walk through all records.

    Raises
    ------
    BagError
        If the file is missing, unreadable, empty or no MCAP file.
    """
    stream = open_stream(path)
    try:
        part = Part(path, stream, stream.seek(0, 2))
        stream.seek(0)
        magic = stream.read(len(MAGIC))
        if not magic:
            raise BagError(f"{path}: the file is empty")
        if magic != MAGIC:
            raise BagError(f"{path}: no MCAP file: it begins with {magic!r}")
        summary = _read_summary(part)
        if summary is None or not (index and summary.indexed):
            # Schemas and channels of the summary serve where the chunk that introduced them is damaged.
            if summary is not None:
                part.schemas, part.channels = summary.schemas, summary.channels
            scan(part)
            return part
    except OSError as error:
        stream.close()
        raise BagError(f"{path}: {error.strerror or error}") from None
    except BaseException:
        stream.close()
        raise
    return summary


def _read_summary(part: Part) -> Part | None:
    """Return a Part filled from the summary section, `indexed` if it leaves out nothing; None without one."""
    if part.size < len(MAGIC) + _TAIL:
        return None
    part.stream.seek(part.size - _TAIL)
    tail = part.stream.read(_TAIL)
    opcode, length, start, _, crc = _FOOTER.unpack_from(tail)
    if not tail.endswith(MAGIC) or opcode != FOOTER or length != _FOOTER.size - PREFIX.size or start == 0:
        return None
    summary = Part(part.path, part.stream, part.size)
    end = part.size - _TAIL
    try:
        if not len(MAGIC) < start <= end:
            raise Damage("the index lies outside the file")
        part.stream.seek(start)
        data = part.stream.read(end - start)
        # The checksum covers the summary and the footer up to itself.
        if crc and zlib.crc32(tail[: _FOOTER.size - 4], zlib.crc32(data)) != crc:
            raise Damage("the checksum of the index is wrong")
        summary.indexed = _fill(summary, memoryview(data), start)
    except Damage as damage:
        part.problems.append(f"{part.path.name}: {damage}; it was not used")
        return None
    return summary


def _fill(part: Part, summary: memoryview, start: int) -> bool:
    """Read the summary; False if it leaves out what reading needs (the format allows that)."""
    chunk_count = message_count = -1
    used: set[int] = set()
    for opcode, _, body in records(summary):
        if opcode == SCHEMA:
            schema = parse_schema(body)
            part.schemas[schema.id] = schema
        elif opcode == CHANNEL:
            channel = parse_channel(body)
            part.channels[channel.id] = channel
        elif opcode == STATISTICS:
            message_count, chunk_count = _fill_statistics(part, body)
        elif opcode == CHUNK_INDEX:
            block, channels, part.compression = _parse_chunk_index(body)
            if block.offset + block.length > start:
                raise Damage("the index points outside the data")
            part.blocks.append(block)
            used |= channels
    channels_known = used.issubset(part.channels)
    schemas_known = all(not c.schema_id or c.schema_id in part.schemas for c in part.channels.values())
    counted = message_count == part.message_count and chunk_count == len(part.blocks)
    # Messages outside chunks have no index.
    return channels_known and schemas_known and counted and (not message_count or bool(part.blocks))


def _fill_statistics(part: Part, body: memoryview) -> tuple[int, int]:
    """Read the counts of messages; return the numbers of messages and of chunks."""
    cursor = Cursor(body)
    message_count = cursor.number(8)
    cursor.take(2 + 4 + 4 + 4)  # schemas, channels, attachments, metadata
    chunk_count = cursor.number(4)
    cursor.take(8 + 8)  # start and end time
    inner = Cursor(cursor.take(cursor.number(4)))
    while inner.left():
        channel_id = inner.number(2)
        part.counts[channel_id] = inner.number(8)
    return message_count, chunk_count


def _parse_chunk_index(body: memoryview) -> tuple[Block, set[int], str]:
    """Return the block, the channels in it and the compression."""
    cursor = Cursor(body)
    start, end, offset, length = (cursor.number(8) for _ in range(4))
    inner = Cursor(cursor.take(cursor.number(4)))
    used = set()
    while inner.left():
        used.add(inner.number(2))
        inner.take(8)
    cursor.take(8)
    return Block(start, end, offset, length, is_chunk=True), used, cursor.text()
