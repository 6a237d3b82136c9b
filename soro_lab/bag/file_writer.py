"""One file of a bag being written, and what is in it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from soro_core.errors import BagError
from soro_lab.bag.mcap.mcap_file import Compression, McapFile
from soro_lab.bag.metadata import FilePart
from soro_lab.bag.topics import Topic


class FileWriter:
    """A new MCAP file with some topics.

    Parameters
    ----------
    path : Path
        The file.
    compression : {"zstd", "lz4", "none"}
    chunk_bytes : int
        Uncompressed size at which a chunk is written.
    record : callable
        Gives the text of the metadata record ``rosbag2`` from what is in the file.

    Attributes
    ----------
    message_count : int
    start_ns : int or None
        Log time of the first message; None without one.

    Raises
    ------
    BagError
        If the disk refuses, as for all methods here.
    """

    def __init__(
        self, path: Path, compression: Compression, chunk_bytes: int, record: Callable[[FilePart], str]
    ) -> None:
        self.path, self._record = path, record
        self._channels: dict[str, int] = {}
        self.message_count, self._end_ns = 0, 0
        self.start_ns: int | None = None
        self._closed = False
        try:
            self._stream = path.open("xb")
        except OSError as error:
            raise BagError(f"cannot be written: {error.strerror}", path, "disk") from None
        self._file = McapFile(self._stream, compression, chunk_bytes)
        self._on_disk("begin", self._begin)

    @property
    def size(self) -> int:
        """Bytes written, without the chunk that is being filled."""
        return self._stream.tell()

    def add_topic(self, topic: Topic) -> None:
        """Register a topic."""
        self._channels[topic.name] = self._file.add_topic(topic)

    def write(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int, sequence: int) -> None:
        """Append one message; parameters as in `BagWriter.write`."""
        channel = self._channels[topic]
        try:  # no closure: a recorder comes here twenty thousand times a second
            self._file.write(channel, data, log_time_ns, publish_time_ns, sequence)
        except OSError as error:
            raise self._refused("write", error) from None
        self.message_count += 1
        self.start_ns = log_time_ns if self.start_ns is None else min(self.start_ns, log_time_ns)
        self._end_ns = max(self._end_ns, log_time_ns)

    def flush(self) -> None:
        """End the chunk and pass all data to the operating system."""
        self._on_disk("write", self._file.flush)

    def close(self) -> None:
        """Write index and footer, and close the file; may be called again."""
        if self._closed:
            return
        self._closed = True
        try:
            self._on_disk("end", self._end)
        finally:
            self._on_disk("be closed", self._stream.close)

    def part(self) -> FilePart:
        """Return what metadata.yaml says of the file."""
        duration = 0 if self.start_ns is None else self._end_ns - self.start_ns
        return FilePart(self.path.name, self.start_ns, duration, self.message_count)

    def _begin(self) -> None:
        self._add_metadata()
        self._file.flush()

    def _end(self) -> None:
        self._file.flush()
        self._add_metadata()
        self._file.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def _add_metadata(self) -> None:
        self._file.add_metadata("rosbag2", {"serialized_metadata": self._record(self.part())})

    def _on_disk(self, action: str, work: Callable[[], None]) -> None:
        try:
            work()
        except OSError as error:
            raise self._refused(action, error) from None

    def _refused(self, action: str, error: OSError) -> BagError:
        return BagError(f"cannot {action}: {error.strerror}", self.path.parent, "disk")
