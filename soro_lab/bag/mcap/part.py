"""One MCAP file of a bag: its topics, and the blocks that hold its messages."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Collection, Iterator
from operator import itemgetter
from pathlib import Path
from typing import IO, NamedTuple

from mcap import records as kinds
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, Message, Schema

from soro_core.errors import BagError
from soro_lab.bag.mcap.chunks import inner, message_key, message_of, unpack
from soro_lab.bag.mcap.records import Damage, Prefix, Source

# Most bytes of definitions, and of texts that describe topics or the file, which count four times.
_MOST_DESCRIBED = 1 << 24
# What a metadata record or an attachment counts of that besides.
_NAMED = 1600
# Work that a file may ask for [B]: so much, or so many times its size.
_ALWAYS_WORK, _WORK_RATIO = 1 << 28, 32
_MOST_REMARKS = 4
# In place of the size of a chunk's content: messages outside chunks.
OUTSIDE = -1


class Block(NamedTuple):
    """A chunk, or neighbouring messages outside chunks.

    Parameters
    ----------
    start_ns, end_ns : int
        Log times of the earliest and the latest message.
    offset, length : int
        Position and length in the file [B].
    size : int
        Length of the records in a chunk [B], or OUTSIDE.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    size: int


class BagFile:
    """Contents of one file.

    Parameters
    ----------
    path : Path
    stream : file object
        The file, binary, open for reading.

    Attributes
    ----------
    counts : dict of int to int
        Number of messages of each channel.
    message_indexes : dict of int to int
        Channel of the message index at each position.
    indexed : bool
        Whether the index was used; else all records were read.
    losses : dict of int to str
        What is lost, by its position [B].
    remarks : list of str
        What else is wrong.
    over : str
        What there is more of than is read; "" for nothing.
    """

    def __init__(self, path: Path, stream: IO[bytes]) -> None:
        self.path, self.stream, self.size = path, stream, stream.seek(0, 2)
        self.source = Source(stream, self.size)
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.blocks: list[Block] = []
        self.counts: Counter[int] = Counter()
        self.message_indexes: dict[int, int] = {}
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self.attachments: list[AttachmentIndex] = []
        self.profile, self.compression, self.over = "ros2", "", ""
        self.indexed = False
        self.private_count = self._described = self._work = 0
        self.losses: dict[int, str] = {}
        self.remarks: list[str] = []

    @property
    def message_count(self) -> int:
        """Number of messages in the file."""
        return self.counts.total()

    @property
    def problems(self) -> list[str]:
        """What is lost, in one line, and what else is wrong."""
        lines = self.remarks[:]
        if self.losses:
            position, text = next(iter(self.losses.items()))
            more = f"; and {len(self.losses) - 1} more places" if len(self.losses) > 1 else ""
            lines.insert(0, f"left out: byte {position}: {text}{more}")
        return [f"{self.path.name}: {line}" for line in lines]

    def lose(self, position: int, damage: Damage | str) -> None:
        """Note what is left out at a position [B], once."""
        self.losses.setdefault(position, str(damage))

    def remark(self, text: str) -> None:
        """Note what is wrong though nothing is lost by it."""
        if len(self.remarks) < _MOST_REMARKS and text not in self.remarks:
            self.remarks.append(text)

    def work(self, size: int) -> None:
        """Note work, in bytes of a chunk that take as long [B]; `over` if no recording needs so much."""
        self._work += size
        if self._work > (most := max(_ALWAYS_WORK, _WORK_RATIO * self.size)):
            self.over = f"more work than reading {most} bytes, in a file of {self.size} bytes"

    def describe(self, record: Schema | Channel | kinds.Metadata | AttachmentIndex, length: int = 0) -> None:
        """Keep a record of a length [B]; the first schema or channel of a number counts.

        Raises
        ------
        Damage
            If there is more than any recorder writes.
        """
        self._described += length if isinstance(record, Schema) else 4 * length
        if isinstance(record, kinds.Metadata | AttachmentIndex):
            self._described += _NAMED
        if self._described > _MOST_DESCRIBED:
            raise Damage("more descriptions than any recorder writes")
        if isinstance(record, kinds.Metadata):
            self.metadata.append((record.name, record.metadata))
        elif isinstance(record, AttachmentIndex):
            self.attachments.append(record)
        else:
            known: Schema | Channel
            if isinstance(record, Schema):
                known = self.schemas.setdefault(record.id, record)
            else:
                known = self.channels.setdefault(record.id, record)
            if known != record:
                self.remark(f"{type(record).__name__.lower()} {record.id} contradicts another one")

    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message; None without messages."""
        spans = [(block.start_ns, block.end_ns) for block in self.blocks if block.end_ns]
        # A chunk without messages has the times 0; so has one of a run whose clock has not begun.
        if self.blocks and (
            not spans or any(self._has_messages(one) for one in self.blocks if not one.end_ns)
        ):
            spans.append((0, 0))
        return (min(start for start, _ in spans), max(end for _, end in spans)) if spans else None

    def _has_messages(self, block: Block) -> bool:
        with contextlib.suppress(Damage):
            return any(opcode == Opcode.MESSAGE for opcode, _, _ in inner(self._content(block)))
        return False

    def messages(
        self, block: Block, channels: Collection[int] | None = None, low: int = 0, high: int = 1 << 64
    ) -> Iterator[Message]:
        """Yield messages of a block by their log times; equal times in the order of the file.

        Parameters
        ----------
        block : Block
        channels : collection of int, optional
            Of these channels; by default of all that the file describes.
        low, high : int
            Range of log times [ns], both included.

        Raises
        ------
        Damage
            If the block is damaged.
        """
        content = self._content(block)
        wanted, found = self.channels if channels is None else channels, []
        for opcode, start, end in inner(content):
            if opcode == Opcode.MESSAGE:
                channel_id, log_time = message_key(content, start)
                if low <= log_time <= high and channel_id in wanted:
                    found.append((log_time, start, end))
        found.sort(key=itemgetter(0))
        for _, start, end in found:
            yield message_of(content[start:end])

    def attachment(self, place: AttachmentIndex) -> kinds.Attachment:
        """Read one of `attachments`; raise BagError if it is damaged."""
        try:
            record = self.source.record(Prefix(Opcode.ATTACHMENT, place.offset, place.offset + place.length))
        except Damage as damage:
            raise BagError(str(damage), self.path, "damaged", f"byte {place.offset}") from None
        assert isinstance(record, kinds.Attachment)
        return record

    def close(self) -> None:
        """Close the file."""
        self.stream.close()

    def _content(self, block: Block) -> memoryview:
        if block.size == OUTSIDE:
            return memoryview(self.source.bytes(block.offset, block.offset + block.length))
        chunk = self.source.record(Prefix(Opcode.CHUNK, block.offset, block.offset + block.length))
        assert isinstance(chunk, kinds.Chunk)
        return unpack(chunk)
