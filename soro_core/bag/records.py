"""MCAP records as bytes: framing, parsing and decompression, each with exact lengths.

The `mcap` library writes our files; for reading, its parser hands out short data where a file is cut or
damaged, so that the loss would go unnoticed. Here every length is checked (MCAP format 0).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import lz4.frame  # type: ignore[import-untyped]
import zstandard

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
MESSAGE_INDEX, CHUNK_INDEX, ATTACHMENT, STATISTICS, METADATA = 0x07, 0x08, 0x09, 0x0B, 0x0C
DATA_END = 0x0F
# The largest record that is believed: a damaged length must not ask for all the memory.
MAX_RECORD = 4 * 2**30

PREFIX = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQI")


class Damage(Exception):  # noqa: N818 - internal signal, becomes a problem or a BagError with the place
    """A record is incomplete or contradicts itself."""


@dataclass(frozen=True, slots=True)
class Schema:
    """A message definition of the file."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Channel:
    """A stream of messages of one topic."""

    id: int
    schema_id: int
    topic: str
    message_encoding: str
    metadata: dict[str, str]


@dataclass(frozen=True, slots=True)
class RawMessage:
    """One message record."""

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


class Cursor:
    """Reads fields of a record one after the other; Damage where the record ends too early."""

    def __init__(self, body: bytes | memoryview) -> None:
        self._body = memoryview(body)
        self.position = 0

    def take(self, size: int) -> memoryview:
        """Return the next `size` bytes."""
        end = self.position + size
        if size < 0 or end > len(self._body):
            raise Damage("a record ends before its fields do")
        piece = self._body[self.position : end]
        self.position = end
        return piece

    def number(self, size: int) -> int:
        """Return the next little-endian unsigned number of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def text(self) -> str:
        """Return the next string, with its length of 4 bytes in front."""
        try:
            return str(self.take(self.number(4)), "utf-8")
        except UnicodeDecodeError:
            raise Damage("a text is no UTF-8") from None

    def texts(self) -> dict[str, str]:
        """Return the next mapping of strings to strings."""
        inner = Cursor(self.take(self.number(4)))
        result = {}
        while inner.left():
            key = inner.text()
            result[key] = inner.text()
        return result

    def left(self) -> int:
        """Number of bytes not yet taken."""
        return len(self._body) - self.position


def records(buffer: memoryview) -> Iterator[tuple[int, int, memoryview]]:
    """Yield (opcode, offset, body) of the records in a buffer; Damage at the first incomplete one."""
    position = 0
    while position < len(buffer):
        if position + PREFIX.size > len(buffer):
            raise Damage("a record is cut")
        opcode, length = PREFIX.unpack_from(buffer, position)
        start = position + PREFIX.size
        if start + length > len(buffer):
            raise Damage("a record is cut")
        yield opcode, position, buffer[start : start + length]
        position = start + length


def parse_schema(body: memoryview) -> Schema:
    """Parse a Schema record."""
    cursor = Cursor(body)
    return Schema(cursor.number(2), cursor.text(), cursor.text(), bytes(cursor.take(cursor.number(4))))


def parse_channel(body: memoryview) -> Channel:
    """Parse a Channel record."""
    cursor = Cursor(body)
    return Channel(cursor.number(2), cursor.number(2), cursor.text(), cursor.text(), cursor.texts())


def parse_message(body: memoryview) -> RawMessage:
    """Parse a Message record."""
    if len(body) < _MESSAGE.size:
        raise Damage("a message is cut")
    channel_id, sequence, log_time, publish_time = _MESSAGE.unpack_from(body)
    return RawMessage(channel_id, sequence, log_time, publish_time, bytes(body[_MESSAGE.size :]))


def message_key(body: memoryview) -> tuple[int, int]:
    """Return (channel id, log time) of a Message record without copying its data."""
    if len(body) < _MESSAGE.size:
        raise Damage("a message is cut")
    channel_id, _, log_time, _ = _MESSAGE.unpack_from(body)
    return channel_id, log_time


def open_chunk(body: memoryview) -> memoryview:
    """Return the decompressed, verified records of a Chunk record."""
    cursor = Cursor(body)
    _, _, size, crc = _CHUNK.unpack(cursor.take(_CHUNK.size))
    compression = cursor.text()
    packed = cursor.take(cursor.number(8))
    if size > MAX_RECORD:
        raise Damage(f"a chunk claims {size} bytes")
    content = _decompress(packed, compression, size)
    if len(content) != size:
        raise Damage(f"a chunk holds {len(content)} bytes instead of {size}")
    if crc and zlib.crc32(content) != crc:
        raise Damage("the checksum of a chunk is wrong")
    return memoryview(content)


def chunk_compression(body: memoryview) -> str:
    """Return the name of a Chunk record's compression, empty for none."""
    cursor = Cursor(body)
    cursor.take(_CHUNK.size)
    return cursor.text()


def salvage_chunk(body: memoryview) -> memoryview:
    """Return what can be decompressed of a Chunk record whose end is missing, up to its last whole record."""
    try:
        cursor = Cursor(body)
        cursor.take(_CHUNK.size)
        compression = cursor.text()
        cursor.take(8)
        content = _decompress_part(cursor.take(cursor.left()), compression)
    except Damage:
        return memoryview(b"")
    end = 0
    try:
        for _, offset, inner in records(memoryview(content)):
            end = offset + PREFIX.size + len(inner)
    except Damage:
        pass
    return memoryview(content)[:end]


def _decompress(packed: memoryview, compression: str, size: int) -> bytes:
    try:
        if compression == "":
            return bytes(packed)
        if compression == "zstd":
            if not size:
                return b""
            claimed = zstandard.get_frame_parameters(packed).content_size
            if claimed not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                raise Damage("the two sizes of a chunk differ")
            return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
        if compression == "lz4":
            content: bytes = lz4.frame.decompress(packed)
            return content
    except (zstandard.ZstdError, RuntimeError, ValueError, MemoryError, EOFError):
        raise Damage(f"the {compression} data of a chunk is damaged") from None
    raise Damage(f"unknown compression {compression!r:.40}")


def _decompress_part(packed: memoryview, compression: str) -> bytes:
    pieces: list[bytes] = []
    if compression == "":
        return bytes(packed)
    if compression not in ("zstd", "lz4"):
        raise Damage(f"unknown compression {compression!r:.40}")
    zstd = compression == "zstd"
    unpacker = zstandard.ZstdDecompressor().decompressobj() if zstd else lz4.frame.LZ4FrameDecompressor()
    # In small steps: what was decompressed before the first damaged piece is kept.
    try:
        for start in range(0, len(packed), 4096):
            pieces.append(unpacker.decompress(packed[start : start + 4096]))
    except (zstandard.ZstdError, RuntimeError, ValueError, MemoryError, EOFError):
        pass
    return b"".join(pieces)
