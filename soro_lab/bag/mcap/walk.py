"""Reading an MCAP file record by record: unfinished or damaged files, and files without an index."""

from __future__ import annotations

import re
import struct
from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence

from mcap import records as kinds
from mcap.opcode import Opcode

from soro_core.errors import BagError
from soro_lab.bag.mcap.chunks import inner, message_key, most, unpack
from soro_lab.bag.mcap.part import OUTSIDE, BagFile, Block
from soro_lab.bag.mcap.records import MAGIC, PREFIX, PRIVATE, Damage, Prefix, parse

# Size of blocks of messages outside chunks [B].
_RUN_BYTES = 1 << 20
_MESSAGE_BYTES = PREFIX.size + 22
# The prefix of a record among the data, of up to a terabyte.
_LOOKS = re.compile(rb"[\x03-\x07\x09\x0c\x0f](?=.{5}\0{3})", re.DOTALL)
_WINDOW = 1 << 16
# Bytes of a chunk that take as long to read as a message, a record, a byte that is searched, and a try there.
_MESSAGE_WORK, RECORD_WORK, _SEARCH_WORK, _TRY_WORK = 150, 3000, 10, 700


class Walk:
    """Fills a `BagFile` from the records of its file.

    Whatever is damaged is left out, and noted: of a wrong kind or length that record, else the chunk. Behind
    a length without sense the walk goes on at the next place by the index, else where the next two records
    are.

    Parameters
    ----------
    part : BagFile
        The part to fill; its `schemas` and `channels` may hold those of the index.
    places : sequence of int
        Where records begin or end by the index, in their order [B]; the last one is the end of the data.
    outside_ns : range
        Log times of messages outside chunks by the index; none where it names chunks.
    """

    def __init__(self, part: BagFile, places: Sequence[int] = (), outside_ns: range = range(1 << 64)) -> None:
        self._part, self._source, self._places = part, part.source, places
        self._outside_ns = outside_ns
        self._stop = places[-1] if places else part.size
        # The index names all chunks: nothing has to be searched for.
        self._knows_all = bool(places) and not outside_ns
        # Digests of the messages of each channel in the last chunk; None behind a damaged place.
        self._digests: Counter[int] | None = Counter()

    def run(self) -> None:
        """Walk through the file; raise BagError if nothing can be read."""
        part, position = self._part, len(MAGIC)
        while position < self._stop and not part.over:
            position = self._step(position)
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
        self._part.work(RECORD_WORK)
        found = prefix.end if prefix is not None and follows else self._next(position + 1)
        if found is None:
            damage = f"the end is missing: no whole record from here on, of {self._part.size} bytes"
        self._part.lose(position, damage)
        return self._stop if found is None else found

    # Where records are --------------------------------------------------------------------------
    def _is_followed(self, prefix: Prefix) -> bool:
        """Whether a record ends where another one begins, or where its damaged prefix does."""
        place = self._place(prefix.start)
        if prefix.end >= place or self._source.begins(prefix.end):
            return prefix.end <= place
        found = self._next(prefix.end)
        if found is None:
            return True
        # The prefix of the next one is damaged if it leads to the one behind it, up to one bit.
        raw = self._source.bytes(prefix.end + 1, prefix.end + PREFIX.size)
        length = found - prefix.end - PREFIX.size
        return length >= 0 and (int.from_bytes(raw, "little") ^ length).bit_count() <= 1

    def _place(self, position: int) -> int:
        """Return the next place behind a position by the index; without one the end."""
        first = bisect_right(self._places, position)
        return self._places[first] if first < len(self._places) else self._stop

    def _next(self, begin: int) -> int | None:
        """Return where the next record begins, by the index or its looks; None for nowhere."""
        part, source, stop = self._part, self._source, self._place(begin - 1)
        while begin < stop and not self._knows_all and not part.over:
            window = source.bytes(begin, min(begin + _WINDOW + PREFIX.size, part.size))
            part.work(_SEARCH_WORK * len(window))
            for match in _LOOKS.finditer(window[: stop - begin + PREFIX.size]):
                part.work(_TRY_WORK)
                prefix = source.prefix(begin + match.start())
                if prefix is not None and prefix.start < stop and source.begins(prefix.end):
                    return prefix.start
            begin += _WINDOW
        return stop if self._places else None

    # Records ------------------------------------------------------------------------------------
    def _take(self, prefix: Prefix, follows: bool) -> None:
        """Add a record; raise Damage if it does not belong here."""
        part, opcode, start, length = self._part, prefix.opcode, prefix.start, prefix.end - prefix.start
        if opcode == Opcode.MESSAGE:
            self._take_message(start, length)
            return
        part.work(RECORD_WORK + length)
        if opcode == Opcode.MESSAGE_INDEX:
            self._take_message_index(prefix)
            return
        if opcode >= PRIVATE:
            part.private_count += 1
            return
        if opcode > Opcode.DATA_END:
            raise Damage(f"a record of the unknown kind {opcode}")
        record = self._source.record(prefix)
        if isinstance(record, kinds.Chunk):
            if not follows and length != PREFIX.size + 40 + len(record.compression) + len(record.data):
                raise Damage("the length of a chunk is wrong")
            self._take_chunk(start, length, record)
        elif isinstance(record, kinds.Schema | kinds.Channel | kinds.Metadata):
            part.describe(record, length)
        elif isinstance(record, kinds.Attachment):
            times, size = (record.log_time, record.create_time), len(record.data)
            part.describe(kinds.AttachmentIndex(start, length, *times, size, record.name, record.media_type))
        elif isinstance(record, kinds.Header) and start == len(MAGIC):
            part.profile = record.profile
        elif isinstance(record, kinds.DataEnd) and length == PREFIX.size + 4:
            crc = record.data_section_crc
            if crc and crc != self._source.checksum(start):
                part.remark("the checksum of the data is wrong")
            self._stop = prefix.end
        else:
            raise Damage(f"a {type(record).__name__} among the data")

    def _take_message(self, start: int, length: int) -> None:
        """Add a message outside chunks to the block before it, or as a new one."""
        part = self._part
        part.work(_MESSAGE_WORK)
        channel_id, time = message_key(self._source.bytes(start, start + _MESSAGE_BYTES), 0)
        # A chunk's message index or a channel whose kind is damaged looks like a message.
        if time not in self._outside_ns:
            raise Damage("a message outside the chunks or the time of the recording")
        if channel_id not in part.channels:
            raise Damage(f"a message of the unknown channel {channel_id}")
        part.counts[channel_id] += 1
        last = part.blocks[-1] if part.blocks else Block(time, time, 0, 0, OUTSIDE)
        if last.offset + last.length == start and last.length < _RUN_BYTES:
            times, begin = (min(last.start_ns, time), max(last.end_ns, time)), last.offset
            part.blocks[-1] = Block(*times, begin, last.length + length, OUTSIDE)
        else:
            part.blocks.append(Block(time, time, start, length, OUTSIDE))

    def _take_chunk(self, start: int, length: int, chunk: kinds.Chunk) -> None:
        self._outside_ns, self._digests = range(0), None
        part = self._part
        part.work(min(chunk.uncompressed_size, most(len(chunk.data))))
        content = unpack(chunk)
        counts: Counter[int] = Counter()
        digests: Counter[int] = Counter()
        low, high = 1 << 64, 0
        for opcode, begin, _ in inner(content):
            if opcode == Opcode.MESSAGE:
                channel_id, time = message_key(content, begin)
                counts[channel_id] += 1
                digests[channel_id] += hash((time, begin))
                low, high = min(low, time), max(high, time)
        self._describe(start, content)
        times = (low, high) if counts else (0, 0)
        if (chunk.message_start_time, chunk.message_end_time) != times:
            part.remark(f"byte {start}: the times of a chunk are not those of its messages")
        part.work(_MESSAGE_WORK * counts.total())
        if unknown := sorted(counts.keys() - part.channels.keys()):
            part.lose(start, f"messages of unknown channels ({', '.join(map(str, unknown[:10]))})")
        part.counts.update({key: count for key, count in counts.items() if key in part.channels})
        part.compression, self._digests = chunk.compression, digests
        part.blocks.append(Block(*times, start, length, len(content)))

    def _describe(self, position: int, content: memoryview) -> None:
        """Add the schemas and channels in a chunk; where one is damaged, the index may describe the topic."""
        for opcode, start, end in inner(content):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and not self._part.over:
                self._part.work(RECORD_WORK)
                try:
                    record = parse(content[start:end])
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
