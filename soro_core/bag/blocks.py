"""Blocks: contiguous parts of a file that hold messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from soro_core.bag.chunks import open_chunk
from soro_core.bag.prefixes import RecordPrefix
from soro_core.bag.records import MESSAGE, PREFIX

# Size of blocks of messages outside chunks [B].
_RUN_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Block:
    """A contiguous part of a file that holds messages.

    Parameters
    ----------
    start_ns, end_ns : int
        Log times of the earliest and the latest message.
    offset, length : int
        Position and length in the file [B].
    unpack : callable
        Function that returns the records of the block: `open_chunk`, or `run` for neighbouring Message
        records outside chunks; for a damaged block `salvage_chunk`, `cut_chunk` or `message_alone`.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    unpack: Callable[[memoryview], memoryview]

    @property
    def is_damaged(self) -> bool:
        """Whether the block may have lost recorded data."""
        return self.unpack not in (open_chunk, run)


def run(block: memoryview) -> memoryview:
    """Return the records of a block outside chunks: the block itself."""
    return block


def message_alone(record: memoryview) -> memoryview:
    """Return a Message record with a correct prefix in place of a damaged one."""
    body = record[PREFIX.size :]
    return memoryview(PREFIX.pack(MESSAGE, len(body)) + bytes(body))


class Run:
    """Collects neighbouring Message records outside chunks into blocks."""

    def __init__(self, blocks: list[Block]) -> None:
        self._blocks = blocks
        self._offset = self._end = 0
        self._times: list[int] = []

    def add(self, prefix: RecordPrefix, log_time: int, prefix_is_right: bool) -> None:
        """Add a message; one with a damaged prefix is a separate block.

        Parameters
        ----------
        prefix : RecordPrefix
            Prefix of the Message record.
        log_time : int
            Log time of the message [ns].
        prefix_is_right : bool
            Whether the file holds this prefix undamaged.
        """
        if not prefix_is_right:
            self.close()
            place = prefix.position, prefix.end - prefix.position
            self._blocks.append(Block(log_time, log_time, *place, message_alone))
            return
        if self._times and (prefix.position != self._end or prefix.position - self._offset > _RUN_BYTES):
            self.close()
        if not self._times:
            self._offset = prefix.position
        self._times.append(log_time)
        self._end = prefix.end

    def close(self) -> None:
        """End the block."""
        if self._times:
            length = self._end - self._offset
            start, end = min(self._times), max(self._times)
            self._blocks.append(Block(start, end, self._offset, length, run))
            self._times = []
