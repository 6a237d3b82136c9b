"""One MCAP file of a bag: its topics, and the blocks that hold its messages."""

from __future__ import annotations

import shutil
import tempfile
from collections import defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import IO

import zstandard
from mcap import records as kinds
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, Message, Schema

from soro_core.bag.chunks import inner, message_key, message_of, unpack, unpack_cut
from soro_core.bag.records import PREFIX, Damage, Source
from soro_core.errors import BagError

_STEP = 1 << 20
# Most bytes of definitions, and of texts that describe topics or the file, which count four times.
MOST_DESCRIBED = 1 << 24
# Most metadata records, and most attachments.
_MOST_NAMED = 10_000
# Most kinds of damage that are named.
_MOST_TEXTS = 4


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file attached to the recording."""

    log_time_ns: int
    create_time_ns: int
    name: str
    media_type: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Block:
    """A chunk, or neighbouring messages outside chunks.

    Parameters
    ----------
    start_ns, end_ns : int
        Log times of the earliest and the latest message.
    offset, length : int
        Position and length in the file [B].
    size : int
        Length of the records in a chunk [B]; -1 of messages outside chunks, -2 of a chunk without end.
    index : int
        Digest of compression, and of the places of the indexes of its messages.
    indexes : int
        Length of these indexes, behind the chunk [B].
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    size: int
    index: int = 0
    indexes: int = 0


OUTSIDE, CUT = -1, -2


