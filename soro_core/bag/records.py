"""Parsing of MCAP records with checks of all lengths and checksums (MCAP format 0).

The field layouts are those of the `mcap` library, whose own reader returns short data from a cut or damaged
file without an error.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

from mcap import records as kinds
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Message

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA = int(Opcode.HEADER), int(Opcode.FOOTER), int(Opcode.SCHEMA)
CHANNEL, MESSAGE, CHUNK = int(Opcode.CHANNEL), int(Opcode.MESSAGE), int(Opcode.CHUNK)
MESSAGE_INDEX, CHUNK_INDEX = int(Opcode.MESSAGE_INDEX), int(Opcode.CHUNK_INDEX)
ATTACHMENT, ATTACHMENT_INDEX = int(Opcode.ATTACHMENT), int(Opcode.ATTACHMENT_INDEX)
STATISTICS, METADATA = int(Opcode.STATISTICS), int(Opcode.METADATA)
METADATA_INDEX, SUMMARY_OFFSET = int(Opcode.METADATA_INDEX), int(Opcode.SUMMARY_OFFSET)
DATA_END = int(Opcode.DATA_END)
# Kinds of records from here on are private to their writers.
PRIVATE = 0x80

PREFIX = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_KINDS: dict[int, type[kinds.McapRecord]] = {
    HEADER: kinds.Header,
    FOOTER: kinds.Footer,
    SCHEMA: kinds.Schema,
    CHANNEL: kinds.Channel,
    CHUNK: kinds.Chunk,
    MESSAGE_INDEX: kinds.MessageIndex,
    CHUNK_INDEX: kinds.ChunkIndex,
    ATTACHMENT: kinds.Attachment,
    ATTACHMENT_INDEX: kinds.AttachmentIndex,
    STATISTICS: kinds.Statistics,
    METADATA: kinds.Metadata,
    METADATA_INDEX: kinds.MetadataIndex,
    SUMMARY_OFFSET: kinds.SummaryOffset,
    DATA_END: kinds.DataEnd,
}


class Damage(Exception):  # noqa: N818 - internal signal, becomes a problem or a BagError with the place
    """A record is incomplete or contradicts itself."""


class Padding(Damage):
    """A record is longer than its fields, which the format allows; `used` is the length of the fields [B]."""

    def __init__(self, used: int) -> None:
        super().__init__("a record is longer than its fields")
        self.used = used


class _Fields(ReadDataStream):
    """Reads the fields of one record; raises Damage if the record is too short."""

    def __init__(self, body: memoryview) -> None:
        self._body = body
        self._position = 0

    @property
    def count(self) -> int:
        return self._position

    def read(self, length: int) -> bytes:
        end = self._position + length
        if end > len(self._body):
            raise Damage("a record ends before its fields do")
        piece = bytes(self._body[self._position : end])
        self._position = end
        return piece


def parse(opcode: int, body: memoryview, exact: bool = False) -> kinds.McapRecord:
    """Return a record of any kind but Message.

    Parameters
    ----------
    opcode : int
        Kind of the record.
    body : memoryview
        Bytes behind the prefix.
    exact : bool
        Raise Padding if bytes follow the last field.

    Raises
    ------
    Damage
        If the fields do not fit the body, a text is not UTF-8, or a checksum is wrong.
    """
    fields = _Fields(body)
    if opcode not in _KINDS:
        raise Damage(f"a record of the unknown kind {opcode}")
    try:
        record: kinds.McapRecord = _KINDS[opcode].read(fields)  # type: ignore[attr-defined]
    except UnicodeDecodeError:
        raise Damage("a text is no UTF-8") from None
    end = fields.count
    if opcode == ATTACHMENT:
        crc = int.from_bytes(body[end - 4 : end], "little")
        if crc and crc != zlib.crc32(body[: end - 4]):
            raise Damage("the checksum of an attachment is wrong")
    elif opcode != CHUNK and encoded(record) != body[:end]:
        raise Damage("the lengths in a record contradict each other")
    if exact and end != len(body):
        raise Padding(end)
    return record


def encoded(record: kinds.McapRecord) -> bytes:
    """Return the body of a record as bytes."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end()[PREFIX.size :])  # type: ignore[no-untyped-call]


def records(buffer: memoryview) -> Iterator[tuple[int, int, memoryview]]:
    """Yield (opcode, offset, body) of the records in a buffer; raise Damage at the first incomplete one."""
    position = 0
    while position < len(buffer):
        if position + PREFIX.size > len(buffer):
            raise Damage("a record is cut")
        opcode, length = PREFIX.unpack_from(buffer, position)
        start = position + PREFIX.size
        if not opcode or start + length > len(buffer):
            raise Damage("a record is cut")
        yield opcode, position, buffer[start : start + length]
        position = start + length


def parse_message(body: memoryview) -> Message:
    """Parse a Message record."""
    if len(body) < _MESSAGE.size:
        raise Damage("a message is cut")
    channel_id, sequence, log_time, publish_time = _MESSAGE.unpack_from(body)
    return Message(channel_id, log_time, bytes(body[_MESSAGE.size :]), publish_time, sequence)


def message_key(body: memoryview) -> tuple[int, int]:
    """Return (channel id, log time) of a Message record without copying its data."""
    if len(body) < _MESSAGE.size:
        raise Damage("a message is cut")
    channel_id, _, log_time, _ = _MESSAGE.unpack_from(body)
    return channel_id, log_time
