"""Walking through an MCAP file record by record: for files without an index, unfinished or damaged."""

from __future__ import annotations

from collections import defaultdict

from soro_core.bag.part import Attachment, Block, Part
from soro_core.bag.records import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MAX_RECORD,
    MESSAGE,
    METADATA,
    PREFIX,
    SCHEMA,
    Cursor,
    Damage,
    chunk_compression,
    message_key,
    open_chunk,
    parse_channel,
    parse_schema,
    records,
    salvage_chunk,
)
from soro_core.errors import BagError

# Messages outside chunks are gathered into blocks of about this size.
_RUN_BYTES = 1 << 20
_WANTED = (HEADER, SCHEMA, CHANNEL, MESSAGE, CHUNK, METADATA, ATTACHMENT)


def scan(part: Part) -> None:
    """Fill a Part from the records of its file.

    What follows the first unreadable record is left out; a damaged chunk between readable records is
    left out alone. Both become problems of the part.

    Raises
    ------
    BagError
        If not even the header can be read.
    """
    position = len(MAGIC)
    run = _Run(part)
    finished = False
    while not finished and (position < part.size or position == len(MAGIC)):
        part.stream.seek(position)
        prefix = part.stream.read(PREFIX.size)
        opcode, length = PREFIX.unpack(prefix) if len(prefix) == PREFIX.size else (0, 0)
        whole = opcode and length <= MAX_RECORD and position + PREFIX.size + length <= part.size
        if position == len(MAGIC) and not (whole and opcode == HEADER):
            raise BagError(f"{part.path}: damaged: its header cannot be read")
        if not whole:
            run.close()
            _cut(part, position, opcode)
            return
        if opcode in _WANTED:
            body = memoryview(part.stream.read(length))
            try:
                if opcode == MESSAGE:
                    run.add(position, body)
                else:
                    run.close()
                    _take(part, opcode, position, body)
            except Damage as damage:
                part.note(position, damage)
        finished = opcode in (DATA_END, FOOTER)
        position += PREFIX.size + length
    run.close()
    if not finished:
        part.problems.append(f"{part.path.name}: not closed by its recorder: the index is missing")
    elif not _ends_whole(part):
        part.problems.append(f"{part.path.name}: the index at the end is cut; all messages are there")


def _ends_whole(part: Part) -> bool:
    part.stream.seek(max(0, part.size - len(MAGIC)))
    return part.stream.read() == MAGIC


def _take(part: Part, opcode: int, position: int, body: memoryview) -> None:
    cursor = Cursor(body)
    if opcode == HEADER:
        part.profile = cursor.text()
    elif opcode == SCHEMA:
        schema = parse_schema(body)
        part.schemas[schema.id] = schema
    elif opcode == CHANNEL:
        channel = parse_channel(body)
        part.channels[channel.id] = channel
    elif opcode == METADATA:
        part.metadata.append((cursor.text(), cursor.texts()))
    elif opcode == ATTACHMENT:
        times = cursor.number(8), cursor.number(8)
        names = cursor.text(), cursor.text()
        part.attachments.append(Attachment(*times, *names, bytes(cursor.take(cursor.number(8)))))
    elif opcode == CHUNK:
        part.compression = chunk_compression(body)
        _add_chunk(part, open_chunk(body), position, PREFIX.size + len(body))


def _add_chunk(part: Part, content: memoryview, offset: int, length: int, salvaged: bool = False) -> None:
    """Take over the schemas, channels and message counts of a chunk."""
    times: list[int] = []
    counts: dict[int, int] = defaultdict(int)
    for opcode, _, body in records(content):
        if opcode == MESSAGE:
            channel_id, log_time = message_key(body)
            if channel_id not in part.channels:
                raise Damage(f"a message of an unknown channel {channel_id}")
            times.append(log_time)
            counts[channel_id] += 1
        elif opcode in (SCHEMA, CHANNEL):
            _take(part, opcode, offset, body)
    for channel_id, count in counts.items():
        part.counts[channel_id] += count
    if times:
        kept = bytes(content) if salvaged else None
        part.blocks.append(Block(min(times), max(times), offset, length, is_chunk=True, salvaged=kept))


def _cut(part: Part, position: int, opcode: int) -> None:
    """Note that the file becomes unreadable at `position`; save what a last, cut chunk still gives."""
    part.lossy = True
    before = part.message_count
    if opcode == CHUNK and part.size - position < MAX_RECORD:
        part.stream.seek(position + PREFIX.size)
        try:
            content = salvage_chunk(memoryview(part.stream.read()))
            _add_chunk(part, content, position, part.size - position, salvaged=True)
        except Damage as damage:
            part.note(position, damage)
    saved = part.message_count - before
    kept = f"; {saved} messages of the last chunk were saved" if saved else ""
    part.problems.append(
        f"{part.path.name}: the end is missing: nothing whole from byte {position} of {part.size} on{kept}"
    )


class _Run:
    """Gathers neighbouring Message records outside chunks into blocks."""

    def __init__(self, part: Part) -> None:
        self._part = part
        self._offset = self._end = 0
        self._times: list[int] = []

    def add(self, position: int, body: memoryview) -> None:
        channel_id, log_time = message_key(body)
        if channel_id not in self._part.channels:
            raise Damage(f"a message of an unknown channel {channel_id}")
        if self._times and (position != self._end or position - self._offset > _RUN_BYTES):
            self.close()
        if not self._times:
            self._offset = position
        self._times.append(log_time)
        self._end = position + PREFIX.size + len(body)
        self._part.counts[channel_id] += 1

    def close(self) -> None:
        if self._times:
            length = self._end - self._offset
            start, end = min(self._times), max(self._times)
            self._part.blocks.append(Block(start, end, self._offset, length, is_chunk=False))
            self._times = []
