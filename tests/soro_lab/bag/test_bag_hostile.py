"""Files that want to exhaust or end a reader: one line, in bounded time and memory."""

import os
import random
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

from soro_core.errors import BagError
from soro_lab.bag import BagReader, repair
from soro_lab.bag.mcap.records import MAGIC, PREFIX
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
        "byte 25: the end is missing",
    ),
    "huge_attachment": (
        file_of(PREFIX.pack(Opcode.ATTACHMENT, 1 << 63)),
        "byte 25: bytes that are no record",
    ),
    "huge_text": (
        file_of(record(Opcode.CHANNEL, struct.pack("<HHIQ", 1, 1, 1 << 31, 0))),
        "ends before its fields",
    ),
    "lengths_only": (
        file_of((b"\x05" + struct.pack("<Q", 30)) * 5_000),
        "bytes that are no record",
    ),
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


@pytest.mark.parametrize("content", [bytes(1 << 21), b"\xff" * (1 << 20)], ids=["zeros", "noise"])
def test_a_file_of_nothing_is_refused(tmp_path, content):
    file = tmp_path / "bag.mcap"
    file.write_bytes(file_of(content))
    for action in (BagReader, repair):
        with fails(BagError, "nothing in it can be read", file=str(file), code="damaged"):
            action(file)


def test_some_records_of_private_kinds_are_left_out_by_repair_alone(tmp_path):
    file = tmp_path / "bag.mcap"
    file.write_bytes(file_of(record(0x90, b"") * 5_000))
    with BagReader(file) as reader:
        assert reader.problems == ()
    (part,) = repair(file)
    assert "left out: byte 0: 5000 records of private kinds" in part.problems[0]


# Bombs: files of some 20 MB at most, in a process of its own -----------------------------------------
# Seconds and memory that 20 MB may take; a smaller file, where they are in proportion to it, its part.
MOST_KB, MOST_S, ALONE_KB = 256_000, 10.0, 60_000
SIZE = 8_000_000
PART = SIZE / 20_000_000
IN_PROPORTION = ("small chunks", "small messages", "a map of millions", "indexes of chunks")
IN_PROPORTION += ("lengths within lengths", "chunks within chunks", "noise")
MANY_MS = 1 << 26
# Peak of this program alone: that of `getrusage` begins with its parent's.
RUN = """
import sys, time
from soro_ros.cli import main
for command in ("info", "repair"):
    begin = time.process_time()
    sys.argv[1:] = ["bag", command, sys.argv[-1]]
    try:
        main()
    except SystemExit as ended:
        status = ended.code
    peak = next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM"))
    print("measured", status, peak, time.process_time() - begin)
"""


def message(size: int = 0) -> bytes:
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 1, 1) + bytes(size))


