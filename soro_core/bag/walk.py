"""Reading an MCAP file record by record: unfinished or damaged files, and files without an index."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from dataclasses import replace

from mcap import records as kinds
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Chunk

from soro_core.bag.chunks import inner, message_key, most, unpack
from soro_core.bag.part import CUT, MOST_DESCRIBED, OUTSIDE, Block, Part
from soro_core.bag.records import MAGIC, PREFIX, PRIVATE, Damage, Prefix, Source, length_of
from soro_core.bag.search import LEAST_MESSAGE, MESSAGE, Search
from soro_core.errors import BagError

# Size of blocks of messages outside chunks [B].
_RUN_BYTES = 1 << 20
# Most bytes that are read of records whose length leads nowhere.
_MOST_DOUBTED = 1 << 28


def walk(part: Part, places: Sequence[int] = (), has_chunks: bool = False, proven: bool = False) -> None:
    """Fill a Part from the records of its file.

    Whatever is damaged is left out, and noted as a problem of the part: of a wrong kind or length that
    record, else the chunk. Behind a length without sense the walk goes on at the next of `places`, or at
    the next bytes that are a chunk.

    Parameters
    ----------
    part : Part
        The part to fill; its `schemas` and `channels` may hold those of the index.
    places : sequence of int
        Where the index says that records begin, in their order [B].
    has_chunks : bool
        Whether the index says that there are chunks.
    proven : bool
        Whether a checksum proves the index: its schemas and channels then precede those of the records.

    Raises
    ------
    BagError
        If nothing can be read.
    """
    _Walk(part, places, has_chunks, proven).run()


class _Walk:
    def __init__(self, part: Part, places: Sequence[int], has_chunks: bool, proven: bool) -> None:
        self._part, self._source = part, part.source
        self._search, self._proven = Search(part, places), proven
        # Number and digest of the messages of each channel in the last chunk that have had no index;
        # None where that chunk is lost.
        self._index: dict[int, tuple[int, int]] | None = {}
        self._unknown: set[int] = set()
        # Of the work that a file may ask for.
        self._unknown_count = self._unpacked = self._records = self._indexes = 0
        self._doubted = 0
        self._has_chunks = has_chunks
        self._data_ended = self._is_cut = False

    def run(self) -> None:
        """Walk through the file."""
        part, position = self._part, len(MAGIC)
        while position < part.size and not self._data_ended and not part.over:
            position = self._step(position)
            self._bound()
        if position == len(MAGIC):
            raise BagError("damaged: its header cannot be read", part.path, "damaged")
        self._note_end(position)

    def _step(self, position: int) -> int:
        """Add the record at a position; return the position of the next one."""
        part, source = self._part, self._source
        prefix = source.prefix(position)
        if prefix is None:
            return self._behind(position, None)
        fits = prefix.end <= part.size
        follows_on = fits and source.begins_record(prefix.end)
        right, damage = prefix, f"a record of the unknown kind {prefix.opcode}"
        try:
            if prefix.opcode == Opcode.MESSAGE:
                if (behind := self._take_messages(position)) > position:
                    return behind
                damage = "a message that is none"
            elif follows_on and prefix.opcode >= PRIVATE:
                self._records += 1
                part.private_count += 1
                return prefix.end
            elif follows_on and prefix.opcode == Opcode.MESSAGE_INDEX:
                length = int.from_bytes(source.bytes(prefix.start + 11, prefix.start + 15), "little")
                right = self._right(prefix, prefix.start + 15 + length)
                self._take_index(right)
                return right.end
            elif follows_on and 0 < prefix.opcode < Opcode.DATA_END + 1:
                record = source.parse(prefix)
                right = self._right(prefix, position + length_of(record))
                self._take(right, record)
                return right.end
        except Damage as error:
            damage = str(error)  # the error would keep the content of a chunk
        if follows_on:
            part.note(position, damage)
            if prefix.opcode == Opcode.CHUNK:
                self._index = None
            return right.end
        if (end := self._take_by_fields(prefix)) is not None:
            return end
        return self._behind(position, prefix)

    def _right(self, prefix: Prefix, end: int) -> Prefix:
        """Return the prefix with the end of its fields, if another record is there: else they are padded."""
        if end >= prefix.end or not self._source.begins_record(end):
            return prefix
        self._part.note(prefix.start, "the length of a record is wrong", left_out=False)
        return prefix._replace(end=end)

    def _take_by_fields(self, prefix: Prefix) -> int | None:
        """Add a record whose length leads nowhere, if its fields lead to the next one, and return its end."""
        part, source = self._part, self._source
        found = source.by_fields(prefix) if self._doubted < _MOST_DOUBTED else None
        if found is None:
            return None
        record, end = found
        self._doubted += end - prefix.start
        if end != prefix.end:
            if not source.begins_record(end):
                return None
            part.note(prefix.start, "the length of a record is wrong", left_out=False)
        right = prefix._replace(end=end)
        try:
            self._take_index(right) if record is None else self._take(right, record)
        except Damage as error:
            part.note(prefix.start, error)
        return end

    def _behind(self, position: int, prefix: Prefix | None) -> int:
        """Go on behind bytes that are no record: return the position of the next one, or the end."""
        part = self._part
        found = self._search.next(position, self._has_chunks)
        if found is not None:
            if prefix is not None and prefix.end + PREFIX.size < found and self._search.is_next(prefix):
                # The next message is damaged, not this one.
                position = self._take_messages(position, once=True)
            part.note(position, f"{found - position} bytes cannot be read")
            self._index = None
            return found
        if position == len(MAGIC):
            raise BagError("damaged: its header cannot be read", part.path, "damaged")
        self._is_cut = part.lossy = True
        is_chunk = prefix is not None and prefix.opcode == Opcode.CHUNK
        saved = self._take_cut_chunk(position) if is_chunk else 0
        kept = f"; {saved} messages of the last chunk were saved" if saved else ""
        part.remarks.append(
            f"the end is missing: no whole record from byte {position} of {part.size} on{kept}"
        )
        return part.size

    # Records -----------------------------------------------------------------------------------
    def _take(self, prefix: Prefix, record: kinds.McapRecord) -> None:
        """Add a record; raise Damage if it does not belong here."""
        part = self._part
        self._records += 1
        if isinstance(record, Chunk):
            self._has_chunks = True
            self._take_chunk(prefix, record)
        elif isinstance(record, kinds.Schema | kinds.Channel | kinds.Metadata):
            part.describe(record, prefix.end - prefix.start, prefix.start, self._proven)
        elif isinstance(record, kinds.Attachment):
            part.attach(
                AttachmentIndex(
                    offset=prefix.start,
                    length=prefix.end - prefix.start,
                    log_time=record.log_time,
                    create_time=record.create_time,
                    data_size=len(record.data),
                    name=record.name,
                    media_type=record.media_type,
                )
            )
        elif isinstance(record, kinds.Header) and prefix.start == len(MAGIC):
            part.profile = record.profile
        elif isinstance(record, kinds.DataEnd) and prefix.end - prefix.start == PREFIX.size + 4:
            crc = record.data_section_crc
            if crc and crc != self._source.checksum(prefix.start):
                part.note(prefix.start, "the checksum of the data is wrong", left_out=False)
            self._data_ended = True
        else:
            raise Damage(f"a {type(record).__name__} among the data")

    def _take_messages(self, position: int, once: bool = False) -> int:
        """Add neighbouring messages outside chunks as a block, or `once` the first one; return its end."""
        part, source = self._part, self._source
        window = source.bytes(position, min(position + _RUN_BYTES, part.size))
        at, low, high = 0, 1 << 64, 0
        while at + MESSAGE.size <= len(window):
            opcode, length, channel_id, _, log_time = MESSAGE.unpack_from(window, at)
            end = at + PREFIX.size + length
            if opcode != Opcode.MESSAGE or length < LEAST_MESSAGE or position + end > part.size:
                break
            sound = once or source.begins_record(position + end, is_cut=True)
            if not sound or self._is_other(channel_id, window, at):
                break
            if channel_id in part.channels:
                part.counts[channel_id] += 1
                low, high = min(low, log_time), max(high, log_time)
            else:
                self._unknown.add(channel_id)
                self._unknown_count += 1
            at = end
            if once:
                break
        if low <= high:
            part.blocks.append(Block(low, high, position, at, OUTSIDE))
        return position + at

    def _is_other(self, channel_id: int, window: bytes, at: int) -> bool:
        """Whether a message is the index of the last chunk or its channel, whose kinds are one bit off."""
        length, begin = int.from_bytes(window[at + 1 : at + 9], "little"), at + PREFIX.size
        text = int.from_bytes(window[begin + 4 : begin + 8], "little")
        channel = self._part.channels.get(channel_id)
        if channel is not None and text and window[begin + 8 : begin + 8 + text] == channel.topic.encode():
            return True
        count, _ = (self._index or {}).get(channel_id, (0, 0))
        return (
            count > 0
            and length == 6 + 16 * count
            and window[begin + 2 : begin + 6] == struct.pack("<I", 16 * count)
        )

    def _take_chunk(self, prefix: Prefix, chunk: Chunk) -> None:
        self._index = None
        if chunk.uncompressed_size <= most(len(chunk.data)):
            self._unpacked += chunk.uncompressed_size
        content = unpack(chunk)
        block = Block(0, 0, prefix.start, prefix.end - prefix.start, len(content))
        index, start, end = self._add_content(content, block.offset)
        if (chunk.message_start_time, chunk.message_end_time) != (start, end):
            self._part.note(
                block.offset, "the times of a chunk are not those of its messages", left_out=False
            )
        self._index = index
        self._part.compression = chunk.compression
        packed = hash((chunk.compression, len(chunk.data)))
        self._part.blocks.append(replace(block, start_ns=start, end_ns=end, index=packed))

    def _take_cut_chunk(self, position: int) -> int:
        """Add the readable messages of a chunk whose end is missing; return their number."""
        part = self._part
        before, block = part.message_count, Block(0, 0, position, part.size - position, CUT)
        try:
            _, start, end = self._add_content(part.content(block), position)
        except Damage as damage:
            part.note(position, damage)
            return 0
        if part.message_count > before:
            part.blocks.append(replace(block, start_ns=start, end_ns=end))
        return part.message_count - before

    def _add_content(self, content: memoryview, position: int) -> tuple[dict[int, tuple[int, int]], int, int]:
        """Add what a chunk holds; return number and digest of its messages by channel, and their times."""
        part = self._part
        index: dict[int, tuple[int, int]] = {}
        named: list[tuple[int, int, int]] = []
        low, high = 1 << 64, 0
        for opcode, start, end in inner(content):
            if opcode == Opcode.MESSAGE:
                channel_id, log_time = message_key(content, start)
                count, digest = index.get(channel_id, (0, 0))
                index[channel_id] = count + 1, digest + hash((log_time, start))
                low, high = min(low, log_time), max(high, log_time)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                named.append((opcode, start, end))
        for opcode, start, end in named:
            try:
                if end - start > MOST_DESCRIBED:
                    raise Damage("more descriptions than any recorder writes")
                source = Source(io.BytesIO(content[start:end]), end - start)
                record = source.parse(Prefix(opcode, 0, end - start))
                part.describe(record, end - start, position, self._proven)
            except Damage as damage:  # the index may describe the topic
                part.note(position, damage)
        for channel_id, (count, _) in index.items():
            if channel_id in part.channels:
                part.counts[channel_id] += count
            else:
                self._unknown.add(channel_id)
                self._unknown_count += count
        return index, (low if index else 0), high

    def _take_index(self, prefix: Prefix) -> None:
        """Compare the index of the last chunk's messages of one channel."""
        part = self._part
        self._indexes += 1
        body = self._source.bytes(prefix.start + PREFIX.size, prefix.end)
        length = int.from_bytes(body[2:6], "little")
        if len(body) < 6 + length or length % 16:
            raise Damage("an index that is none")
        if self._index is None or not length:
            return
        channel_id = int.from_bytes(body[:2], "little")
        if channel_id not in self._index:
            raise Damage("an index without its chunk")
        count, digest = self._index.pop(channel_id)
        if length != 16 * count or sum(map(hash, struct.iter_unpack("<QQ", body[6 : 6 + length]))) != digest:
            part.note(prefix.start, "the index of a chunk is wrong", left_out=False)
            return
        block = part.blocks[-1]
        length = prefix.end - prefix.start
        digest = block.index + hash((channel_id, prefix.start)) + length
        part.blocks[-1] = replace(block, index=digest, indexes=block.indexes + length)

    # Limits, and the end ------------------------------------------------------------------------
    def _bound(self) -> None:
        """End a walk that is more work than any recorder's file of this size."""
        part = self._part
        limits = {
            "bytes in chunks": (self._unpacked, max(1 << 28, 32 * part.size)),
            "messages": (part.message_count + self._unknown_count, 1_000_000 + part.size // 16),
            "indexes": (self._indexes, 100_000 + part.size // 50),
            "records": (self._records, 100_000 + part.size // 160),
        }
        for name, (found, limit) in limits.items():
            if found > limit:
                part.over = f"more than {limit} {name} in a file of {part.size} bytes"

    def _note_end(self, position: int) -> None:
        """Note what is missing at the end of the file."""
        part, source = self._part, self._source
        if part.over:
            part.lossy = True
            part.remarks.append(f"{part.over}; the rest is left out")
        if self._unknown:
            part.lossy = True
            channels = ", ".join(map(str, sorted(self._unknown)[:10]))
            part.remarks.append(f"{self._unknown_count} messages of unknown channels ({channels}); left out")
        if not self._data_ended:
            if not self._is_cut and not part.over:
                part.remarks.append("not closed by its recorder: the index is missing")
            return
        while (prefix := source.prefix(position)) is not None and prefix.opcode != Opcode.FOOTER:
            if prefix.end > part.size or not 0 < prefix.opcode <= Opcode.DATA_END:
                prefix = None
                break
            position = prefix.end
        if prefix is None or source.bytes(min(prefix.end, part.size), part.size)[: len(MAGIC)] != MAGIC:
            if not part.remarks:
                part.remarks.append("the index at the end is cut or damaged; all messages are there")
        elif rest := part.size - prefix.end - len(MAGIC):
            part.note(prefix.end + len(MAGIC), f"{rest} bytes behind the end of the recording")
