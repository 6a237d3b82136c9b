"""Files that want to exhaust or end a reader: one line, in bounded time and memory."""

import os
import resource
import struct
import subprocess
import sys
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from bag_samples import random_messages, write_bag
from mcap.opcode import Opcode

from soro_core.bag import BagReader, repair
from soro_core.bag.records import MAGIC, PREFIX
from soro_core.errors import BagError
from tests.refused import fails

BOMB = bytes(1 << 27)


@pytest.fixture(autouse=True)
def _no_waiting_for_the_disk(monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


def record(opcode: int, body: bytes) -> bytes:
    return PREFIX.pack(opcode, len(body)) + body


def text(value: str) -> bytes:
    return struct.pack("<I", len(value.encode())) + value.encode()


def channel(topic: str = "/a", qos: str = "") -> bytes:
    metadata = text("offered_qos_profiles") + text(qos)
    body = struct.pack("<HH", 1, 1) + text(topic) + text("cdr") + struct.pack("<I", len(metadata)) + metadata
    schema = struct.pack("<H", 1) + text("std_msgs/msg/String") + text("ros2msg") + text("string data")
    return record(Opcode.SCHEMA, schema) + record(Opcode.CHANNEL, body)


def chunk(compression: str, packed: bytes, size: int) -> bytes:
    head = struct.pack("<QQQI", 0, 0, size, 0) + text(compression)
    return record(Opcode.CHUNK, head + struct.pack("<Q", len(packed)) + packed)


def file_of(*parts: bytes) -> bytes:
    return (
        MAGIC
        + record(Opcode.HEADER, bytes(8))
        + b"".join(parts)
        + record(15, bytes(4))
        + record(2, bytes(20))
        + MAGIC
    )


ZSTD, LZ4 = zstandard.compress(BOMB, 1), lz4.frame.compress(BOMB)
HOSTILE = {
    "zstd_that_claims_little": (
        file_of(channel(), chunk("zstd", ZSTD, 100)),
        "is not that of 100 bytes",
    ),
    "zstd_that_claims_4_GB": (file_of(channel(), chunk("zstd", ZSTD, 4 << 30)), "claims 4294967296; allowed"),
    "zstd_that_claims_all": (file_of(channel(), chunk("zstd", ZSTD, len(BOMB))), "claims 134217728; allowed"),
    "lz4_that_claims_little": (file_of(channel(), chunk("lz4", LZ4, 100)), "is not that of 100 bytes"),
    "lz4_that_claims_all": (file_of(channel(), chunk("lz4", LZ4, len(BOMB))), "claims 134217728; allowed"),
    "huge_chunk": (
        MAGIC + record(Opcode.HEADER, bytes(8)) + PREFIX.pack(Opcode.CHUNK, 1 << 62) + bytes(99),
        "byte 25 of 133",
    ),
    "huge_attachment": (file_of(PREFIX.pack(Opcode.ATTACHMENT, 1 << 63)), "9 bytes cannot be read"),
    "huge_text": (
        file_of(record(Opcode.CHANNEL, struct.pack("<HHIQ", 1, 1, 1 << 31, 0))),
        "ends before its fields",
    ),
    "zeros_behind_the_header": (file_of(bytes(1 << 21)), "bytes cannot be read"),
    "noise": (file_of(b"\xff" * (1 << 20)), "bytes cannot be read"),
    "lengths_only": (file_of((b"\x05" + struct.pack("<Q", 30)) * 5_000), "bytes cannot be read"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_named_in_one_line(tmp_path, name):
    content, words = HOSTILE[name]
    file = tmp_path / "bag.mcap"
    file.write_bytes(content)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with BagReader(file) as reader:
        assert list(reader.messages()) == []
        assert words in reader.problems[0]
        assert not any("\n" in problem for problem in reader.problems)
    (part,) = repair(file)
    assert part.original.read_bytes() == content
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 700_000


def test_many_records_of_private_kinds_take_little_time(tmp_path):
    file = tmp_path / "bag.mcap"
    file.write_bytes(file_of(record(0x90, b"") * 5_000))
    with BagReader(file) as reader:
        assert reader.problems == ()
    (part,) = repair(file)
    assert "5000 records of private kinds; left out" in part.problems[-1]


@pytest.mark.parametrize(
    "qos",
    [
        "[" * 100_000,
        "- " * 100_000,
        "- depth: " + "9" * 6000,
        "- depth: .inf",
        "- &a [*a]",
        "- depth: 2001-99-99",
    ],
    ids=["brackets", "dashes", "digits", "infinity", "reference", "date"],
)
def test_hostile_yaml(tmp_path, qos):
    """In a process of its own: many levels ended it. Nothing else is lost by it."""
    file = tmp_path / "bag.mcap"
    file.write_bytes(file_of(channel(qos=qos)))
    bag = write_bag(tmp_path / "run", random_messages(1, 3))
    text = f"rosbag2_bagfile_information:\n  version: 9\n  x:\n  {qos}\n"
    (bag / "metadata.yaml").write_text(text)
    code = (
        "import sys; from soro_core.bag import BagReader\n"
        "with BagReader(sys.argv[1]) as reader: print([topic.qos for topic in reader.topics])\n"
        "with BagReader(sys.argv[2]) as reader:\n"
        "    print(reader.message_count, 'metadata.yaml' in reader.problems[0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(file), str(bag)], capture_output=True, text=True, check=False
    )
    assert done.stdout.splitlines() == ["[()]", "3 True"], done.stderr[-500:]


def test_a_whole_file_that_unpacks_to_too_much(tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda folder: type("Usage", (), {"free": 100_000})())
    file = Path(tmp_path, "bag.mcap.zstd")
    file.write_bytes(zstandard.compress(bytes(1 << 20)))
    with fails(BagError, "50000", file=str(file), code="disk"):
        BagReader(file)