@dataclass
class Part:
    """Contents of one file.

    Attributes
    ----------
    indexed : bool
        Whether the index was used; else all records were read.
    lossy : bool
        Whether recorded data is lost.
    over : str
        What there is more of than is read; "" for nothing.
    """

    path: Path
    stream: IO[bytes]
    size: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=lambda: defaultdict(int))
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    profile: str = "ros2"
    compression: str = ""
    indexed: bool = False
    lossy: bool = False
    private_count: int = 0
    over: str = ""
    remarks: list[str] = field(default_factory=list)
    _damages: dict[bool, dict[str, tuple[int, int]]] = field(default_factory=lambda: {True: {}, False: {}})
    _described: int = 0
    _lost: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.source = Source(self.stream, self.size)

    @property
    def message_count(self) -> int:
        """Number of messages in the file."""
        return sum(self.counts.values())

    @property
    def problems(self) -> list[str]:
        """What is lost, in one line; what else is wrong, in one line; and what is missing at the end."""
        lines = []
        for left_out, title in ((True, "left out: "), (False, "")):
            if found := self._damages[left_out]:
                lines.append(title + "; ".join(_place(text, *places) for text, places in found.items()))
        return [f"{self.path.name}: {line}" for line in (*lines, *self.remarks)]

    def note(self, position: int, damage: Damage | str, left_out: bool = True) -> None:
        """Note damage.

        Parameters
        ----------
        position : int
            Position in the file [B].
        damage : Damage or str
        left_out : bool
            Whether data is left out for it.
        """
        self.lossy |= left_out
        known, text = self._damages[left_out], str(damage)
        if text not in known and len(known) >= _MOST_TEXTS:
            text = "other damage"
        first, count = known.get(text, (position, 0))
        known[text] = first, count + 1

    def describe(self, record: kinds.McapRecord, length: int, position: int, proven: bool) -> None:
        """Keep a schema, a channel or a metadata record.

        Parameters
        ----------
        record : Schema, Channel or Metadata
        length : int
            Its length [B].
        position : int
            Where it stands, for a note [B].
        proven : bool
            Whether a present one of the same number takes precedence.

        Raises
        ------
        Damage
            If there is more than any recorder writes.
        """
        self._described += length if isinstance(record, Schema) else 4 * length
        if self._described > MOST_DESCRIBED or len(self.metadata) >= _MOST_NAMED:
            raise Damage("more descriptions than any recorder writes")
        if isinstance(record, kinds.Metadata):
            self.metadata.append((record.name, record.metadata))
            return
        assert isinstance(record, Schema | Channel)
        table: dict[int, Schema | Channel]
        table = self.schemas if isinstance(record, Schema) else self.channels  # type: ignore[assignment]
        known = table.setdefault(record.id, record)
        if known != record:
            kind = type(record).__name__.lower()
            self.note(position, f"{kind} {record.id} contradicts another one", left_out=False)
            if not proven:
                table[record.id] = record

    def attach(self, item: AttachmentIndex) -> None:
        """Note an attachment; raise Damage if there are more than any recorder writes."""
        if len(self.attachments) >= _MOST_NAMED:
            raise Damage(f"more than {_MOST_NAMED} attachments")
        self.attachments.append(item)

    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message; None without messages."""
        # A chunk without messages has the times 0.
        blocks = [block for block in self.blocks if block.end_ns] or self.blocks
        return (
            (min(block.start_ns for block in blocks), max(block.end_ns for block in blocks))
            if blocks
            else None
        )

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
        content = self.content(block)
        wanted, found = self.channels if channels is None else channels, []
        for opcode, start, end in inner(content):
            if opcode == Opcode.MESSAGE:
                channel_id, log_time = message_key(content, start)
                if low <= log_time <= high and channel_id in wanted:
                    found.append((log_time, start, end))
        found.sort(key=itemgetter(0))
        for _, start, end in found:
            yield message_of(content[start:end])

    def lose(self, block: Block, damage: Damage) -> None:
        """Note a block that the index names and that is damaged, once."""
        if block.offset not in self._lost:
            self._lost.add(block.offset)
            self.note(block.offset, damage)

    def content(self, block: Block) -> memoryview:
        """Return the records in a block; raise Damage if it is damaged."""
        end = block.offset + block.length
        if block.size in (OUTSIDE, CUT):
            raw = memoryview(self.source.bytes(block.offset, end))
            return raw if block.size == OUTSIDE else unpack_cut(raw[PREFIX.size :])
        chunk = self.record(Opcode.CHUNK, block.offset, end)
        assert isinstance(chunk, kinds.Chunk)
        return unpack(chunk)

    def record(self, opcode: int, start: int, end: int | None = None) -> kinds.McapRecord:
        """Return a record that the index or a walk has found.

        Parameters
        ----------
        opcode : int
            Its kind.
        start, end : int
            Its place [B]; without an end that of its length.

        Raises
        ------
        Damage
            If another record is there.
        """
        prefix = self.source.prefix(start)
        if prefix is None or prefix.opcode != opcode:
            raise Damage("another record is here")
        if end in (None, prefix.end):
            return self.source.parse(prefix)
        found = self.source.by_fields(prefix)  # its length is wrong
        if found is None or found[0] is None or found[1] != end:
            raise Damage("another record is here")
        return found[0]

    def attachment(self, place: AttachmentIndex) -> Attachment:
        """Read one of `attachments`.

        Raises
        ------
        BagError
            If the attachment is damaged.
        """
        try:
            record = self.record(Opcode.ATTACHMENT, place.offset, place.offset + place.length)
            assert isinstance(record, kinds.Attachment)
        except Damage as damage:
            raise BagError(str(damage), self.path, "damaged", f"byte {place.offset}") from None
        times = record.log_time, record.create_time
        return Attachment(*times, record.name, record.media_type, record.data)

    def close(self) -> None:
        """Close the file."""
        self.stream.close()


def _place(text: str, first: int, count: int) -> str:
    return f"byte {first}{f' and {count - 1} more' if count > 1 else ''}: {text}"


def open_stream(path: Path) -> IO[bytes]:
    """Open a file for reading; ``.mcap.zstd`` (rosbag2's file compression) is unpacked into a temporary file.

    Raises
    ------
    BagError
        If the file cannot be read, or needs more than half of the free space of the temporary folder.
    """
    try:
        if path.suffix != ".zstd":
            return path.open("rb")
        stream = tempfile.TemporaryFile()  # noqa: SIM115 - closed by its Part
        try:
            limit = shutil.disk_usage(tempfile.gettempdir()).free // 2
            with (
                path.open("rb") as packed,
                zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as unpacker,
            ):
                while piece := unpacker.read(_STEP):
                    if stream.tell() + len(piece) > limit:
                        raise BagError(
                            f"the unpacked file is larger than {limit} bytes, half of the free "
                            f"space in {tempfile.gettempdir()}; unpack it elsewhere ('zstd -d')",
                            path,
                            "disk",
                        )
                    stream.write(piece)
        except BaseException:
            stream.close()
            raise
    except OSError as error:
        raise BagError(error.strerror or str(error), path, "disk") from None
    except zstandard.ZstdError:
        raise BagError("the zstd data is damaged", path, "damaged") from None
    return stream
