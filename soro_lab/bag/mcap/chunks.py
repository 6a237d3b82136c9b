"""The content of a chunk: unpacked in bounds, and the messages in it."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.opcode import Opcode
from mcap.records import Chunk, Message

from soro_lab.bag.mcap.records import PREFIX, Damage

# Content that a chunk of any size may have [B]; a larger one must be at most this often its packed size.
_ALWAYS, _RATIO = 1 << 26, 4
_LARGEST = 1 << 30
# Largest history that zstd data may refer to [B]: that of level 19.
_WINDOW = 1 << 27
_STEP = 1 << 16
# Channel, sequence, log and publish time of a message.
_MESSAGE = struct.Struct("<HIQQ")


def most(packed: int) -> int:
    """Return the largest content of a chunk [B] of a packed size [B]."""
    return min(max(_ALWAYS, _RATIO * packed), _LARGEST)


def unpack(chunk: Chunk) -> memoryview:
    """Return the records in a chunk, verified.

    Raises
    ------
    Damage
        If the data, its size or its checksum is wrong, or it claims too much.
    """
    size, packed = chunk.uncompressed_size, len(chunk.data)
    if size > (limit := most(packed)):
        raise Damage(f"a chunk of {packed} bytes claims {size}; allowed: up to {limit}")
    if chunk.compression not in ("", "zstd", "lz4"):
        raise Damage(f"unknown compression {chunk.compression!r:.40}")
    content = _unpacked(chunk, size) if chunk.compression and packed else memoryview(chunk.data)
    if content is None or len(content) != size:
        raise Damage(f"the {chunk.compression or 'uncompressed'} data of a chunk is not that of {size} bytes")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise Damage("the checksum of a chunk is wrong")
    return content


def _unpacked(chunk: Chunk, size: int) -> memoryview | None:
    """Return unpacked data, one byte more than `size` at most; None if it is damaged."""
    content, found = memoryview(bytearray(size + 1)), 0
    source = io.BytesIO(chunk.data)
    try:
        stream: io.RawIOBase
        if chunk.compression == "zstd":
            unpacker = zstandard.ZstdDecompressor(max_window_size=_WINDOW)
            stream = unpacker.stream_reader(source, read_across_frames=True)  # type: ignore[assignment]
        else:
            stream = lz4.frame.LZ4FrameFile(source)
        while count := stream.readinto(content[found : found + _STEP]):
            found += count
    except (zstandard.ZstdError, RuntimeError, ValueError, MemoryError, EOFError, OSError):
        return None
    return content[:found] if source.tell() == len(chunk.data) else None


def inner(content: memoryview) -> Iterator[tuple[int, int, int]]:
    """Yield kind, begin and end of the records in a chunk; raise Damage at one that is cut."""
    position, size = 0, len(content)
    while position < size:
        if position + PREFIX.size > size:
            raise Damage("a record in a chunk is cut")
        opcode, length = PREFIX.unpack_from(content, position)
        end = position + PREFIX.size + length
        if not opcode or end > size or (opcode == Opcode.MESSAGE and length < _MESSAGE.size):
            raise Damage("a record in a chunk is cut")
        yield opcode, position, end
        position = end


def message_key(content: bytes | memoryview, start: int) -> tuple[int, int]:
    """Return channel and log time of the message at a position."""
    channel_id, _, log_time, _ = _MESSAGE.unpack_from(content, start + PREFIX.size)
    return channel_id, log_time


def message_of(record: memoryview) -> Message:
    """Return the message of a record."""
    channel_id, sequence, log_time, publish_time = _MESSAGE.unpack_from(record, PREFIX.size)
    data = bytes(record[PREFIX.size + _MESSAGE.size :])
    return Message(channel_id, log_time, data, publish_time, sequence)
