"""Recordings with one flipped bit: read and repaired, and judged by the `mcap` package's own readers."""

from __future__ import annotations

import os
import random
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from io import BytesIO
from pathlib import Path
from unittest import mock

from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, IndexType, Writer

from benchmarks.options import Options
from benchmarks.report import met, table
from soro_core.errors import BagError
from soro_lab.bag import BagReader, repair

TITLE = "Flipped bits in recordings"
FLIPS = 10_000
SHIPPED = Path(__file__).parents[3] / "bags/track_circle_lockstep_2s/bag_0.mcap"
_DATA_END = b"\x0f\x04\0\0\0\0\0\0\0"
# Where the checksum is in a Chunk record.
_CHECKSUM = 33
# Topic, sequence, log and publish time, data.
Told = tuple[str, int, int, int, bytes]


@dataclass
class Found:
    """What has become of the damaged files, counted.

    Attributes
    ----------
    flips, refused, sound, rewritten : int
        Files; those that repair refused in one line, left as they were, and wrote anew.
    unread : int
        As `spared_lost`, of what the reader gives before repair.
    spared_lost : int
        Messages that are missing after repair though the bit was not in their chunk or record.
    unnamed : int
        Files of which repair lost a message without naming a problem.
    altered : int
        Messages after repair that were not recorded so.
    """

    flips: int = 0
    refused: int = 0
    sound: int = 0
    rewritten: int = 0
    unread: int = 0
    spared_lost: int = 0
    unnamed: int = 0
    altered: int = 0

    def __add__(self, other: Found) -> Found:
        return Found(*(getattr(self, item.name) + getattr(other, item.name) for item in fields(self)))

    def is_good(self) -> bool:
        """Whether nothing was lost that was not hit, nor without a word."""
        return self.spared_lost == self.unread == self.unnamed == self.altered == 0


@dataclass
class Recording:
    """A file, and the record of each message, which is that of its chunk.

    `only_names` is where the only descriptions of the topics are.
    """

    content: bytes
    messages: list[tuple[int, int, Told]] = field(default_factory=list)
    has_checksums: bool = True
    only_names: range = range(0)

    @classmethod
    def of(cls, content: bytes) -> Recording:
        """Read a whole file with the `mcap` package."""
        self, topics, position = cls(content), {}, 8
        for record in StreamReader(BytesIO(content), emit_chunks=True).records:
            length = int.from_bytes(content[position + 1 : position + 9], "little")
            end = position + 9 + length
            inner = breakup_chunk(record) if isinstance(record, Chunk) else [record]
            topics.update({item.id: item.topic for item in inner if isinstance(item, Channel)})
            messages = [item for item in inner if isinstance(item, Message)]
            self.messages += [(position, end, _told(topics[item.channel_id], item)) for item in messages]
            position = end
        return self


def flip(
    recording: Recording, flips: int, seed: int, say: Callable[[str], None] = lambda text: None
) -> Found:
    """Read and repair a recording with one random bit flipped, again and again; errors as of `flip_one`."""
    rng, found = random.Random(seed), Found()
    for number in range(flips):
        place, bit = divmod(rng.randrange(8 * len(recording.content)), 8)
        say(f"flip {number} of {flips}: byte {place}, bit {bit}")
        found += flip_one(recording, place, bit)
    return found


def flip_one(recording: Recording, place: int, bit: int) -> Found:
    """Read and repair a recording with one bit flipped.

    Raises
    ------
    AssertionError
        If a refusal has more than one line.
    Exception
        Whatever else than a refusal reader and repair raise, and the `mcap` package on what repair leaves.
    """
    damaged, found = bytearray(recording.content), Found(flips=1)
    damaged[place] ^= 1 << bit
    with tempfile.TemporaryDirectory() as folder, mock.patch.object(os, "fsync"):
        file = Path(folder, "bag.mcap")
        file.write_bytes(damaged)
        read: Counter[Told] = Counter()
        try:
            with BagReader(file) as reader:
                for item in reader.messages():
                    times = item.log_time_ns, item.publish_time_ns
                    read[item.topic, item.sequence, *times, item.data] += 1
        except BagError as error:
            _is_one_line(error)
        try:
            (part,) = repair(file)
        except BagError as error:
            found.refused += _is_one_line(error)
            return found
        after = _messages(file)
    found.rewritten += part.rewritten
    found.sound += not part.rewritten
    whole = Counter(told for _, _, told in recording.messages)
    names_hit = place in recording.only_names
    hit = Counter(told for start, end, told in recording.messages if names_hit or start <= place < end)
    found.spared_lost += (whole - hit - after).total()
    found.unread += (whole - hit - read).total()
    # Without a checksum the hit message cannot be known.
    unknowable = 0 if recording.has_checksums else hit.total()
    found.altered += max(0, (after - whole).total() - unknowable)
    found.unnamed += (whole - after).total() > unknowable and not part.problems
    return found


def _is_one_line(error: BagError) -> bool:
    if "\n" in str(error):
        raise AssertionError(f"several lines: {error}")
    return True


