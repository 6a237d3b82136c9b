"""What goes into a bag comes out of it, through our reader and through those of others."""

from pathlib import Path

import numpy as np
import pytest
from bag_samples import STORE, TOPICS, cdr, joint_state, random_messages, read_all, write_bag
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from soro_core.errors import BagError
from soro_lab.bag import BackgroundWriter, BagReader, BagWriter
from soro_lab.bag.mcap import part
from soro_lab.bag.mcap.chunks import unpack
from tests.refused import fails


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
@pytest.mark.parametrize("chunk_bytes", [500, 1 << 20])
def test_bytes_times_and_order_survive(tmp_path, compression, chunk_bytes):
    messages = random_messages(seed=chunk_bytes, count=500)
    bag = write_bag(tmp_path / "run", messages, compression=compression, chunk_bytes=chunk_bytes)
    assert read_all(bag) == messages
    assert read_all(bag, index=False) == messages
    with BagReader(bag) as reader:
        assert reader.problems == ()
        assert reader.topics == tuple(sorted(TOPICS, key=lambda item: item.name))
        assert (reader.start_ns, reader.end_ns) == (messages[0].log_time_ns, messages[-1].log_time_ns)


def test_files_carry_the_name_of_the_folder(tmp_path):
    bag = write_bag(tmp_path / "runs" / "circle", random_messages(1, 3))
    assert sorted(file.name for file in bag.iterdir()) == ["circle_0.mcap", "metadata.yaml"]


def test_messages_come_in_the_order_of_time_across_chunks(tmp_path):
    messages = random_messages(seed=5, count=300)
    mixed = [messages[index] for index in np.random.default_rng(5).permutation(len(messages))]
    bag = write_bag(tmp_path / "run", mixed, chunk_bytes=2000)
    read = read_all(bag)
    assert [item.log_time_ns for item in read] == [item.log_time_ns for item in messages]
    # Equal times: as they were written.
    assert read == sorted(mixed, key=lambda item: item.log_time_ns)


@pytest.mark.parametrize("index", [True, False])
def test_a_chunk_from_before_the_clock_has_begun_is_read(tmp_path, index):
    """A recorder in lockstep writes what comes before the first tick with the time 0."""
    bag = tmp_path / "run"
    with BagWriter(bag) as writer:
        writer.add_topic(TOPICS[2])
        writer.write("/notes", b"latched", 0)
        writer.flush()  # a chunk of its own
        writer.write("/notes", b"later", 5_000_000)
    with BagReader(bag, index=index) as reader:
        assert (reader.start_ns, reader.end_ns) == (0, 5_000_000)
        assert [item.data for item in reader.messages()] == [b"latched", b"later"]


def test_reading_a_part(tmp_path):
    messages = random_messages(seed=6, count=300)
    bag = write_bag(tmp_path / "run", messages, chunk_bytes=2000)
    notes = [item.log_time_ns for item in messages if item.topic == "/notes"]
    low, high = notes[20], notes[40]
    with BagReader(bag) as reader:
        read = list(reader.messages(topics=["/notes"], start_ns=low, end_ns=high))
    assert read == [item for item in messages if item.topic == "/notes" and low <= item.log_time_ns <= high]
    assert read


def test_rosbags_reads_types_hashes_quality_and_contents(tmp_path):
    names = ["link0/chamber0", "link0/chamber1", "link0/chamber2"]
    pressures = np.random.default_rng(1).uniform(0, 9e4, (50, 3))
    with BagWriter(tmp_path / "run", custom_data={"seed": "1"}) as writer:
        for item in TOPICS:
            writer.add_topic(item)
        for index, row in enumerate(pressures):
            stamp = index * 4_000_000
            writer.write("/chambers/state", cdr(joint_state(stamp, names, row), TOPICS[0].type), stamp)
    for path in (tmp_path / "run", tmp_path / "run" / "run_0.mcap"):
        with Reader(path) as reader:
            assert reader.message_count == len(pressures)
            by_name = {connection.topic: connection for connection in reader.connections}
            assert set(by_name) == {item.name for item in TOPICS}
            for item in TOPICS:
                connection = by_name[item.name]
                assert connection.msgtype == item.type
                assert connection.msgdef.data == item.definition
                offers = connection.ext.offered_qos_profiles
                assert [offer.reliability.name.lower() for offer in offers] == [
                    q.reliability for q in item.qos
                ]
                assert [offer.durability.name.lower() for offer in offers] == [q.durability for q in item.qos]
                if path.is_dir():
                    assert connection.digest == item.type_hash
            read = [
                STORE.deserialize_cdr(data, connection.msgtype) for connection, _, data in reader.messages()
            ]
            times = [time for _, time, _ in reader.messages()]
        assert times == [index * 4_000_000 for index in range(len(pressures))]
        np.testing.assert_array_equal([message.effort for message in read], pressures)
        assert all(message.name == names for message in read)


