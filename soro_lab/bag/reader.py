"""Reading bags of rosbag2: serialised messages in the order of their log times."""

from __future__ import annotations

import heapq
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path

from mcap.records import Message

from soro_core.errors import BagError
from soro_lab.bag import metadata as bag_metadata
from soro_lab.bag.mcap.part import BagFile, Block
from soro_lab.bag.mcap.records import Damage
from soro_lab.bag.mcap.summary import open_part
from soro_lab.bag.metadata import Metadata
from soro_lab.bag.topics import SEVERAL, Qos, Topic, check_encoding, encoding, qos_from
from soro_lab.run_folder import bag_of

_ENDINGS, _SQLITE = (".mcap", ".mcap.zstd"), ".db3"
# Most bytes of different qualities of service that are read of a file: YAML takes its time.
_MOST_QOS = 1 << 20


@dataclass(frozen=True, slots=True)
class BagMessage:
    """One recorded message."""

    topic: str
    """Name of the topic."""
    type: str
    """Name of the type, `package/msg/Name`."""
    data: bytes
    """Serialised message (CDR)."""
    log_time_ns: int
    """When it was recorded [ns]."""
    publish_time_ns: int
    """When it was published [ns]."""
    sequence: int
    """Number that the publisher gave; 0 where there is none."""