def many(part: bytes) -> bytes:
    return part * (SIZE // len(part))


def packed(content: bytes, compression: str) -> bytes:
    data = zstandard.compress(content, 1) if compression == "zstd" else lz4.frame.compress(content)
    return chunk(compression, data, len(content))


def with_index(*records: bytes) -> bytes:
    data = MAGIC + record(Opcode.HEADER, bytes(8)) + channel() + record(Opcode.DATA_END, bytes(4))
    foot = struct.pack("<QQI", len(data), 0, 0)
    return data + b"".join(records) + record(Opcode.FOOTER, foot) + MAGIC


def named_channel(number: int, qos: str) -> bytes:
    notes = text("offered_qos_profiles") + text(qos)
    body = struct.pack("<HH", number, 1) + text(f"/{number}") + text("cdr")
    return record(Opcode.CHANNEL, body + struct.pack("<I", len(notes)) + notes)


def schema_of(size: int, number: int = 1) -> bytes:
    head = struct.pack("<H", number) + text("a/msg/B") + text("ros2msg")
    return record(Opcode.SCHEMA, head + text("x" * size))


def chunk_index_of(place: int) -> bytes:
    """One that names the message indexes of 65,000 channels from a place on."""
    offsets = b"".join(struct.pack("<HQ", number, place + number) for number in range(65_000))
    return struct.pack("<QQQQI", 0, 0, 8, 57, len(offsets)) + offsets + bytes(8) + text("") + bytes(16)


NUMBERS = range(65_536)
CHUNK_INDEX = struct.pack("<QQQQIQ", 0, 0, 8, 57, 0, 0) + text("") + bytes(16)
BOMBS = {
    "zeros in zstd": lambda: file_of(channel(), packed(bytes(MANY_MS), "zstd") * 2000),
    "small messages in zstd": lambda: file_of(channel(), packed(message() * 2_000_000, "zstd") * 400),
    "a window of a gigabyte": lambda: file_of(channel(), chunk("zstd", LONG_WINDOW, MANY_MS)),
    "small chunks": lambda: file_of(channel(), many(chunk("", b"", 0))),
    "small messages": lambda: file_of(channel(), many(message())),
    "a map of millions": lambda: file_of(
        record(
            Opcode.CHANNEL,
            struct.pack("<HH", 1, 1)
            + text("/a")
            + text("cdr")
            + struct.pack("<I", SIZE)
            + b"".join(text(f"{number:07d}") + bytes(4) for number in range(SIZE // 15)),
        )
    ),
    "schemas of 60 MB in zstd": lambda: file_of(
        *(packed(schema_of(60_000_000, number), "zstd") for number in range(10)), many(b"\x90" + bytes(8))
    ),
    "channels with YAML": lambda: file_of(
        schema_of(1),
        *(named_channel(number, f"- {{depth: {number}, a: [{'1, ' * 40}1]}}") for number in NUMBERS),
    ),
    "qualities of one publisher": lambda: file_of(
        channel(qos="".join(f"- {{depth: {number}}}\n" for number in range(50_000)))
    ),
    "small schemas in zstd": lambda: file_of(packed(schema_of(0) * 1_000_000, "zstd") * 4),
    "indexes of chunks": lambda: with_index(many(record(Opcode.CHUNK_INDEX, CHUNK_INDEX))),
    "indexes of messages of chunks": lambda: with_index(
        *(record(Opcode.CHUNK_INDEX, chunk_index_of(65_000 * number)) for number in range(30))
    ),
    "lengths within lengths": lambda: file_of(
        channel(), b"".join(PREFIX.pack(Opcode.CHUNK, SIZE - 9 * k) for k in range(SIZE // 9))
    ),
    "chunks within chunks": lambda: file_of(
        b"".join(
            PREFIX.pack(Opcode.CHUNK, SIZE - 53 * k)
            + struct.pack("<QQQI", 0, 0, 99, 0)
            + text("zstd")
            + struct.pack("<Q", max(0, SIZE - 53 * k - 44))
            for k in range(SIZE // 53)
        )
    ),
    "noise": lambda: file_of(channel(), random.Random(5).randbytes(SIZE)),
}
LONG_WINDOW = zstandard.ZstdCompressor(
    compression_params=zstandard.ZstdCompressionParameters(window_log=30, compression_level=1)
).compress(bytes(MANY_MS))


@pytest.mark.process
@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_takes_little_time_and_memory(tmp_path, name):
    file = tmp_path / "bag.mcap"
    content = BOMBS[name]()
    file.write_bytes(content)
    assert len(content) < 22_000_000
    part = PART if name in IN_PROPORTION else 1.0
    del content
    done = subprocess.run([sys.executable, "-c", RUN, str(file)], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr, done.stderr[-500:]
    assert len(done.stderr.splitlines()) <= 2
    lines = done.stdout.splitlines()
    measured = [line.split()[1:] for line in lines if line.startswith("measured ")]
    assert len(measured) == 2
    for status, peak_kb, seconds in measured:
        assert int(status) in (0, 1, 2)  # 1: a repair that saves no message
        assert int(peak_kb) < ALONE_KB + part * (MOST_KB - ALONE_KB)
        assert float(seconds) < part * MOST_S  # of the processor: others may use the machine
    assert len(lines) < 1100


@pytest.mark.process
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
        "import sys; from soro_lab.bag import BagReader\n"
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
