"""A file of a bag in sqlite3, rosbag2's storage before ROS 2 Iron, read by rosbags."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import cast

from mcap.records import Channel, Message, Schema
from rosbags.interfaces import ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2 import Reader

from soro_core.errors import BagError
from soro_lab.bag.mcap.part import OUTSIDE, BagFile, Block
from soro_lab.bag.mcap.records import Damage

_ENCODINGS = {MessageDefinitionFormat.MSG: "ros2msg", MessageDefinitionFormat.IDL: "ros2idl"}
# Bytes of the file for each of the equal stretches of time in which it is read.
_STRETCH = 1 << 22


class SqlitePart(BagFile):
    """A file whose blocks are stretches of its time."""

    database: Reader

    def messages(
        self, block: Block, channels: Collection[int] | None = None, low: int = 0, high: int = 1 << 64
    ) -> Iterator[Message]:
        """Yield messages of a stretch of time by their log times.

        Parameters
        ----------
        block, channels, low, high : as in `BagFile.messages`
        """
        listed = list(enumerate(self.database.connections))
        wanted = [connection for number, connection in listed if channels is None or number in channels]
        numbers = {connection.id: number for number, connection in listed}
        if not wanted:
            return
        try:
            begin, end = max(block.start_ns, low), min(block.end_ns, high) + 1
            found = self.database.messages(wanted, start=begin, stop=end)
            for sequence, (connection, time, data) in enumerate(found):
                yield Message(numbers[connection.id], time, bytes(data), time, sequence)
        except Exception as error:  # of sqlite3, by its bindings
            raise Damage(f"the database is damaged: {error}") from None

    def close(self) -> None:
        """Close the database; may be called again."""
        super().close()
        if self.database.is_open:
            self.database.close()


def open_sqlite(path: Path) -> SqlitePart:
    """Open a ``.db3`` file.

    Raises
    ------
    BagError
        If it is missing, or no such database.
    """
    try:
        stream = path.open("rb")
    except OSError as error:
        raise BagError(error.strerror or str(error), path, "disk") from None
    part = SqlitePart(path, stream)
    part.database = Reader(path)
    try:
        part.database.open()
    except Exception as error:  # of the database, by its bindings, and of what is in it
        stream.close()
        raise BagError(f"no sqlite3 bag: {str(error).splitlines()[0]}", path, "format") from None
    for number, connection in enumerate(part.database.connections):
        about, extra = connection.msgdef, cast(ConnectionExtRosbag2, connection.ext)
        encoding = _ENCODINGS.get(about.format, "")
        part.schemas[number + 1] = Schema(number + 1, about.data.encode(), encoding, connection.msgtype)
        notes = {"topic_type_hash": connection.digest}
        part.channels[number] = Channel(
            number, connection.topic, extra.serialization_format, notes, number + 1
        )
        part.counts[number] = connection.msgcount
    if part.message_count:
        start, stop = part.database.start_time, part.database.end_time
        step = -(-(stop - start) // (part.size // _STRETCH + 1))
        for number, begin in enumerate(range(start, stop, step)):
            part.blocks.append(Block(begin, min(begin + step, stop) - 1, number, 0, OUTSIDE))
    return part
