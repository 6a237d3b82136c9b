"""Prefixes of records, and the search for the next record in a damaged file.

The prefix of a record (kind and length) has no checksum. One flipped bit in it turns a chunk into an index,
or moves the start of the next record. A prefix is accepted if its record is consistent, and another one
follows.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import IO, Protocol

from soro_core.bag.records import (
    ATTACHMENT,
    ATTACHMENT_INDEX,
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    METADATA,
    METADATA_INDEX,
    PREFIX,
    PRIVATE,
    SCHEMA,
    STATISTICS,
    SUMMARY_OFFSET,
)

# Lengths of the bodies with empty texts and lists.
_LEAST = {
    HEADER: 8,
    FOOTER: 20,
    SCHEMA: 14,
    CHANNEL: 16,
    MESSAGE: 22,
    CHUNK: 40,
    MESSAGE_INDEX: 6,
    CHUNK_INDEX: 64,
    ATTACHMENT: 36,
    ATTACHMENT_INDEX: 48,
    STATISTICS: 46,
    METADATA: 8,
    METADATA_INDEX: 20,
    SUMMARY_OFFSET: 17,
    DATA_END: 4,
}
# Pattern of a prefix: a kind, and a length below 2**40.
_PREFIX = re.compile(rb"[\x02-\x0f](?=.{5}\0\0\0)", re.DOTALL)
_WINDOW = 1 << 22


class Source(Protocol):
    """Source of records: a file, or the content of a chunk."""

    stream: IO[bytes]
    size: int


@dataclass(frozen=True, slots=True)
class RecordPrefix:
    """Prefix of a record: kind, position in the source, and length of the body [B]."""

    opcode: int
    position: int
    length: int

    @property
    def end(self) -> int:
        """Position of the next record."""
        return self.position + PREFIX.size + self.length


def read_prefix(file: Source, position: int) -> RecordPrefix | None:
    """Return the prefix at a position; None if the source ends before."""
    raw = _bytes(file, position, PREFIX.size)
    if len(raw) < PREFIX.size:
        return None
    opcode, length = PREFIX.unpack(raw)
    return RecordPrefix(opcode, position, length)


def one_bit_variants(prefix: RecordPrefix) -> Iterator[RecordPrefix]:
    """Yield all prefixes that differ in one bit."""
    for bit in range(8):
        yield RecordPrefix(prefix.opcode ^ 1 << bit, prefix.position, prefix.length)
    for bit in range(64):
        yield RecordPrefix(prefix.opcode, prefix.position, prefix.length ^ 1 << bit)


def is_plausible(prefix: RecordPrefix, other: RecordPrefix) -> bool:
    """Whether a prefix may stand for another one; message bodies prove little, so kinds must agree."""
    same_kind = prefix.opcode == MESSAGE or DATA_END < prefix.opcode < PRIVATE
    return other.opcode != MESSAGE or same_kind


def fits(file: Source, prefix: RecordPrefix) -> bool:
    """Whether the source is long enough for a record, and the record for its fields."""
    known = prefix.opcode in _LEAST or prefix.opcode >= PRIVATE
    return known and prefix.length >= _LEAST.get(prefix.opcode, 0) and prefix.end <= file.size


def may_continue(file: Source, position: int) -> bool:
    """Whether a record, or the end of a file, may be at a position; cut, or with one flipped bit."""
    prefix = read_prefix(file, position)
    if prefix is None or fits(file, prefix):
        return True
    is_cut = prefix.opcode in _LEAST and _LEAST[prefix.opcode] <= prefix.length < 1 << 32
    return (
        is_cut
        or _bytes(file, position, len(MAGIC)) == MAGIC
        or any(fits(file, other) for other in one_bit_variants(prefix))
    )


def has_record(file: Source, position: int) -> bool:
    """Whether a record at a position fits into the source."""
    prefix = read_prefix(file, position)
    return prefix is not None and fits(file, prefix)


def find(file: Source, position: int, accept: Callable[[RecordPrefix], bool]) -> RecordPrefix | None:
    """Return the prefix of the first accepted record from a position on.

    Parameters
    ----------
    file : Source
        File, or content of a chunk.
    position : int
        Start of the search [B].
    accept : callable
        Function of a prefix that returns whether to accept its record.

    Returns
    -------
    RecordPrefix or None
        None if there is no accepted record that another record, or the end, follows.
    """
    while position < file.size:
        window = _bytes(file, position, _WINDOW + PREFIX.size)
        for match in _PREFIX.finditer(window):
            if match.start() >= _WINDOW:
                break
            opcode, length = PREFIX.unpack_from(window, match.start())
            prefix = RecordPrefix(opcode, position + match.start(), length)
            if (
                fits(file, prefix)
                and (prefix.end == file.size or has_record(file, prefix.end))
                and accept(prefix)
            ):
                return prefix
        position += _WINDOW
    return None


def _bytes(file: Source, position: int, length: int) -> bytes:
    file.stream.seek(position)
    return file.stream.read(length)
