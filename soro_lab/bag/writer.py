"""Writing bags in rosbag2's MCAP layout: a folder with NAME_0.mcap, NAME_1.mcap, ... and metadata.yaml."""

from __future__ import annotations

from pathlib import Path

from soro_core.errors import BagError
from soro_lab.bag.file_writer import FileWriter
from soro_lab.bag.mcap.mcap_file import CHUNK_BYTES, Compression
from soro_lab.bag.metadata import FilePart, Metadata, dump_record, save
from soro_lab.bag.topics import Topic


class BagWriter:
    """A bag being written.

    Flushed data survives a crash of the process: `BagReader` reads the file, and `repair` completes it. Use a
    writer in one thread only.

    Parameters
    ----------
    folder : str or Path
        Folder of the new bag; its last part names the files.
    compression : {"zstd", "lz4", "none"}
        Compression of the chunks.
    chunk_bytes : int
        Uncompressed size at which a chunk is written.
    ros_distro : str
        Name of the ROS distribution in the metadata.
    custom_data : dict of str to str, optional
        Other texts in the metadata: scene, seed and so on.
    split_bytes : int
        Size from which on the next message begins a new file, which may be one chunk larger; 0: never.
    split_ns : int
        Time between the first messages of two files [ns]; 0: one file.

    Raises
    ------
    BagError
        If the folder exists already or cannot be written.
    """

    def __init__(
        self,
        folder: str | Path,
        compression: Compression = "zstd",
        chunk_bytes: int = CHUNK_BYTES,
        ros_distro: str = "jazzy",
        custom_data: dict[str, str] | None = None,
        split_bytes: int = 0,
        split_ns: int = 0,
    ) -> None:
        self.folder = Path(folder)
        self._name = self.folder.name or "bag"
        self._compression: Compression = compression
        self._chunk_bytes = chunk_bytes
        self._split_bytes, self._split_ns = split_bytes, split_ns
        self._ros_distro, self._custom = ros_distro, dict(custom_data or {})
        self._topics: dict[str, Topic] = {}
        self._counts: dict[str, int] = {}
        self._parts: tuple[FilePart, ...] = ()
        self._start_ns: int | None = None
        self._end_ns = 0
        self.message_count = 0
        self.byte_count = 0
        self.closed = False
        try:
            self.folder.mkdir(parents=True)
        except FileExistsError:
            raise BagError("exists already; a bag is never overwritten", self.folder, "exists") from None
        except OSError as error:
            raise BagError(f"cannot be written: {error.strerror}", self.folder, "disk") from None
        self._file = self._new_file(())

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def add_topic(self, topic: Topic) -> None:
        """Register a topic before its first message.

        Raises
        ------
        BagError
            If a topic of that name is there already.
        """
        self._check_open()
        if topic.name in self._topics:
            raise BagError(f"topic {topic.name} is there already", self.folder, "exists")
        self._topics[topic.name] = topic
        self._file.add_topic(topic)
        self._counts[topic.name] = 0

    def write(
        self,
        topic: str,
        data: bytes,
        log_time_ns: int,
        publish_time_ns: int | None = None,
        sequence: int | None = None,
    ) -> None:
        """Append one message.

        Parameters
        ----------
        topic : str
            Name of a topic that was added.
        data : bytes
            The serialised message: CDR with its four bytes of encapsulation in front.
        log_time_ns : int
            Time of reception [ns]; bags are replayed in this order.
        publish_time_ns : int, optional
            Time of publication [ns]; the log time by default.
        sequence : int, optional
            Number of the message; counted by topic by default.

        Raises
        ------
        BagError
            If the topic is unknown, a time is negative or the disk refuses.
        """
        self._check_open()
        if topic not in self._topics:
            raise BagError(f"topic {topic!r} was not added", self.folder, "missing")
        published = log_time_ns if publish_time_ns is None else publish_time_ns
        if not (0 <= log_time_ns < 2**63 and 0 <= published < 2**64):
            text = f"got time {log_time_ns} ns; allowed: 0 to 2^63 - 1"
            raise BagError(text, self.folder, "value", topic)
        number = self._counts[topic] + 1 if sequence is None else sequence % 2**32
        if self._is_full(log_time_ns):
            self._split()
        self._file.write(topic, data, log_time_ns, published, number)
        self._counts[topic] += 1
        self.message_count += 1
        self.byte_count += len(data)
        self._start_ns = log_time_ns if self._start_ns is None else min(self._start_ns, log_time_ns)
        self._end_ns = max(self._end_ns, log_time_ns)

    def split(self) -> None:
        """Close the file and begin the next one; nothing changes while the file has no message.

        Raises
        ------
        BagError
            If the disk refuses.
        """
        self._check_open()
        if self._file.start_ns is not None:
            self._split()

    def flush(self) -> None:
        """End the chunk and pass all data to the operating system; data written since is lost in a crash."""
        self._check_open()
        self._file.flush()

    def close(self) -> None:
        """Write index and metadata.yaml and close the file; may be called again.

        Raises
        ------
        BagError
            If the disk refuses; earlier data stays readable.
        """
        if self.closed:
            return
        self.closed = True
        self._file.close()
        save(self._metadata((*self._parts, self._file.part())), self.folder)

    def _metadata(self, files: tuple[FilePart, ...]) -> Metadata:
        duration = 0 if self._start_ns is None else self._end_ns - self._start_ns
        return Metadata(
            topics=tuple((topic, self._counts[name]) for name, topic in sorted(self._topics.items())),
            files=files,
            start_ns=self._start_ns,
            duration_ns=duration,
            message_count=self.message_count,
            ros_distro=self._ros_distro,
            custom_data=self._custom,
        )

    def _is_full(self, log_time_ns: int) -> bool:
        start_ns = self._file.start_ns
        if start_ns is None:
            return False
        is_late = 0 < self._split_ns <= log_time_ns - start_ns
        return is_late or 0 < self._split_bytes <= self._file.size

    def _split(self) -> None:
        """Close the file and begin the next one, with the same topics."""
        self._file.close()
        before = (*self._parts, self._file.part())
        file = self._new_file(before)
        self._file, self._parts = file, before
        for topic in self._topics.values():
            file.add_topic(topic)

    def _new_file(self, before: tuple[FilePart, ...]) -> FileWriter:
        path = self.folder / f"{self._name}_{len(before)}.mcap"
        return FileWriter(
            path,
            self._compression,
            self._chunk_bytes,
            lambda part: dump_record(self._metadata((*before, part))),
        )

    def _check_open(self) -> None:
        if self.closed:
            raise BagError("the bag is closed", self.folder, "closed")
