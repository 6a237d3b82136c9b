"""Real recordings of others are read as rosbags reads them."""

import pytest
import zstandard
from bag_samples import random_messages, write_bag
from rosbags.rosbag2 import Reader

from soro_core.errors import BagError
from soro_lab.bag import BagReader, repair
from tests.refused import fails

FOLDER = "mcap_compat/data"
# rosbags refuses this one: it is serialised in a format of its own.
FOREIGN = "wrong_rmw"


def recordings(data):
    root = data / FOLDER
    files = sorted(root.rglob("*.mcap"))
    folders = sorted(folder for folder in root.iterdir() if list(folder.glob("*.mcap")))
    assert len(files) >= 14
    assert len(folders) >= 6
    return files + folders


def test_messages_topics_and_counts_agree_with_rosbags(data):
    compared = 0
    for path in recordings(data):
        with BagReader(path) as reader:
            ours = list(reader.messages())
            assert len(ours) == reader.message_count > 0
            assert reader.problems in ((), ("metadata.yaml is missing",))
            counts = {topic.name: count for topic, count in zip(reader.topics, reader.counts, strict=True)}
            types = {topic.name: topic.type for topic in reader.topics}
        with BagReader(path, index=False) as walked:
            assert list(walked.messages()) == ours
        if FOREIGN in str(path) or (path.is_dir() and not (path / "metadata.yaml").exists()):
            continue
        with Reader(path) as theirs:
            assert {connection.topic: connection.msgcount for connection in theirs.connections} == counts
            assert {connection.topic: connection.msgtype for connection in theirs.connections} == types
            if (
                path.name == "rosbag2_talker"
            ):  # rosbags yields nothing where the two notes of a deadline differ
                continue
            read = [(connection.topic, time, data) for connection, time, data in theirs.messages()]
        assert sorted(read) == sorted((item.topic, item.log_time_ns, item.data) for item in ours)
        compared += 1
    assert compared >= 16


def test_several_files_are_one_bag(data):
    folder = data / FOLDER / "rosbag2_multiple_files"
    with BagReader(folder) as reader:
        assert [part.path.name for part in reader.parts] == [
            f"multiple_files_{index}.mcap" for index in range(3)
        ]
        times = [item.log_time_ns for item in reader.messages()]
        assert (len(reader.topics), reader.message_count) == (1, 1324 + 1324 + 529)
    assert times == sorted(times)
    assert (times[0], times[-1]) == (reader.start_ns, reader.end_ns)


def test_ten_files_come_in_the_order_of_their_numbers(tmp_path):
    messages = random_messages(4, 3)
    (tmp_path / "bag").mkdir()
    for number in (0, 2, 10, 9):
        made = write_bag(tmp_path / f"made{number}", messages)
        (made / f"made{number}_0.mcap").rename(tmp_path / "bag" / f"bag_{number}.mcap")
    with BagReader(tmp_path / "bag") as reader:
        assert [part.path.name for part in reader.parts] == [f"bag_{number}.mcap" for number in (0, 2, 9, 10)]


def test_a_real_mocap_recording(data):
    with BagReader(data / FOLDER / "cub_stabilize_2025_11_13.mcap") as reader:
        assert [(topic.name, count) for topic, count in zip(reader.topics, reader.counts, strict=True)] == [
            ("/cub1/joy_serial_status", 1555),
            ("/cub1/pose", 19703),
        ]
        assert reader.end_ns - reader.start_ns == 198_028_066_113


def test_a_sqlite_bag_is_read_and_not_repaired(data):
    """The storage of rosbag2 before Iron: a folder, or the file alone; here with a folder before its name."""
    folder = data / FOLDER / "plotjuggler_rosbag2_db3"
    with Reader(folder / "rosbag2_test_0.db3") as theirs:
        read = [(connection.topic, time, bytes(data)) for connection, time, data in theirs.messages()]
    for path in (folder, folder / "rosbag2_test_0.db3"):
        with BagReader(path) as reader:
            assert reader.problems == ()
            assert [reader.count(name) for name in ("/battery", "/imu", "/pose")] == 3 * [1565]
            assert reader.topic("/pose").type == "geometry_msgs/msg/PoseStamped"
            ours = [(item.topic, item.log_time_ns, item.data) for item in reader.messages()]
            late = list(reader.messages(["/imu"], start_ns=reader.end_ns - 10**9))
        assert sorted(ours) == sorted(read)
        assert [time for _, time, _ in ours] == sorted(time for _, time, _ in ours)
        assert 20 < len(late) < 30
        with fails(BagError, "sqlite3", "mcap", code="format"):
            repair(path)


@pytest.mark.parametrize("content", [b"", b"no database", b"SQLite format 3\0" + bytes(500)])
def test_a_damaged_sqlite_bag_is_one_line(tmp_path, content):
    file = tmp_path / "bag_0.db3"
    file.write_bytes(content)
    with fails(BagError, "sqlite3", file=str(file), code="format"):
        BagReader(file)


def test_a_file_compressed_as_a_whole(tmp_path):
    """`ros2 bag record --compression-mode file --compression-format zstd`."""
    messages = random_messages(9, 200)
    bag = write_bag(tmp_path / "run", messages, compression="none")
    file = bag / "run_0.mcap"
    (bag / "run_0.mcap.zstd").write_bytes(zstandard.compress(file.read_bytes()))
    file.unlink()
    text = (bag / "metadata.yaml").read_text()
    text = text.replace("run_0.mcap", "run_0.mcap.zstd").replace(
        "compression_mode: ''", "compression_mode: FILE"
    )
    (bag / "metadata.yaml").write_text(text.replace("compression_format: ''", "compression_format: zstd"))
    with BagReader(bag) as reader:
        assert list(reader.messages()) == messages
    with Reader(bag) as theirs:
        assert theirs.message_count == len(messages)
    (bag / "run_0.mcap.zstd").write_bytes(b"nonsense")
    with fails(BagError, "zstd", file=str(bag / "run_0.mcap.zstd"), code="damaged"):
        BagReader(bag)