class BagReader:
    """An open bag.

    Parameters
    ----------
    path : str or Path
        Folder of a run, or of its bag (with or without metadata.yaml, in one file or several), or a single
        file: MCAP or sqlite3 (``.db3``).
    index : bool
        Use the index of the files if it is complete; False reads all records.

    Attributes
    ----------
    topics : tuple of Topic
        Sorted by name.
    counts : tuple of int
        Number of messages of each of `topics`.
    start_ns, end_ns : int
        Log times of the first and the last message, 0 without messages.
    message_count : int
        Number of messages.
    parts : tuple of BagFile
        The files in order.
    metadata : Metadata or None
        Contents of metadata.yaml, if there is one.

    Raises
    ------
    BagError
        If the file is missing or not a bag, or a part is missing.
    """

    def __init__(self, path: str | Path, index: bool = True) -> None:
        self.path = bag_of(Path(path))
        self._problems: list[str] = []
        self.metadata = load_metadata(self.path, self._problems)
        files = part_files(self.path, self.metadata)
        parts: list[BagFile] = []
        try:
            for file in files:
                parts.append(_opened(file, index))
            self.parts = tuple(parts)
            self._topics = [_topics(part, self.metadata) for part in parts]
        except BaseException:
            for part in parts:
                part.close()
            raise
        self.topics, self.counts = self._merge_topics()
        self.message_count = sum(self.counts)
        spans = [span for part in parts if (span := part.span_ns()) is not None]
        self.start_ns = min((start for start, _ in spans), default=0)
        self.end_ns = max((end for _, end in spans), default=0)
        if self.metadata is not None and self.metadata.message_count != self.message_count:
            claimed = self.metadata.message_count
            self._problems.append(f"metadata.yaml: states {claimed} messages; there are {self.message_count}")

    @property
    def problems(self) -> tuple[str, ...]:
        """What is damaged or missing, as far as has been read; empty for a sound bag."""
        return (*self._problems, *(problem for part in self.parts for problem in part.problems))

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; may be called again."""
        for part in self.parts:
            part.close()

    def check_encodings(self) -> None:
        """Raise BagError, which says what they are, if no message is one of ROS 2."""
        if all(encoding(topic) for topic in self.topics):
            for topic in self.topics:
                check_encoding(topic, self.path)

    def topic(self, name: str) -> Topic:
        """Return the topic of a name; raise BagError if there is none."""
        for topic in self.topics:
            if topic.name == name:
                return topic
        known = ", ".join(topic.name for topic in self.topics) or "none"
        raise BagError(f"no topic {name!r}; there are {known}", self.path, "missing")

    def count(self, name: str) -> int:
        """Return the number of messages of a topic; 0 where there is none."""
        return sum(count for topic, count in zip(self.topics, self.counts, strict=True) if topic.name == name)

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[BagMessage]:
        """Yield messages in the order of their log times; equal times in the order of writing.

        A damaged chunk is left out, and becomes one of `problems`.

        Parameters
        ----------
        topics : collection of str, optional
            Names of the topics; all by default.
        start_ns, end_ns : int, optional
            Range of log times [ns], both included.
        """
        low = self.start_ns if start_ns is None else start_ns
        high = self.end_ns if end_ns is None else end_ns
        waiting = [
            (block.start_ns, number, block.offset, block)
            for number, part in enumerate(self.parts)
            for block in part.blocks
            if block.end_ns >= low and block.start_ns <= high
        ]
        waiting.sort(key=itemgetter(slice(3)), reverse=True)
        wanted = [
            {number for number, topic in table.items() if topics is None or topic.name in topics}
            for table in self._topics
        ]
        opened: list[tuple[int, int, int, Block, Message, Iterator[Message]]] = []

        def take(number: int, block: Block, messages: Iterator[Message]) -> None:
            """Hold the next message of a block ready."""
            try:
                message = next(messages, None)
            except Damage as damage:
                self.parts[number].lose(block.offset, damage)
                return
            if message is not None:
                heapq.heappush(opened, (message.log_time, number, block.offset, block, message, messages))

        while waiting or opened:
            # All blocks that may hold an earlier message must be open before a message is yielded.
            while waiting and (not opened or waiting[-1][0] <= opened[0][0]):
                _, number, _, block = waiting.pop()
                take(number, block, self.parts[number].messages(block, wanted[number], low, high))
            if opened:
                _, number, _, block, raw, messages = heapq.heappop(opened)
                topic, times = self._topics[number][raw.channel_id], (raw.log_time, raw.publish_time)
                yield BagMessage(topic.name, topic.type, raw.data, *times, raw.sequence)
                take(number, block, messages)

    def _merge_topics(self) -> tuple[tuple[Topic, ...], tuple[int, ...]]:
        """Return topics and counts of all parts, merged by name and type."""
        merged: dict[tuple[str, str], Topic] = {}
        counts: Counter[tuple[str, str]] = Counter()
        others: defaultdict[tuple[str, str], dict[Qos, None]] = defaultdict(dict)
        for part, table in zip(self.parts, self._topics, strict=True):
            for channel_id, topic in table.items():
                key = topic.name, topic.type
                counts[key] += part.counts[channel_id]
                known = merged.setdefault(key, topic)
                if known is not topic:
                    others[key].update(dict.fromkeys(topic.qos))
                    if known.definition and topic.definition not in ("", known.definition):
                        merged[key] = replace(known, definition_encoding=SEVERAL)
        for key, more in others.items():
            topic, own = merged[key], set(merged[key].qos)
            merged[key] = replace(topic, qos=topic.qos + tuple(item for item in more if item not in own))
        ordered = sorted(merged)
        return tuple(merged[key] for key in ordered), tuple(counts[key] for key in ordered)


def part_files(path: Path, metadata: Metadata | None) -> list[Path]:
    """Return the files of a bag in their order.

    Raises
    ------
    BagError
        If there is no file, or a file of metadata.yaml is missing.
    """
    if not path.exists():
        raise BagError("no such file or folder", path, "missing")
    if not path.is_dir():
        return [path]
    if metadata is not None:
        if metadata.storage not in ("mcap", "sqlite3"):
            raise BagError(f"storage {metadata.storage}; allowed: mcap, sqlite3", path, "format")
        if metadata.compression_mode == "message":
            raise BagError("compression of single messages; allowed: chunks or files", path, "format")
        # Old recorders put the bag's folder in front of the name.
        files = [path / Path(part.path).name for part in metadata.files]
        for file in files:
            if not file.is_file():
                raise BagError("no such file, but metadata.yaml names it", file, "missing")
        if files:
            return files
    for endings in (_ENDINGS, (_SQLITE,)):
        found = [file for file in path.iterdir() if file.name.endswith(endings) and file.is_file()]
        if found:
            break
    else:
        raise BagError("not a bag: no .mcap or .db3 file in it, and no folder bag", path, "missing")
    return sorted(found, key=_natural)


def _natural(file: Path) -> list[tuple[int, str]]:
    """Return a sort key that puts bag_10 after bag_9."""
    pieces = re.split(r"(\d+)", file.name)
    return [(int(piece), "") if piece.isdigit() else (-1, piece) for piece in pieces]


def load_metadata(path: Path, problems: list[str]) -> Metadata | None:
    """Read metadata.yaml; return None and note a problem if it is damaged (the files hold the same data)."""
    file = path / "metadata.yaml"
    if not path.is_dir():
        return None
    if not file.is_file():
        problems.append("metadata.yaml is missing")
        return None
    try:
        return bag_metadata.parse(file.read_text(encoding="utf-8"), str(file))
    except (OSError, UnicodeDecodeError) as error:
        problems.append(f"metadata.yaml cannot be read: {error}")
    except BagError as error:
        problems.append(f"{error}; it is ignored")
    return None


def _opened(file: Path, index: bool) -> BagFile:
    if file.suffix != _SQLITE:
        return open_part(file, index)
    from soro_lab.bag.sqlite import open_sqlite  # rosbags takes a while to import

    return open_sqlite(file)


def _topics(part: BagFile, metadata: Metadata | None) -> dict[int, Topic]:
    """Return the topics of a file by the number of their channel."""
    noted = {topic.name: topic for topic, _ in metadata.topics} if metadata else {}
    texts = {number: schema.data.decode("utf-8", "replace") for number, schema in part.schemas.items()}
    profiles: dict[str, tuple[Qos, ...]] = {"": ()}
    read = 0
    found = {}
    for channel in part.channels.values():
        text = channel.metadata.get("offered_qos_profiles", "")
        if text not in profiles:
            read += len(text)
            profiles[text] = _qos(text) if read <= _MOST_QOS else ()
        known, schema = noted.get(channel.topic), part.schemas.get(channel.schema_id)
        found[channel.id] = Topic(
            name=channel.topic,
            type=schema.name if schema else "",
            definition=texts.get(channel.schema_id, ""),
            definition_encoding=schema.encoding if schema else "",
            type_hash=channel.metadata.get("topic_type_hash") or (known.type_hash if known else ""),
            qos=profiles[text] or (known.qos if known else ()),
            serialization_format=channel.message_encoding,
        )
    return found


def _qos(text: str) -> tuple[Qos, ...]:
    try:
        return qos_from(text)
    except BagError:
        return ()
