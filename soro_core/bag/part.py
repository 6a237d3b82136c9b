"""One MCAP file of a bag: its topics, and the blocks in which its messages lie."""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import zstandard

from soro_core.bag.records import (
    MESSAGE,
    PREFIX,
    Channel,
    Damage,
    RawMessage,
    Schema,
    open_chunk,
    parse_message,
    records,
)
from soro_core.errors import BagError


@dataclass(frozen=True, slots=True)
class Block:
    """A stretch of a file that holds messages.

    Parameters
    ----------
    start_ns, end_ns : int
        Log times of its earliest and latest message.
    offset, length : int
        Place in the file.
    is_chunk : bool
        A Chunk record, or a run of Message records outside chunks.
    salvaged : bytes, optional
        Records recovered from a chunk whose end is missing.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    is_chunk: bool
    salvaged: bytes | None = None


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file that somebody put into the recording."""

    log_time_ns: int
    create_time_ns: int
    name: str
    media_type: str
    data: bytes


@dataclass
class Part:
    """What one file holds; `problems` says what is damaged or missing, `lossy` whether that cost bytes."""

    path: Path
    stream: IO[bytes]
    size: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    blocks: list[Block] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=lambda: defaultdict(int))
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    profile: str = "ros2"
    compression: str = ""
    indexed: bool = False
    lossy: bool = False

    @property
    def message_count(self) -> int:
        """Number of messages in the file."""
        return sum(self.counts.values())

    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message; None without messages."""
        if not self.blocks:
            return None
        return min(block.start_ns for block in self.blocks), max(block.end_ns for block in self.blocks)

    def messages(self, block: Block) -> Iterator[RawMessage]:
        """Yield the messages of a block in the order of the file.

        Raises
        ------
        BagError
            If the block is damaged.
        """
        try:
            for opcode, _, body in records(self._content(block)):
                if opcode == MESSAGE:
                    message = parse_message(body)
                    if message.channel_id not in self.channels:
                        raise Damage(f"a message of an unknown channel {message.channel_id}")
                    yield message
        except Damage as damage:
            raise BagError(
                f"{self.path}: byte {block.offset}: {damage}; 'soro bag repair' keeps the rest"
            ) from None

    def note(self, position: int, damage: Damage) -> None:
        """Add a problem: what stands at a place of the file cannot be used."""
        self.lossy = True
        self.problems.append(f"{self.path.name}: byte {position}: {damage}; left out")

    def close(self) -> None:
        """Close the file."""
        self.stream.close()

    def _content(self, block: Block) -> memoryview:
        if block.salvaged is not None:
            return memoryview(block.salvaged)
        self.stream.seek(block.offset)
        raw = memoryview(self.stream.read(block.length))
        if len(raw) != block.length:
            raise Damage("the file has become shorter")
        return open_chunk(raw[PREFIX.size :]) if block.is_chunk else raw


def open_stream(path: Path) -> IO[bytes]:
    """Open a file for reading; ``.mcap.zstd`` (rosbag2's file compression) is unpacked on the way.

    Raises
    ------
    BagError
        If the file cannot be read.
    """
    try:
        if path.suffix != ".zstd":
            return path.open("rb")
        stream = tempfile.TemporaryFile()  # noqa: SIM115 - closed by its Part
        try:
            with path.open("rb") as packed:
                zstandard.ZstdDecompressor().copy_stream(packed, stream)
        except BaseException:
            stream.close()
            raise
    except OSError as error:
        raise BagError(f"{path}: {error.strerror or error}") from None
    except zstandard.ZstdError:
        raise BagError(f"{path}: the zstd data is damaged") from None
    return stream
