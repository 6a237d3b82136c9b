"""The records inside a Chunk: decompressed and verified, or the part of a damaged one that is certain."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.records import Chunk

from soro_core.bag.prefixes import fits, is_plausible, one_bit_variants, read_prefix
from soro_core.bag.records import CHANNEL, CHUNK, MESSAGE, PREFIX, PRIVATE, SCHEMA, Damage, parse, records

# Largest accepted content [B], so that a damaged size or a decompression bomb cannot exhaust the memory.
# Recorders end a chunk after some megabytes; a content beyond _ALWAYS must be below _RATIO times its
# compressed size.
MAX_CHUNK = 1 << 30
_ALWAYS = 1 << 26
_RATIO = 100

_HEAD = struct.Struct("<QQQI")
_COMPRESSIONS = ("zstd", "lz4", "")
_INNER = (SCHEMA, CHANNEL, MESSAGE)
_STEP = 4096


@dataclass
class _Content:
    stream: IO[bytes]
    size: int


def open_chunk(record: memoryview) -> memoryview:
    """Return the decompressed, verified records of a Chunk record.

    Raises
    ------
    Damage
        If a size or the checksum is wrong, or the content is larger than MAX_CHUNK.
    """
    chunk = parse(CHUNK, record[PREFIX.size :])
    assert isinstance(chunk, Chunk)
    size, name = chunk.uncompressed_size, chunk.compression
    if name not in _COMPRESSIONS:
        raise Damage(f"unknown compression {name!r:.40}")
    if size > (limit := _limit(len(chunk.data))):
        raise Damage(f"a chunk of {len(chunk.data)} bytes claims {size}; allowed: up to {limit}")
    content, used = _unpack(memoryview(chunk.data), name, size)
    if len(content) > size:
        raise Damage(f"a chunk holds more than the {size} bytes that it claims")
    if used != len(chunk.data):
        raise Damage(f"the {name} data of a chunk is damaged")
    if len(content) != size:
        raise Damage(f"a chunk holds {len(content)} bytes instead of {size}")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise Damage("the checksum of a chunk is wrong")
    return memoryview(content)


def salvage_chunk(record: memoryview) -> memoryview:
    """Return the records of a Chunk whose head is damaged, or that has one flipped bit uncompressed.

    The length of the record must be correct. The checksum proves the content; if it is missing, or has the
    flipped bit itself, the records must fill the content.

    Raises
    ------
    Damage
        If no content can be proven.
    """
    body = record[PREFIX.size :]
    if len(body) >= _HEAD.size:
        _, _, size, crc = _HEAD.unpack_from(body)
        for compression in _COMPRESSIONS:
            packed = body[_HEAD.size + 4 + len(compression) + 8 :]
            contents = _uncompressed(packed, body, size) if not compression else _whole(packed, compression)
            for content in contents:
                if (mended := _mended(content, size, crc, not compression)) is not None:
                    return memoryview(mended)
    raise Damage("a chunk is damaged")


def cut_chunk(record: memoryview) -> memoryview:
    """Return the records of a Chunk without end, up to the last whole one that can be decompressed."""
    body = record[PREFIX.size :]
    for compression in _COMPRESSIONS:
        name = len(compression).to_bytes(4, "little") + compression.encode()
        if body[_HEAD.size : _HEAD.size + len(name)] == name:
            content, _ = _unpack(body[_HEAD.size + len(name) + 8 :], compression)
            return memoryview(content)[: _end_of_records(content)]
    return memoryview(b"")


def _limit(packed: int) -> int:
    """Return the largest accepted content [B] of a compressed size [B]."""
    return max(_ALWAYS, packed, min(_RATIO * packed, MAX_CHUNK))


def _unpack(packed: memoryview, compression: str, limit: int | None = None) -> tuple[bytes, int | None]:
    """Return the content and the number of compressed bytes used; None if the data has no end.

    Decompression stops soon after `limit` bytes. It proceeds in small steps, to keep the data before damage.
    """
    limit = _limit(len(packed)) if limit is None else limit
    if not compression or not packed:
        return bytes(packed), len(packed)
    zstd = compression == "zstd"
    unpacker = zstandard.ZstdDecompressor().decompressobj() if zstd else lz4.frame.LZ4FrameDecompressor()
    pieces: list[bytes] = []
    found = position = 0
    try:
        while position < len(packed) and not unpacker.eof and found <= limit:
            pieces.append(unpacker.decompress(packed[position : position + _STEP]))
            position = min(position + _STEP, len(packed))
            found += len(pieces[-1])
    except (zstandard.ZstdError, RuntimeError, ValueError, MemoryError, EOFError):
        return b"".join(pieces), None
    return b"".join(pieces), position - len(unpacker.unused_data or b"") if unpacker.eof else None


def _whole(packed: memoryview, compression: str) -> Iterator[bytes]:
    content, used = _unpack(packed, compression)
    if used is not None and content:
        yield content


def _uncompressed(packed: memoryview, body: memoryview, size: int) -> Iterator[bytes]:
    """Yield the possible contents: those of the two stated lengths, and the whole rest of the record."""
    written = int.from_bytes(body[_HEAD.size + 4 : _HEAD.size + 12], "little")
    for length in dict.fromkeys((size, written, len(packed))):
        if 0 < length <= len(packed):
            yield bytes(packed[:length])


def _mended(content: bytes, size: int, crc: int, uncompressed: bool) -> bytes | None:
    """Return the content if it is proven, with one flipped bit corrected; else None."""
    difference = zlib.crc32(content) ^ crc
    if crc and not difference:
        return content
    unchecked = not crc or crc.bit_count() == 1  # no checksum, or one with a single flipped bit
    if difference.bit_count() == 1 or (unchecked and (len(content) ^ size).bit_count() <= 1):
        return _framed(content)
    if crc and uncompressed and len(content) == size:
        mended = _without_flipped_bit(content, difference)
        if mended is not None and _end_of_records(mended) == len(mended):
            return mended
    return None


def _framed(content: bytes) -> bytes | None:
    """Return the content with single flipped bits in prefixes corrected; None if that is not enough."""
    source, mended = _Content(io.BytesIO(content), len(content)), bytearray(content)
    position = 0
    while position < len(content):
        prefix = read_prefix(source, position)
        if prefix is None:
            return None
        for other in (prefix, *one_bit_variants(prefix)):
            allowed = other.opcode in _INNER and is_plausible(prefix, other)
            if allowed and fits(source, other) and _ends_well(source, other.end):
                break
        else:
            return None
        PREFIX.pack_into(mended, position, other.opcode, other.length)
        position = other.end
    return bytes(mended)


def _ends_well(source: _Content, position: int) -> bool:
    """Whether the content ends at a position, or a record starts, with at most one flipped bit."""
    if position == source.size:
        return True
    prefix = read_prefix(source, position)
    return prefix is not None and any(
        other.opcode in _INNER and fits(source, other) for other in (prefix, *one_bit_variants(prefix))
    )


def _without_flipped_bit(content: bytes, difference: int) -> bytes | None:
    """Return the content with the single bit corrected that explains the difference of the checksums.

    CRC-32 is linear, and differs for every single bit of up to 512 MiB. The difference is propagated back one
    byte at a time until it equals that of a bit in the present byte. Other damage resembles one flipped bit
    in one of 2**32 / (8 * length) cases.
    """
    table = [zlib.crc32(bytes([byte])) ^ zlib.crc32(b"\0") for byte in range(256)]
    before = {entry >> 24: (entry, byte) for byte, entry in enumerate(table)}
    bits = {table[1 << bit]: 1 << bit for bit in range(8)}
    for place in range(len(content) - 1, -1, -1):
        if difference in bits:
            mended = bytearray(content)
            mended[place] ^= bits[difference]
            return bytes(mended)
        entry, byte = before[difference >> 24]
        difference = ((difference ^ entry) << 8 | byte) & 0xFFFFFFFF
    return None


def _end_of_records(content: bytes) -> int:
    """Return the end of the last whole record of a kind that a chunk may hold."""
    end = 0
    try:
        for opcode, offset, inner in records(memoryview(content)):
            if opcode not in _INNER and opcode < PRIVATE:
                break
            end = offset + PREFIX.size + len(inner)
    except Damage:
        pass
    return end
