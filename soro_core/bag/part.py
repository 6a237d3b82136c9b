"""One MCAP file of a bag: its topics, and the blocks that hold its messages."""

from __future__ import annotations

import shutil
import tempfile
import zlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import zstandard
from mcap import records as kinds
from mcap.records import AttachmentIndex, Channel, ChunkIndex, Message, Schema

from soro_core.bag.blocks import Block
from soro_core.bag.records import (
    ATTACHMENT,
    MESSAGE,
    PREFIX,
    Damage,
    parse,
    parse_message,
    records,
)
from soro_core.errors import BagError

_STEP = 1 << 20


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file attached to the recording."""

    log_time_ns: int
    create_time_ns: int
    name: str
    media_type: str
    data: bytes


@dataclass
class Part:
    """Contents of one file; `problems` lists what is damaged or missing, `lossy` whether data is lost."""

    path: Path
    stream: IO[bytes]
    size: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=lambda: defaultdict(int))
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    chunks: list[ChunkIndex] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    profile: str = "ros2"
    compression: str = ""
    indexed: bool = False
    lossy: bool = False
    private_count: int = 0

    @property
    def message_count(self) -> int:
        """Number of messages in the file."""
        return sum(self.counts.values())

    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message; None without messages."""
        if not self.blocks:
            return None
        return min(block.start_ns for block in self.blocks), max(block.end_ns for block in self.blocks)

    def messages(self, block: Block) -> Iterator[Message]:
        """Yield the messages of a block in the order of the file.

        Raises
        ------
        BagError
            If the block is damaged and not marked as damaged.
        """
        try:
            for opcode, _, body in records(block.unpack(self.read(block.offset, block.length))):
                if opcode == MESSAGE:
                    message = parse_message(body)
                    if message.channel_id in self.channels:
                        yield message
                    elif not block.is_damaged:
                        raise Damage(f"a message of an unknown channel {message.channel_id}")
        except Damage as damage:
            raise BagError(
                f"{damage}; 'soro bag repair' keeps the rest", self.path, "damaged", f"byte {block.offset}"
            ) from None

    def attachment(self, place: AttachmentIndex) -> Attachment:
        """Read one of `attachments`.

        Raises
        ------
        BagError
            If the attachment is damaged.
        """
        try:
            # The prefix is not read, since it may be damaged.
            body = self.read(place.offset + PREFIX.size, place.length - PREFIX.size)
            record = parse(ATTACHMENT, body)
        except Damage as damage:
            raise BagError(str(damage), self.path, "damaged", f"byte {place.offset}") from None
        assert isinstance(record, kinds.Attachment)
        times = record.log_time, record.create_time
        return Attachment(*times, record.name, record.media_type, record.data)

    def record(self, opcode: int, offset: int, length: int | None = None) -> kinds.McapRecord:
        """Read a record.

        Parameters
        ----------
        opcode : int
            Kind of the record.
        offset : int
            Position of its prefix [B].
        length : int, optional
            Expected length with the prefix [B].

        Raises
        ------
        Damage
            If another record, or one of another length, is there.
        """
        found, size = PREFIX.unpack(self.read(offset, PREFIX.size))
        if found != opcode or length not in (None, PREFIX.size + size):
            raise Damage("another record is here")
        return parse(opcode, self.read(offset + PREFIX.size, size))

    def read(self, offset: int, length: int) -> memoryview:
        """Read bytes of the file; raise Damage if it is too short."""
        if offset + length > self.size:
            raise Damage("the index points outside the file")
        self.stream.seek(offset)
        raw = memoryview(self.stream.read(length))
        if len(raw) != length:
            raise Damage("the file has become shorter")
        return raw

    def contradicts(self, checksum: int, end: int) -> bool:
        """Whether a CRC-32 differs from that of the file up to a position; 0 means no checksum."""
        if not checksum:
            return False
        crc = 0
        for start in range(0, end, _STEP):
            crc = zlib.crc32(self.read(start, min(_STEP, end - start)), crc)
        return crc != checksum

    def note(self, position: int, damage: Damage | str, left_out: bool = True) -> None:
        """Add a problem.

        Parameters
        ----------
        position : int
            Position in the file [B].
        damage : Damage or str
            Description.
        left_out : bool
            Whether the damaged data is left out.
        """
        self.lossy |= left_out
        left = "; left out" if left_out else ""
        self.problems.append(f"{self.path.name}: byte {position}: {damage}{left}")

    def close(self) -> None:
        """Close the file."""
        self.stream.close()


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
