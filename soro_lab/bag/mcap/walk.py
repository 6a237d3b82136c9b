"""Reading an MCAP file record by record: unfinished or damaged files, and files without an index."""

from __future__ import annotations

import io
import re
import struct
from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence

from mcap import records as kinds
from mcap.opcode import Opcode

from soro_core.errors import BagError
from soro_lab.bag.mcap.chunks import inner, message_key, most, unpack
from soro_lab.bag.mcap.part import OUTSIDE, Block, Part
from soro_lab.bag.mcap.records import MAGIC, PREFIX, PRIVATE, Damage, Prefix, Source

# Size of blocks of messages outside chunks [B].
_RUN_BYTES = 1 << 20
_MESSAGE_BYTES = PREFIX.size + 22
# The prefix of a record among the data, of up to a terabyte.
_LOOKS = re.compile(rb"[\x03-\x07\x09\x0c\x0f](?=.{5}\0{3})", re.DOTALL)
_WINDOW = 1 << 16
# Bytes of a search that take as long as one try.
_TRY = 64


class Walk:
    """Fills a Part from the records of its file.

    Whatever is damaged is left out, and noted: of a wrong kind or length that record, else the chunk. Behind
    a length without sense the walk goes on at the next place by the index, else where the next two records
    are.

    Parameters
    ----------
    part : Part
        The part to fill; its `schemas` and `channels` may hold those of the index.
    places : sequence of int
        Where records begin or end by the index, in their order [B]; the last one is the end of the data.
    has_chunks : bool
        Whether the index says that there are chunks.
    span_ns : tuple of int
        Log times of the first and the last message by the index.
    """

    def __init__(
        self,
        part: Part,
        places: Sequence[int] = (),
        has_chunks: bool = False,
        span_ns: tuple[int, int] = (0, 1 << 64),
    ) -> None:
        self._part, self._source = part, part.source
        self._places, self._has_chunks, self._span_ns = places, has_chunks, span_ns
        self._knows_chunks = has_chunks
        self._stop = places[-1] if places else part.size
        # Digests of the messages of each channel in the last chunk; None behind a damaged place.
        self._digests: Counter[int] | None = Counter()
        # The work that a file asks for.
        self._bytes = self._records = self._searched = 0

    def run(self) -> None:
        """Walk through the file; raise BagError if nothing can be read."""
        part, position = self._part, len(MAGIC)
        while position < self._stop and not part.over:
            position = self._step(position)
            self._bound()
        if part.over:
            part.lose(position, f"{part.over}; the rest is left out")
        if position == len(MAGIC) or (len(MAGIC) in part.losses and not part.blocks):
            raise BagError("damaged: nothing in it can be read", part.path, "damaged")

    def _step(self, position: int) -> int:
        """Add the record at a position; return the position of the next one."""
        prefix = self._source.prefix(position)
        follows = prefix is not None and self._is_followed(prefix)
        damage = "bytes that are no record"
        if prefix is not None and (follows or prefix.opcode == Opcode.CHUNK):
            try:
                self._take(prefix, follows)
                return prefix.end
            except Damage as error:
                damage = str(error)  # the error would keep the content of a chunk
        self._digests = None
        found = prefix.end if prefix is not None and follows else self._next(position)
        if found is None:
            damage = f"the end is missing: no whole record from here on, of {self._part.size} bytes"
        self._part.lose(position, damage)
        return self._stop if found is None else found

    # Where records are --------------------------------------------------------------------------
    def _is_followed(self, prefix: Prefix) -> bool:
        """Whether a record ends where another one begins, or where its damaged prefix does."""
        place = self._place(prefix.start)
        if prefix.end >= place:
            return prefix.end == place
        if self._source.begins(prefix.end):
            return True
        if self._knows_chunks:
            return False
        found = self._search(prefix.end, place)
        if found is None and not self._places:
            return True
        found = place if found is None else found
        # The prefix of the next one is damaged if it leads to the one behind it, up to one bit.
        raw = self._source.bytes(prefix.end + 1, prefix.end + PREFIX.size)
        length = found - prefix.end - PREFIX.size
        return length >= 0 and (int.from_bytes(raw, "little") ^ length).bit_count() <= 1

    def _next(self, position: int) -> int | None:
        """Return where the next record behind a position begins; None for nowhere."""
        place = self._place(position)
        found = None if self._knows_chunks else self._search(position + 1, place)
        return place if found is None and self._places else found

    def _place(self, position: int) -> int:
        """Return the next place behind a position by the index; without one the end."""
        first = bisect_right(self._places, position)
        return self._places[first] if first < len(self._places) else self._stop

    def _search(self, position: int, stop: int) -> int | None:
        """Return where the next two records begin by their looks, up to a position."""
        source, begin = self._source, position
        while begin < stop and not self._part.over:
            window = source.bytes(begin, min(begin + _WINDOW + PREFIX.size, self._part.size))
            self._searched += _WINDOW
            for match in _LOOKS.finditer(window[: stop - begin + PREFIX.size]):
                self._searched += _TRY
                prefix = source.prefix(begin + match.start())
                if prefix is not None and prefix.start < stop and source.begins(prefix.end):
                    return prefix.start
            begin += _WINDOW
            self._bound()
        return None

    # Records ------------------------------------------------------------------------------------
    def _take(self, prefix: Prefix, follows: bool) -> None:
        """Add a record; raise Damage if it does not belong here."""
        part, length = self._part, prefix.end - prefix.start
        if prefix.opcode == Opcode.MESSAGE:
            self._take_message(prefix)
            return
        self._records += 1
        if prefix.opcode == Opcode.MESSAGE_INDEX:
            self._take_message_index(prefix)
            return
        if prefix.opcode >= PRIVATE:
            part.private_count += 1
            return
        if prefix.opcode > Opcode.DATA_END:
            raise Damage(f"a record of the unknown kind {prefix.opcode}")
        record = self._source.parse(prefix)
        if isinstance(record, kinds.Chunk):
            self._bytes += max(length, min(record.uncompressed_size, most(len(record.data))))
            if not follows and length != PREFIX.size + 40 + len(record.compression) + len(record.data):
                raise Damage("the length of a chunk is wrong")
            self._take_chunk(prefix, record)
        elif isinstance(record, kinds.Schema | kinds.Channel | kinds.Metadata):
            part.describe(record, length)
        elif isinstance(record, kinds.Attachment):
            part.attach(
                kinds.AttachmentIndex(
                    offset=prefix.start,
                    length=length,
                    log_time=record.log_time,
                    create_time=record.create_time,
                    data_size=len(record.data),
                    name=record.name,
                    media_type=record.media_type,
                )
            )
        elif isinstance(record, kinds.Header) and prefix.start == len(MAGIC):
            part.profile = record.profile
        elif isinstance(record, kinds.DataEnd) and length == PREFIX.size + 4:
            crc = record.data_section_crc
            if crc and crc != self._source.checksum(prefix.start):
                part.remark("the checksum of the data is wrong")
            self._stop = prefix.end
        else:
            raise Damage(f"a {type(record).__name__} among the data")

    def _take_message(self, prefix: Prefix) -> None:
        """Add a message outside chunks to the block before it, or as a new one."""
        part, length = self._part, prefix.end - prefix.start
        channel_id, log_time = message_key(self._source.bytes(prefix.start, prefix.start + _MESSAGE_BYTES), 0)
        # A chunk's message index or a channel whose kind is damaged looks like a message.
        if self._has_chunks or not self._span_ns[0] <= log_time <= self._span_ns[1]:
            raise Damage("a message outside the chunks or the time of the recording")
        if channel_id not in part.channels:
            raise Damage(f"a message of the unknown channel {channel_id}")
        part.counts[channel_id] += 1
        block = part.blocks[-1] if part.blocks else None
        if block and block.offset + block.length == prefix.start and block.length < _RUN_BYTES:
            part.blocks[-1] = Block(
                min(block.start_ns, log_time),
                max(block.end_ns, log_time),
                block.offset,
                block.length + length,
                OUTSIDE,
            )
        else:
            part.blocks.append(Block(log_time, log_time, prefix.start, length, OUTSIDE))

    def _take_chunk(self, prefix: Prefix, chunk: kinds.Chunk) -> None:
        self._has_chunks, self._digests = True, None
        part, content = self._part, unpack(chunk)
        counts: Counter[int] = Counter()
        digests: Counter[int] = Counter()
        low, high = 1 << 64, 0
        for opcode, start, _ in inner(content):
            if opcode == Opcode.MESSAGE:
                channel_id, log_time = message_key(content, start)
                counts[channel_id] += 1
                digests[channel_id] += hash((log_time, start))
                low, high = min(low, log_time), max(high, log_time)
        self._describe(prefix.start, content)
        times = (low, high) if counts else (0, 0)
        if (chunk.message_start_time, chunk.message_end_time) != times:
            part.remark(f"byte {prefix.start}: the times of a chunk are not those of its messages")
        if unknown := sorted(counts.keys() - part.channels.keys()):
            part.lose(prefix.start, f"messages of unknown channels ({', '.join(map(str, unknown[:10]))})")
        part.counts.update({key: count for key, count in counts.items() if key in part.channels})
        part.compression, self._digests = chunk.compression, digests
        part.blocks.append(Block(*times, prefix.start, prefix.end - prefix.start, len(content)))

    def _describe(self, position: int, content: memoryview) -> None:
        """Add the schemas and channels in a chunk; where one is damaged, the index may describe the topic."""
        for opcode, start, end in inner(content):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                try:
                    source = Source(io.BytesIO(content[start:end]), end - start)
                    record = source.parse(Prefix(opcode, 0, end - start))
                    assert isinstance(record, kinds.Schema | kinds.Channel)
                    self._part.describe(record, end - start)
                except Damage as damage:
                    self._part.lose(position, damage)

    def _take_message_index(self, prefix: Prefix) -> None:
        """Compare the index of the last chunk's messages of one channel."""
        if self._digests is None:
            return
        body = self._source.bytes(prefix.start + PREFIX.size, prefix.end)
        channel_id, length = struct.unpack_from("<HI", body)
        if length > len(body) - 6 or length % 16:
            raise Damage("an index that is none")
        digest = sum(hash(entry) for entry in struct.iter_unpack("<QQ", body[6 : 6 + length]))
        if digest != self._digests[channel_id]:
            raise Damage("the index of a chunk is wrong")
        if length:
            self._part.message_indexes[prefix.start] = channel_id

    def _bound(self) -> None:
        """End a walk that is more work than any recorder's file of this size."""
        part = self._part
        limits = {
            "bytes in chunks": (self._bytes, max(1 << 28, 32 * part.size)),
            "messages": (part.message_count, 1_000_000 + part.size // 16),
            "records": (self._records + len(part.losses), 100_000 + part.size // 100),
            "bytes of damage": (self._searched, (1 << 24) + 2 * part.size),
        }
        for name, (found, limit) in limits.items():
            if found > limit:
                part.over = f"more than {limit} {name} in a file of {part.size} bytes"
