"""Cut, damaged and missing files: what is there is read and repaired, and the rest is said in one line."""

import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
from bag_samples import TOPICS, random_messages, read_all, write_bag
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment
from rosbags.rosbag2 import Reader

from soro_core.errors import BagError
from soro_lab.bag import BagReader, repair
from soro_lab.bag.mcap.mcap_file import McapFile
from soro_lab.bag.mcap.records import MAGIC, PREFIX
from tests.refused import fails


def record_places(content: bytes) -> list[tuple[int, int, int]]:
    """(opcode, start, end) of the records of a whole file."""
    places, position = [], len(MAGIC)
    while position < len(content) - len(MAGIC):
        opcode, length = PREFIX.unpack_from(content, position)
        end = position + PREFIX.size + length
        places.append((opcode, position, end))
        position = end
    return places


def header_end(content: bytes) -> int:
    return record_places(content)[0][2]


def rosbags_messages(path) -> list[bytes]:
    with Reader(path) as reader:
        return [data for _, _, data in reader.messages()]


@pytest.fixture(autouse=True)
def _no_waiting_for_the_disk(monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


# Wrong input --------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("make", "file", "code", "name"),
    [
        (lambda bag: shutil.rmtree(bag), "", "missing", ""),
        (lambda bag: (bag / "run_0.mcap").unlink(), "run_0.mcap", "missing", "metadata.yaml"),
        (lambda bag: [file.unlink() for file in bag.iterdir()], "", "missing", ".mcap"),
        (lambda bag: (bag / "run_0.mcap").write_bytes(b""), "run_0.mcap", "damaged", "empty"),
        (lambda bag: (bag / "run_0.mcap").write_text("t,p1\n0,1\n"), "run_0.mcap", "format", "b't,p1"),
        (lambda bag: (bag / "run_0.mcap").write_bytes(MAGIC), "run_0.mcap", "damaged", "nothing in it"),
        (
            lambda bag: (bag / "run_0.mcap").write_bytes(MAGIC + b"\x01\xff"),
            "run_0.mcap",
            "damaged",
            "nothing in it",
        ),
        (
            lambda bag: (bag / "run_0.mcap").write_bytes(MAGIC + bytes(1000)),
            "run_0.mcap",
            "damaged",
            "nothing in it",
        ),
        (
            lambda bag: change(bag / "metadata.yaml", "mcap\n", "sqlite4\n"),
            "",
            "format",
            "sqlite4; allowed: mcap, sqlite3",
        ),
        (
            lambda bag: change(bag / "metadata.yaml", "mode: ''", "mode: MESSAGE"),
            "",
            "format",
            "compression",
        ),
    ],
)
def test_wrong_input_is_named_in_one_line(tmp_path, make, file, code, name):
    bag = write_bag(tmp_path / "run", random_messages(1, 20))
    make(bag)
    for action in (BagReader, repair):
        with fails(BagError, name, file=str(bag / file), code=code):
            action(bag)