def test_the_mcap_library_verifies_every_checksum(tmp_path):
    messages = random_messages(seed=2, count=200)
    bag = write_bag(tmp_path / "run", messages, chunk_bytes=3000)
    with (bag / "run_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        assert [message.data for _, _, message in reader.iter_messages()] == [item.data for item in messages]
        channels = reader.get_summary().channels.values()
        assert {channel.metadata["topic_type_hash"] for channel in channels} == {
            item.type_hash for item in TOPICS
        }
        assert [record.name for record in reader.iter_metadata()] == ["rosbag2", "rosbag2"]


def test_an_empty_bag_is_a_bag(tmp_path):
    bag = write_bag(tmp_path / "run", [])
    with BagReader(bag) as reader:
        assert (reader.message_count, len(reader.topics), reader.problems) == (0, len(TOPICS), ())
        assert list(reader.messages()) == []
    with Reader(bag) as reader:
        assert reader.message_count == 0


def test_a_bag_is_never_overwritten(tmp_path):
    bag = write_bag(tmp_path / "run", random_messages(1, 3))
    with fails(BagError, file=str(bag), code="exists"):
        BagWriter(bag)
    assert len(read_all(bag)) == 3


def test_closing_twice_is_harmless_and_writing_afterwards_is_not(tmp_path):
    writer = BagWriter(tmp_path / "run")
    writer.add_topic(TOPICS[0])
    writer.close()
    before = (tmp_path / "run" / "run_0.mcap").read_bytes()
    writer.close()
    assert (tmp_path / "run" / "run_0.mcap").read_bytes() == before
    with fails(BagError, file=str(tmp_path / "run"), code="closed"):
        writer.write(TOPICS[0].name, b"", 1)


@pytest.mark.parametrize(
    ("topic", "time", "code"),
    [("/unknown", 1, "missing"), ("/notes", -1, "value"), ("/notes", 2**63, "value")],
)
def test_wrong_messages_are_refused(tmp_path, topic, time, code):
    with BagWriter(tmp_path / "run") as writer:
        writer.add_topic(TOPICS[2])
        with fails(BagError, topic, code=code):
            writer.write(topic, b"\0\1\0\0", time)
        with fails(BagError, "/notes", code="exists"):
            writer.add_topic(TOPICS[2])
    assert read_all(tmp_path / "run") == []


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with fails(BagError, file=str(tmp_path / "file" / "run"), code="disk"):
        BagWriter(tmp_path / "file" / "run")


# From a thread ------------------------------------------------------------------------------------
def test_background_writing_keeps_the_order(tmp_path):
    messages = random_messages(seed=8, count=2000)
    background = BackgroundWriter(BagWriter(tmp_path / "run"), flush_s=0.05)
    for item in TOPICS:
        background.add_topic(item)
    for message in messages:
        background.write(message.topic, message.data, message.log_time_ns)
    background.close()
    background.close()
    read = read_all(tmp_path / "run")
    assert [(item.topic, item.data) for item in read] == [(item.topic, item.data) for item in messages]
    assert (background.dropped, background.waiting_bytes, background.message_count) == (0, 0, 2000)


def test_background_writing_drops_what_the_disk_cannot_take(tmp_path):
    background = BackgroundWriter(BagWriter(tmp_path / "run"), buffer_bytes=1000)
    background.add_topic(TOPICS[0])
    background.write(TOPICS[0].name, bytes(2000), 1)
    background.close()
    assert background.dropped == 1
    assert read_all(tmp_path / "run") == []


class FullDisk(BagWriter):
    """A writer whose disk is full from the third message on."""

    def write(self, *message):
        if self.message_count == 2:
            raise BagError("no space left", code="disk")
        super().write(*message)


def test_background_writing_reports_a_full_disk_and_saves_the_rest(tmp_path):
    background = BackgroundWriter(FullDisk(tmp_path / "run"))
    background.add_topic(TOPICS[0])
    for index in range(5):
        background.write(TOPICS[0].name, bytes(8), index)
    with fails(BagError, code="disk"):
        background.close()
    assert len(read_all(tmp_path / "run")) == 2
    assert background.dropped == 3
    background.write(TOPICS[0].name, bytes(8), 9)
    assert background.dropped == 4


def test_stored_paths_do_not_depend_on_where_the_bag_lies(tmp_path):
    bag = write_bag(tmp_path / "run", random_messages(1, 3))
    assert str(tmp_path) not in (bag / "metadata.yaml").read_text()
    assert len(read_all(bag.rename(tmp_path / "elsewhere"))) == 3
    assert isinstance(bag, Path)


def test_the_first_message_and_one_in_the_middle_need_one_chunk_each(tmp_path, monkeypatch):
    """However long the bag is: by its index only the chunks of that time are unpacked."""
    messages = random_messages(8, 2000)
    bag = write_bag(tmp_path / "run", messages, chunk_bytes=5000)
    unpacked = []
    monkeypatch.setattr(part, "unpack", lambda chunk: unpacked.append(chunk) or unpack(chunk))
    with BagReader(bag) as reader:
        assert len(reader.parts[0].blocks) > 50
        assert next(reader.messages()) == messages[0]
        assert 1 <= len(unpacked) <= 2
        middle = messages[1000]
        found = next(reader.messages(start_ns=middle.log_time_ns))
        assert found.log_time_ns == middle.log_time_ns
        assert len(unpacked) <= 4
