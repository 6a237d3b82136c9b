"""One flipped bit anywhere in a recording: repaired or refused in one line, and what it spared is kept.

The whole number of flips runs in `python -m tests.apparatus --only bags`.
"""

import os
from io import BytesIO

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from soro_core.bag import BagReader, repair
from soro_core.bag.chunks import salvage_chunk
from soro_core.bag.records import CHANNEL, CHUNK, MESSAGE, MESSAGE_INDEX, PREFIX
from soro_core.errors import BagError
from tests.apparatus.fuzz.bags import RECORDINGS, SHIPPED, Recording, flip, flip_one
from tests.refused import fails


@pytest.fixture(autouse=True)
def _no_waiting_for_the_disk(monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def flipped(content: bytes, place: int, bit: int) -> bytes:
    damaged = bytearray(content)
    damaged[place] ^= 1 << bit
    return bytes(damaged)


def test_a_flipped_bit_in_the_name_of_a_compression(tmp_path):
    """The shipped bag: 'zstd' becomes '{std' in the last chunk; the reader says so, repair loses nothing."""
    file = tmp_path / "bag_0.mcap"
    content = SHIPPED.read_bytes()
    chunk = make_reader(BytesIO(content)).get_summary().chunk_indexes[-1]
    place = content.index(b"zstd", chunk.chunk_start_offset)
    assert place == chunk.chunk_start_offset + PREFIX.size + 32
    file.write_bytes(flipped(content, place, 0))
    with BagReader(SHIPPED) as reader:
        before = list(reader.messages())
    with (
        BagReader(file) as reader,
        fails(BagError, "{std", file=str(file), code="damaged"),
    ):
        list(reader.messages())
    (part,) = repair(file)
    assert part.rewritten
    with BagReader(file) as reader:
        assert reader.problems == ()
        assert list(reader.messages()) == before


@pytest.mark.parametrize("name", RECORDINGS)
def test_flips_anywhere(name):
    found = flip(RECORDINGS[name][0](), 8 if "shipped" in name else 40, seed=14)
    assert found.is_good(), found
    assert found.refused == 0


def small() -> Recording:
    """Every kind of record in few bytes."""
    stream = BytesIO()
    writer = Writer(stream, chunk_size=60, enable_data_crcs=True)
    writer.start("ros2", "soro")
    channel = writer.register_channel(
        "/a", "cdr", writer.register_schema("s/msg/S", "ros2msg", b"x"), {"k": "v"}
    )
    for number in range(4):
        writer.add_message(channel, 5 + number, b"\0\1\0\0data", 4, number)
    writer.add_attachment(5, 6, "a.yaml", "text/yaml", b"k: 1")
    writer.add_metadata("setup", {"robot": "r"})
    writer.finish()
    return Recording.of(stream.getvalue())


def test_every_third_byte_of_a_small_file():
    recording = small()
    for place in range(0, len(recording.content), 3):
        found = flip_one(recording, place, place % 8)
        assert found.is_good(), place
        assert not found.refused, place


@pytest.mark.parametrize("opcode", [CHUNK, MESSAGE_INDEX])
def test_every_bit_of_the_prefix_of_a_record(opcode):
    """A kind or a length that is wrong hides neither the record nor those behind it."""
    recording = RECORDINGS["uncompressed"][0]()
    summary = make_reader(BytesIO(recording.content)).get_summary()
    chunk = summary.chunk_indexes[1]
    start = chunk.chunk_start_offset + (chunk.chunk_length if opcode == MESSAGE_INDEX else 0)
    assert recording.content[start] == opcode
    for place in range(start, start + PREFIX.size):
        for bit in range(8):
            assert flip_one(recording, place, bit).is_good(), (place, bit)


def test_one_flipped_bit_in_an_uncompressed_chunk_is_set_right():
    """The checksum says which one it is."""
    recording = RECORDINGS["uncompressed"][0]()
    chunk = make_reader(BytesIO(recording.content)).get_summary().chunk_indexes[0]
    start, end = chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length
    raw = recording.content[start:end]
    for place in range(PREFIX.size + 40, len(raw), 97):
        found = salvage_chunk(memoryview(flipped(raw, place, place % 8)))
        assert bytes(found) == raw[PREFIX.size + 40 :]


def test_an_index_that_is_marked_as_a_message_does_not_become_one(tmp_path):
    """It names a channel that exists, and the file has no count of its messages."""
    recording = RECORDINGS["lz4, recorder killed"][0]()
    content = bytearray(recording.content)
    file = tmp_path / "bag.mcap"
    position, hit = 8, False
    while not hit:
        opcode, length = PREFIX.unpack_from(content, position)
        hit = opcode == MESSAGE_INDEX
        if hit:
            content[position] = MESSAGE
        position += PREFIX.size + length
    file.write_bytes(content)
    with BagReader(file) as reader:
        assert reader.message_count == len(recording.messages)


def test_a_channel_that_is_marked_as_a_message_does_not_become_one():
    recording = RECORDINGS["messages outside chunks, no checksums"][0]()
    place = recording.content.index(b"/topic2") - 17
    assert recording.content[place] == CHANNEL
    assert flip_one(recording, place, 0).is_good()


def test_a_flip_in_a_missing_checksum_or_in_the_first_bytes():
    """The checksum 0 says that there is none; an unfinished recording has its first bytes only once."""
    recording = RECORDINGS["uncompressed, no checksums of chunks, as rosbag2 writes"][0]()
    chunk = make_reader(BytesIO(recording.content)).get_summary().chunk_indexes[1]
    assert flip_one(recording, chunk.chunk_start_offset + 34, 1).is_good()
    found = flip_one(RECORDINGS["lz4, recorder killed"][0](), 6, 5)
    assert found.is_good()
    assert not found.refused