def _messages(file: Path) -> Counter[Told]:
    """What the `mcap` package finds through the index; it walks over all records too, checksums included."""
    with file.open("rb") as stream:
        found = make_reader(stream, validate_crcs=True).iter_messages(log_time_order=False)
        told = Counter(_told(channel.topic, message) for _, channel, message in found)
        stream.seek(0)
        for _ in StreamReader(stream, emit_chunks=True, validate_crcs=True).records:
            pass
    return told


def _told(topic: str, message: Message) -> Told:
    return topic, message.sequence, message.log_time, message.publish_time, message.data


def run(options: Options) -> str:
    """Flip the bits, and write."""
    total = options.pick(FLIPS, 20)
    rows: list[list[object]] = []
    for name, (make, part) in RECORDINGS.items():
        try:
            found = flip(
                make(),
                max(1, total * part // 10),
                408,
                lambda text, name=name: options.say(f"{name}: {text}"),
            )
        except Exception as error:
            rows.append([name, *"-------", f"{type(error).__name__}: {error}", met(False)])
            continue
        counts = [getattr(found, item.name) for item in fields(found)]
        rows.append([name, *counts, met(found.is_good())])
    head = (
        "recording",
        "flips",
        "refused",
        "left as it is",
        "rewritten",
        "spared, not read",
        "spared, lost",
        "lost unnamed",
        "altered",
        "target",
    )
    return (
        f"{total} single-bit flips, seeded. Each damaged file is read, then repaired, and what repair leaves "
        "is read by the `mcap` package through the index and record by record, with all checksums. "
        "*Spared, lost*: "
        "messages that are missing after repair though the bit is neither in their chunk or record, kind "
        "and length included, nor in the only description of their topic. Without checksums, the message "
        "that the bit is in may come out altered. *Spared, not read*: the same of what is read before "
        "repair. Met: no exception but a refusal in one line, no "
        "spared message lost, none lost without a word, none altered.\n\n" + table(head, rows)
    )


# Recordings -----------------------------------------------------------------------------------------
def _made(seed: int = 408, **options: object) -> bytes:
    """A file with metadata, an attachment and 120 messages of three topics in chunks of 3 kB."""
    rng, stream = random.Random(seed), BytesIO()
    writer = Writer(stream, chunk_size=3000, **options)
    writer.start("ros2", "soro")
    channels = []
    for number in range(3):
        schema = writer.register_schema(f"std_msgs/msg/Kind{number}", "ros2msg", b"string data")
        channels.append(writer.register_channel(f"/topic{number}", "cdr", schema, {"topic_type_hash": "h"}))
    writer.add_metadata("setup", {"robot": "six_link", "seed": "408"})
    for number in range(120):
        data = b"\0\1\0\0" + rng.randbytes(rng.randrange(400))
        writer.add_message(rng.choice(channels), 10**9 + number * 10**6, data, 10**9, number + 1)
        if number == 60:
            writer.add_attachment(5, 6, "camera.yaml", "text/yaml", b"k: 1\n" * 40)
    writer.finish()
    return stream.getvalue()


def _unfinished() -> Recording:
    """What a killed recorder leaves: whole chunks, no index."""
    recording = Recording.of(_made(compression=CompressionType.LZ4))
    chunk = make_reader(BytesIO(recording.content)).get_summary().chunk_indexes[0]
    recording.only_names = range(chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length)
    recording.content = recording.content[: recording.content.rindex(_DATA_END)]
    return recording


def _as_rosbag2_writes() -> Recording:
    """Uncompressed chunks without checksums, an index with one."""
    content = bytearray(_made(compression=CompressionType.NONE))
    for chunk in make_reader(BytesIO(content)).get_summary().chunk_indexes:
        start = chunk.chunk_start_offset + _CHECKSUM
        content[start : start + 4] = bytes(4)
    recording = Recording.of(bytes(content))
    recording.has_checksums = False
    return recording


def _outside_chunks() -> Recording:
    recording = Recording.of(_made(use_chunking=False))
    recording.has_checksums = False
    return recording


# By name: what makes the file, and how many of 10 flips it gets.
RECORDINGS: dict[str, tuple[Callable[[], Recording], int]] = {
    "the shipped bag, zstd": (lambda: Recording.of(SHIPPED.read_bytes()), 3),
    "zstd": (lambda: Recording.of(_made(compression=CompressionType.ZSTD)), 1),
    "lz4, with a checksum of the data": (
        lambda: Recording.of(_made(compression=CompressionType.LZ4, enable_data_crcs=True)),
        1,
    ),
    "uncompressed": (lambda: Recording.of(_made(compression=CompressionType.NONE)), 1),
    "no index": (lambda: Recording.of(_made(index_types=IndexType.NONE, use_statistics=False)), 1),
    "lz4, recorder killed": (_unfinished, 1),
    "uncompressed, no checksums of chunks, as rosbag2 writes": (_as_rosbag2_writes, 1),
    "messages outside chunks, no checksums": (_outside_chunks, 1),
}