def change(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize("text", ["", "a: [", "rosbag2_bagfile_information: {version: 9}"])
def test_damaged_metadata_is_noted_and_repaired(tmp_path, text):
    messages = random_messages(1, 20)
    bag = write_bag(tmp_path / "run", messages)
    whole = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(text)
    with BagReader(bag) as reader:
        assert list(reader.messages()) == messages
        assert "metadata.yaml" in reader.problems[0]
    assert [part.rewritten for part in repair(bag)] == [False]
    assert (bag / "metadata.yaml").read_text() == whole


def test_wrong_counts_in_metadata_are_noted(tmp_path):
    bag = write_bag(tmp_path / "run", random_messages(1, 20))
    change(bag / "metadata.yaml", "message_count: 20", "message_count: 21")
    with BagReader(bag) as reader:
        (problem,) = reader.problems
        assert problem.startswith("metadata.yaml: ")
        assert "21" in problem
        assert "20" in problem


# Cut files ----------------------------------------------------------------------------------------
@pytest.mark.slow
def test_cut_at_and_around_every_record(tmp_path):
    """Whatever was whole on the disk is read, and repair makes a sound bag of exactly that."""
    messages = random_messages(seed=11, count=45)
    bag = write_bag(tmp_path / "run", messages, compression="none", chunk_bytes=3000)
    file = bag / "run_0.mcap"
    content = file.read_bytes()
    (bag / "metadata.yaml").unlink()
    places = record_places(content)
    data_end = next(end for opcode, _, end in places if opcode == Opcode.DATA_END)
    with BagReader(bag, index=False) as reader:
        ends = {
            block.offset + block.length: sum(1 for _ in reader.parts[0].messages(block))
            for block in reader.parts[0].blocks
        }
    cuts = {end + delta for _, _, end in places for delta in (-1, 0, 1, 9)}
    for cut in sorted(cut for cut in cuts if header_end(content) <= cut < len(content)):
        file.write_bytes(content[:cut])
        whole = sum(count for end, count in ends.items() if end <= cut)
        with BagReader(bag) as reader:
            read = list(reader.messages())
            assert read == messages[:whole]
            assert len(reader.problems) >= 2, cut
        done = repair(bag)
        assert done[0].message_count == len(read)
        assert done[0].rewritten
        with BagReader(bag) as reader:
            assert reader.problems == ()
            assert reader.parts[0].indexed
            assert list(reader.messages()) == read
        assert rosbags_messages(bag) == [item.data for item in read]
        if cut < data_end - 13 and done[0].original is not None:
            assert done[0].original.read_bytes() == content[:cut]
        for left in bag.iterdir():
            left.unlink()


def attempt(action, *arguments):
    """What an action returns, or the BagError that it raises."""
    try:
        return action(*arguments)
    except BagError as error:
        return error


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_changed_bytes_never_raise_anything_else(tmp_path, seed):
    """Whatever a disk does to the bytes: an answer or a BagError of one line, before and after repair."""
    rng = np.random.default_rng(seed)
    messages = random_messages(seed=seed, count=80)
    known = {item.data for item in messages}
    bag = write_bag(tmp_path / "run", messages, compression=("none", "zstd", "lz4")[seed], chunk_bytes=1500)
    content = (bag / "run_0.mcap").read_bytes()
    copy = tmp_path / "copy"
    for _ in range(60):
        damaged = bytearray(content)
        for place in rng.integers(0, len(content), int(rng.integers(1, 4))):
            damaged[place] = int(rng.integers(256))
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(bag, copy)
        (copy / "run_0.mcap").write_bytes(bytes(damaged))
        for action in (read_all, repair, read_all):
            result = attempt(action, copy)
            if isinstance(result, BagError):
                assert "\n" not in str(result)
            elif action is read_all:
                assert len(result) <= len(messages)
                # A chunk's checksum covers its messages: none comes out changed.
                assert {item.data for item in result} <= known


def test_a_damaged_chunk_costs_only_itself(tmp_path):
    messages = random_messages(seed=13, count=200)
    bag = write_bag(tmp_path / "run", messages, chunk_bytes=2000)
    file = bag / "run_0.mcap"
    content = bytearray(file.read_bytes())
    chunks = [(start, end) for opcode, start, end in record_places(bytes(content)) if opcode == Opcode.CHUNK]
    start, end = chunks[len(chunks) // 2]
    content[(start + end) // 2] ^= 0xFF
    file.write_bytes(bytes(content))
    line = f"run_0.mcap: left out: byte {start}: the checksum of a chunk is wrong"
    with BagReader(bag) as reader:
        assert reader.problems == ()  # by its index it is sound
        for _ in range(2):
            before = list(reader.messages())
            assert [problem.startswith(line) for problem in reader.problems] == [True]
    (part,) = repair(bag)
    assert part.rewritten
    assert part.problems[0].startswith(line)
    assert part.original.read_bytes() == bytes(content)
    read = read_all(bag)
    assert read == before
    assert len(messages) - 20 < len(read) < len(messages)
    assert [item for item in messages if item in read] == read
    assert rosbags_messages(bag) == [item.data for item in read]


def test_a_chunk_without_checksum_is_checked_by_its_size(tmp_path):
    """rosbag2 writes no checksums by default."""
    messages = random_messages(seed=16, count=20)
    bag = write_bag(tmp_path / "run", messages, compression="none")
    file = bag / "run_0.mcap"
    content = bytearray(file.read_bytes())
    start = next(start for opcode, start, _ in record_places(bytes(content)) if opcode == Opcode.CHUNK)
    size, crc = start + PREFIX.size + 16, start + PREFIX.size + 24
    content[crc : crc + 4] = bytes(4)
    file.write_bytes(bytes(content))
    assert read_all(bag) == messages
    content[size] ^= 1
    file.write_bytes(bytes(content))
    with BagReader(bag) as reader:
        assert list(reader.messages()) == []
        assert f"byte {start}: the uncompressed data of a chunk is not that of" in reader.problems[0]


def test_the_first_chunk_with_the_names_of_the_topics_is_damaged(tmp_path):
    """The copies in the index name the topics of all other chunks."""
    messages = random_messages(seed=14, count=200)
    bag = write_bag(tmp_path / "run", messages, chunk_bytes=2000)
    content = bytearray((bag / "run_0.mcap").read_bytes())
    start = next(start for opcode, start, _ in record_places(bytes(content)) if opcode == Opcode.CHUNK)
    content[start + 120] ^= 0xFF
    (bag / "run_0.mcap").write_bytes(bytes(content))
    repair(bag)
    assert len(read_all(bag)) > len(messages) - 25


def test_a_damaged_index_is_not_used(tmp_path):
    messages = random_messages(seed=15, count=100)
    bag = write_bag(tmp_path / "run", messages, chunk_bytes=2000)
    content = bytearray((bag / "run_0.mcap").read_bytes())
    content[-60] ^= 0xFF
    (bag / "run_0.mcap").write_bytes(bytes(content))
    with BagReader(bag) as reader:
        assert list(reader.messages()) == messages
        (problem,) = reader.problems
        assert problem.startswith("run_0.mcap: ")
        assert "checksum of the index" in problem
    (part,) = repair(bag)
    assert (part.rewritten, part.original, part.message_count) == (True, None, 100)
    assert rosbags_messages(bag) == [item.data for item in messages]


# Repair -------------------------------------------------------------------------------------------
def test_a_sound_bag_stays_as_it_is(tmp_path):
    bag = write_bag(tmp_path / "run", random_messages(2, 50), custom_data={"seed": "2"})
    before = {file.name: file.read_bytes() for file in bag.iterdir()}
    assert [(part.rewritten, part.problems) for part in repair(bag)] == [(False, ())]
    assert {file.name: file.read_bytes() for file in bag.iterdir()} == before


def test_what_the_recorder_noted_survives_the_loss_of_metadata(tmp_path):
    bag = write_bag(
        tmp_path / "run", random_messages(2, 50), custom_data={"scene": "circle"}, chunk_bytes=1000
    )
    (bag / "metadata.yaml").unlink()
    content = (bag / "run_0.mcap").read_bytes()
    (bag / "run_0.mcap").write_bytes(content[: len(content) // 2])
    repair(bag)
    with BagReader(bag) as reader:
        assert reader.metadata.custom_data == {"scene": "circle"}
        assert reader.metadata.ros_distro == "jazzy"


def test_repairing_twice_keeps_the_first_original(tmp_path):
    bag = write_bag(tmp_path / "run", random_messages(2, 200), chunk_bytes=1000)
    file = bag / "run_0.mcap"
    for _ in range(2):
        content = file.read_bytes()
        file.write_bytes(content[: len(content) // 2])
        repair(bag)
    assert sorted(item.name for item in bag.glob("*.damaged*")) == [
        "run_0.mcap.damaged",
        "run_0.mcap.damaged2",
    ]


def test_bags_of_others_are_repaired_for_others(data, tmp_path):
    """Files of rosbag2, cut; and folders without metadata.yaml: rosbags reads all that is left."""
    root = data / "mcap_compat" / "data"
    for name in ("rosbag2_multiple_files", "rosbag2_talker", "rosbag2_wbag"):
        bag = tmp_path / name
        shutil.copytree(root / name, bag)
        bag.chmod(0o755)
        for file in bag.iterdir():
            file.chmod(0o644)
        (bag / "metadata.yaml").unlink(missing_ok=True)
        before = read_all(bag)
        repair(bag)
        assert [item.data for item in before] == rosbags_messages(bag)
        last = sorted(bag.glob("*.mcap"))[-1]
        content = last.read_bytes()
        last.write_bytes(content[: int(len(content) * 0.9)])
        repair(bag)
        assert 0.5 * len(before) < len(rosbags_messages(bag)) == len(read_all(bag)) <= len(before)


def test_a_single_file_is_repaired_without_metadata(tmp_path, data):
    file = tmp_path / "cub.mcap"
    content = (data / "mcap_compat" / "data" / "cub_stabilize_2025_11_13.mcap").read_bytes()
    file.write_bytes(content[: len(content) // 2])
    (part,) = repair(file)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["cub.mcap", "cub.mcap.damaged"]
    # Chunks of 0.8 MB: half of the file has one of the three large ones whole.
    assert 0.3 * 21258 < part.message_count < 0.4 * 21258
    assert len(rosbags_messages(file)) == part.message_count
    with file.open("rb") as stream:
        assert (
            make_reader(stream, validate_crcs=True).get_summary().statistics.message_count
            == part.message_count
        )


def test_profile_and_attachments_of_a_file_are_kept(tmp_path):
    file = tmp_path / "other.mcap"
    with file.open("wb") as stream:
        made = McapFile(stream, "lz4", profile="px4")
        channel = made.add_topic(TOPICS[0])
        made.write(channel, b"\0\1\0\0", 7, 6, 5)
        made.add_attachment(Attachment(8, 7, "camera.yaml", "text/yaml", b"k: 1"))
        made.add_metadata("setup", {"robot": "six_link"})
        made.finish()
    file.write_bytes(file.read_bytes()[:-20])
    repair(file)
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "px4"
        assert [
            (item.log_time, item.create_time, item.name, item.data) for item in reader.iter_attachments()
        ] == [(7, 8, "camera.yaml", b"k: 1")]
        assert [(item.name, item.metadata) for item in reader.iter_metadata()] == [
            ("setup", {"robot": "six_link"})
        ]
        ((_, _, message),) = reader.iter_messages()
        assert (message.log_time, message.publish_time, message.sequence) == (7, 6, 5)


# A process that dies ------------------------------------------------------------------------------
WRITER = """
import sys
from soro_lab.bag import BagWriter, Topic
writer = BagWriter(sys.argv[1], custom_data={"scene": "crash"})
writer.add_topic(Topic("/a", "std_msgs/msg/String", "string data", "ros2msg", "RIHS01_00"))
number = 0
while True:
    for _ in range(50):
        number += 1
        writer.write("/a", b"\\0\\1\\0\\0" + number.to_bytes(4, "little"), number)
    writer.flush()
    print(number, flush=True)
"""


@pytest.mark.process
def test_a_killed_recorder_leaves_all_that_it_flushed(tmp_path):
    bag = tmp_path / "run"
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(bag)], stdout=subprocess.PIPE, text=True)
    try:
        flushed = [int(process.stdout.readline()) for _ in range(20)][-1]
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait(10)
        rest = process.stdout.read().split()
        process.stdout.close()
    flushed = int(rest[-1]) if rest else flushed
    with BagReader(bag) as reader:
        numbers = [int.from_bytes(item.data[4:], "little") for item in reader.messages()]
        assert any("metadata.yaml is missing" in problem for problem in reader.problems)
        assert len(reader.problems) >= 2
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(numbers) >= flushed
    repair(bag)
    assert len(rosbags_messages(bag)) == len(numbers)
    with BagReader(bag) as reader:
        assert reader.problems == ()
        assert reader.metadata.custom_data == {"scene": "crash"}
        assert reader.topics[0].type_hash == "RIHS01_00"


def test_samples_are_what_the_tests_assume():
    messages = random_messages(1, 200)
    assert {item.topic for item in messages} == {item.name for item in TOPICS[:3]}
    assert len({item.log_time_ns for item in messages}) < len(messages)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
@pytest.mark.parametrize("change", [-6, 6], ids=["bytes missing", "bytes too many"])
def test_bytes_that_are_missing_or_too_many_cost_their_chunk(tmp_path, compression, change):
    """The chunk that describes the topics is lost, and no offset of the index is right any more."""
    file = tmp_path / "run_0.mcap"
    with file.open("wb") as stream:
        mcap = McapFile(stream, compression, chunk_bytes=4000)
        channel = mcap.add_topic(TOPICS[0])
        for k in range(2000):
            mcap.write(channel, k.to_bytes(12, "little"), k, k, k)
        mcap.finish()
    content = file.read_bytes()
    chunks = [place for place in record_places(content) if place[0] == Opcode.CHUNK]
    at = chunks[0][1] + 200
    file.write_bytes(content[:at] + (bytes(change) + content[at:] if change > 0 else content[at - change :]))
    with BagReader(file) as reader:
        found = [int.from_bytes(message.data, "little") for message in reader.messages()]
    assert found == list(range(found[0], 2000))
    assert found[0] < 2 * 2000 / len(chunks)
