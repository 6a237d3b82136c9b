"""One flipped bit anywhere in a recording: repaired or refused in one line; what it spared is kept.

The whole number of flips runs in `python -m tests.apparatus --only bags`.
"""

import os
from io import BytesIO

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer

from soro_lab.bag import BagReader
from soro_lab.bag.mcap.records import PREFIX
from tests.apparatus.fuzz.bags import RECORDINGS, Recording, flip, flip_one


@pytest.fixture(autouse=True)
def _no_waiting_for_the_disk(monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


@pytest.mark.slow
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


@pytest.mark.slow
def test_every_third_byte_of_a_small_file():
    recording = small()
    for place in range(0, len(recording.content), 3):
        found = flip_one(recording, place, place % 8)
        assert found.is_good(), place
        assert not found.refused, place


@pytest.mark.parametrize("opcode", [Opcode.CHUNK, Opcode.MESSAGE_INDEX])
@pytest.mark.parametrize("name", ["uncompressed", "lz4, recorder killed"])
def test_every_bit_of_the_prefix_of_a_record(opcode, name):
    """A kind or a length that is wrong costs that record at most, with an index and without."""
    recording = RECORDINGS[name][0]()
    start = [place for kind, place in places(recording.content) if kind == opcode][2]
    for place in range(start, start + PREFIX.size):
        for bit in range(8):
            assert flip_one(recording, place, bit).is_good(), (place, bit)


def places(content: bytes) -> list[tuple[int, int]]:
    """Kind and begin of each record."""
    found, position = [], 8
    while position + PREFIX.size < len(content):
        opcode, length = PREFIX.unpack_from(content, position)
        found.append((opcode, position))
        position += PREFIX.size + length
    return found


@pytest.mark.parametrize("bit", [7, 12, 20, 30, 40, 62])
def test_a_length_without_sense_costs_its_chunk_at_most(tmp_path, bit):
    """The shipped bag with and without its index: the walk goes on at the next chunk."""
    recording = RECORDINGS["the shipped bag, zstd"][0]()
    chunks = [place for kind, place in places(recording.content) if kind == Opcode.CHUNK]
    for end in (len(recording.content), recording.content.rindex(b"\x0f\x04\0\0\0\0\0\0\0")):
        content = bytearray(recording.content[:end])
        content[chunks[1] + 1 + bit // 8] ^= 1 << bit % 8
        (tmp_path / "bag.mcap").write_bytes(content)
        hit = sum(1 for start, _, _ in recording.messages if start == chunks[1])
        with BagReader(tmp_path / "bag.mcap", index=False) as reader:
            assert reader.problems
            assert reader.message_count >= len(recording.messages) - hit
            assert sum(1 for _ in reader.messages()) == reader.message_count


def test_an_index_that_is_marked_as_a_message_does_not_become_one(tmp_path):
    """It names a channel that exists, and the file has no count of its messages."""
    recording = RECORDINGS["lz4, recorder killed"][0]()
    content = bytearray(recording.content)
    place = next(place for kind, place in places(content) if kind == Opcode.MESSAGE_INDEX)
    content[place] = Opcode.MESSAGE
    (tmp_path / "bag.mcap").write_bytes(content)
    with BagReader(tmp_path / "bag.mcap") as reader:
        assert reader.message_count == len(recording.messages)


def test_a_channel_that_is_marked_as_a_message_does_not_become_one():
    recording = RECORDINGS["messages outside chunks, no checksums"][0]()
    place = recording.content.index(b"/topic2") - 17
    assert recording.content[place] == Opcode.CHANNEL
    assert flip_one(recording, place, 0).is_good()


def test_a_flip_in_a_missing_checksum():
    """The checksum 0 says that there is none."""
    recording = RECORDINGS["uncompressed, no checksums of chunks, as rosbag2 writes"][0]()
    chunk = make_reader(BytesIO(recording.content)).get_summary().chunk_indexes[1]
    assert flip_one(recording, chunk.chunk_start_offset + 34, 1).is_good()
