"""Collection of the records of an MCAP file, one after the other, into a Part."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import TypeVar

from mcap import records as kinds
from mcap.records import AttachmentIndex, Channel, ChunkIndex, Schema

from soro_core.bag.blocks import Block, Run
from soro_core.bag.chunks import MAX_CHUNK, cut_chunk, open_chunk, salvage_chunk
from soro_core.bag.part import Part
from soro_core.bag.prefixes import RecordPrefix, has_record
from soro_core.bag.records import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    METADATA,
    PREFIX,
    SCHEMA,
    Damage,
    Padding,
    message_key,
    parse,
    records,
)

# Kinds of records before the end of the data, without schemas and channels, which the index repeats.
DATA = (MESSAGE, CHUNK, MESSAGE_INDEX, METADATA, ATTACHMENT, DATA_END)
_NAMED = (SCHEMA, CHANNEL)

Named = TypeVar("Named", Schema, Channel)


class Collector:
    """Fills a Part from records in the order of the file.

    Parameters
    ----------
    part : Part
        The part to fill.
    proven : bool
        Whether present schemas and channels of the part take precedence over records that contradict them.

    Attributes
    ----------
    data_ended, finished : bool
        Whether the records of the end of the data, and of the file, have been read.
    index : dict or None
        Log times and offsets of the messages in the last chunk by channel; None if it cannot be read.
    unknown : Counter
        Number of messages of channels that the file does not describe, by channel.
    """

    def __init__(self, part: Part, proven: bool) -> None:
        self.data_ended = self.finished = False
        self.index: dict[int, list[tuple[int, int]]] | None = None
        self.unknown: Counter[int] = Counter()
        self._part, self._proven = part, proven
        self._run = Run(part.blocks)

    def close(self) -> None:
        """End the block of messages outside chunks."""
        self._run.close()

    def take(self, prefix: RecordPrefix, exact: bool, prefix_is_right: bool = True) -> None:
        """Add a record to the part.

        Parameters
        ----------
        prefix : RecordPrefix
            Prefix of the record.
        exact : bool
            Refuse bytes behind the last field, and damage.
        prefix_is_right : bool
            Whether the file holds this prefix undamaged.

        Raises
        ------
        Damage
            If the record is refused; the part is then unchanged.
        """
        part, opcode = self._part, prefix.opcode
        if exact and self.data_ended and opcode in DATA:
            raise Damage("data behind the end of the data")
        if opcode == FOOTER:
            self._take_footer(prefix)
        elif opcode == MESSAGE:
            self._take_message(prefix, prefix_is_right)
        elif opcode in (HEADER, *_NAMED, *DATA):
            self._take_other(prefix, exact)
            self._run.close()
        elif not self.data_ended:
            raise Damage("a record of the index is in the data")
        if self.data_ended and opcode in DATA:
            part.note(prefix.position, "data behind the end of the data", left_out=False)
        if opcode in DATA:
            self.data_ended = opcode == DATA_END

    def take_cut_chunk(self, position: int) -> int:
        """Add the readable messages of a chunk whose end is missing; return their number."""
        part = self._part
        before = part.message_count
        raw = part.read(position, min(part.size - position, MAX_CHUNK))
        try:
            self._add_chunk(Block(0, 0, position, len(raw), cut_chunk), raw)
        except Damage as damage:
            part.note(position, damage)
        return part.message_count - before

    def _take_other(self, prefix: RecordPrefix, exact: bool) -> None:
        part, opcode = self._part, prefix.opcode
        raw = part.read(prefix.position, PREFIX.size + prefix.length)
        if opcode == CHUNK:
            self._take_chunk(prefix, raw, exact)
            return
        record = self._parse(prefix, raw, exact)
        if isinstance(record, kinds.Header):
            if prefix.position != len(MAGIC):
                raise Damage("a second header")
            part.profile = record.profile
        elif isinstance(record, Schema):
            self._register(part.schemas, record, prefix.position)
        elif isinstance(record, Channel):
            self._register(part.channels, record, prefix.position)
        elif isinstance(record, kinds.Metadata):
            part.metadata.append((record.name, record.metadata))
        elif isinstance(record, kinds.Attachment):
            part.attachments.append(
                AttachmentIndex(
                    offset=prefix.position,
                    length=len(raw),
                    log_time=record.log_time,
                    create_time=record.create_time,
                    data_size=len(record.data),
                    name=record.name,
                    media_type=record.media_type,
                )
            )
        elif isinstance(record, kinds.MessageIndex):
            self._take_index(prefix, record, exact)
        elif isinstance(record, kinds.DataEnd) and self._part.contradicts(
            record.data_section_crc, prefix.position
        ):
            part.note(prefix.position, "the checksum of the data is wrong", left_out=False)

    def _parse(self, prefix: RecordPrefix, raw: memoryview, exact: bool) -> kinds.McapRecord:
        """Parse a record; refuse bytes behind its fields if `exact`, or if they are another record."""
        try:
            return parse(prefix.opcode, raw[PREFIX.size :], exact=True)
        except Padding as padding:
            # If the length is damaged and too large, another record follows the fields.
            if exact or has_record(self._part, prefix.position + PREFIX.size + padding.used):
                raise
            return parse(prefix.opcode, raw[PREFIX.size :])

    def _take_message(self, prefix: RecordPrefix, prefix_is_right: bool) -> None:
        part = self._part
        body = part.read(prefix.position, PREFIX.size + prefix.length)[PREFIX.size :]
        channel_id, log_time = message_key(body)
        if channel_id not in part.channels:
            if not prefix_is_right:
                raise Damage("a message of an unknown channel")
            self.unknown[channel_id] += 1
            return
        if self._is_other(body):
            raise Damage("an index or a channel that is marked as a message")
        self._run.add(prefix, log_time, prefix_is_right)
        part.counts[channel_id] += 1

    def _take_chunk(self, prefix: RecordPrefix, raw: memoryview, exact: bool) -> None:
        place = prefix.position, len(raw)
        try:
            self._parse(prefix, raw, exact)
            self._add_chunk(Block(0, 0, *place, open_chunk), raw)
        except Damage as damage:
            if exact:
                raise
            try:
                self._add_chunk(Block(0, 0, *place, salvage_chunk), raw)
            except Damage:
                raise damage from None
            # Other damage may resemble the corrected bit, so repair keeps the original.
            self._part.lossy = True
            self._part.note(prefix.position, f"{damage}; its messages were recovered", left_out=False)

    def _add_chunk(self, block: Block, raw: memoryview) -> None:
        """Add the schemas, channels and message counts of a chunk."""
        part = self._part
        index: dict[int, list[tuple[int, int]]] = defaultdict(list)
        named: list[Schema | Channel] = []
        damages: list[Damage] = []
        content = block.unpack(raw)
        for opcode, offset, body in records(content):
            if opcode == MESSAGE:
                channel_id, log_time = message_key(body)
                index[channel_id].append((log_time, offset))
            elif opcode in _NAMED:
                try:
                    record = parse(opcode, body)
                except Damage as error:  # the index may describe the topic
                    damages.append(error)
                    continue
                assert isinstance(record, Schema | Channel)
                named.append(record)
        for damage in damages:
            part.note(block.offset, damage)
        for record in named:
            if isinstance(record, Schema):
                self._register(part.schemas, record, block.offset)
            else:
                self._register(part.channels, record, block.offset)
        unknown = {key: len(items) for key, items in index.items() if key not in part.channels}
        self.unknown.update(unknown)
        unpack = salvage_chunk if unknown and block.unpack is open_chunk else block.unpack
        self.index = index
        times = [time for items in index.values() for time, _ in items]
        start, end = min(times, default=0), max(times, default=0)
        for channel_id, items in index.items():
            if channel_id not in unknown:
                part.counts[channel_id] += len(items)
        if times:
            part.blocks.append(Block(start, end, block.offset, block.length, unpack))
        if unpack is open_chunk:
            self._expect_index(block, raw, start, end, len(content))

    def _expect_index(self, block: Block, raw: memoryview, start: int, end: int, size: int) -> None:
        """Add the index entry of a chunk, and note wrong times."""
        part, chunk = self._part, parse(CHUNK, raw[PREFIX.size :])
        assert isinstance(chunk, kinds.Chunk)
        part.compression = chunk.compression
        if (chunk.message_start_time, chunk.message_end_time) != (start, end):
            part.note(block.offset, "the times of a chunk are not those of its messages", left_out=False)
        part.chunks.append(
            ChunkIndex(
                chunk_length=block.length,
                chunk_start_offset=block.offset,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=end,
                message_index_length=0,
                message_index_offsets={},
                message_start_time=start,
                uncompressed_size=size,
            )
        )

    def _take_index(self, prefix: RecordPrefix, record: kinds.MessageIndex, exact: bool) -> None:
        if self.index is None:
            return
        if sorted(record.records) != sorted(self.index.get(record.channel_id, [])):
            if exact:
                raise Damage("an index of another chunk")
            self._part.note(prefix.position, "the index of a chunk is wrong", left_out=False)
        elif self._part.chunks:
            chunk = self._part.chunks[-1]
            chunk.message_index_offsets[record.channel_id] = prefix.position
            chunk.message_index_length += PREFIX.size + prefix.length

    def _is_other(self, body: memoryview) -> bool:
        """Whether a body is that of the last chunk's index or of a channel: kinds one bit off a message."""
        try:
            record = parse(MESSAGE_INDEX, body, exact=True)
        except Damage:
            try:
                return bool(parse(CHANNEL, body, exact=True))
            except Damage:
                return False
        assert isinstance(record, kinds.MessageIndex)
        return bool(record.records) and record.records == (self.index or {}).get(record.channel_id)

    def _register(self, table: dict[int, Named], record: Named, position: int) -> None:
        known = table.setdefault(record.id, record)
        if known != record:
            kind = type(record).__name__.lower()
            self._part.note(position, f"{kind} {record.id} contradicts another one", left_out=False)
            if not (self._proven or self.data_ended):
                table[record.id] = record

    def _take_footer(self, prefix: RecordPrefix) -> None:
        part = self._part
        tail = bytes(part.read(prefix.end, min(len(MAGIC), part.size - prefix.end)))
        if prefix.length != 20 or not (tail == MAGIC or prefix.end + len(MAGIC) >= part.size):
            raise Damage("a footer that is not at the end")
        self.finished = True
