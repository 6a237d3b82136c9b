"""A bag that is being recorded: in several files, when the process is killed, when the disk is full."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from bag_samples import TOPICS, random_messages, read_all
from rosbags.rosbag2 import Reader

from soro_core.errors import BagError
from soro_lab.bag import BackgroundWriter, BagReader, BagWriter, repair
from tests.refused import fails

# Writes the time into the bag every 2 ms, and says when it has started.
RECORDER = """
import sys, time
from soro_lab.bag import BackgroundWriter, BagWriter, Topic
recorder = BackgroundWriter(BagWriter(sys.argv[1]))
recorder.add_topic(Topic("/time", "std_msgs/msg/UInt64"))
print("started", flush=True)
while True:
    recorder.write("/time", bytes(12), time.time_ns())
    time.sleep(0.002)
"""


@pytest.mark.parametrize("limits", [{"split_bytes": 20_000}, {"split_ns": 10**9}])
def test_a_bag_in_several_files_is_one_recording(tmp_path, limits):
    messages = random_messages(seed=3, count=600)
    with BagWriter(tmp_path / "run", chunk_bytes=2000, **limits) as writer:
        for topic in TOPICS:
            writer.add_topic(topic)
        for item in messages:
            writer.write(item.topic, item.data, item.log_time_ns, item.publish_time_ns, item.sequence)
    files = sorted((tmp_path / "run").glob("run_*.mcap"), key=lambda file: int(file.stem.split("_")[1]))
    assert len(files) > 2
    assert [item.data for item in read_all(tmp_path / "run")] == [item.data for item in messages]
    with BagReader(tmp_path / "run") as reader:
        assert not reader.problems
        assert [part.path for part in reader.parts] == files
        spans = [part.span_ns() for part in reader.parts]
    if "split_ns" in limits:
        assert all(end - start < 10**9 for start, end in spans)
        assert np.all(np.diff([start for start, _ in spans]) >= 10**9)
    else:
        assert all(20_000 <= file.stat().st_size < 40_000 for file in files[:-1])
    with Reader(tmp_path / "run") as theirs:  # of other authors
        assert theirs.message_count == len(messages)


def test_files_of_a_bag_that_was_not_closed_are_found(tmp_path):
    messages = random_messages(seed=4, count=300)
    writer = BagWriter(tmp_path / "run", chunk_bytes=2000, split_bytes=20_000)
    for topic in TOPICS:
        writer.add_topic(topic)
    for item in messages:
        writer.write(item.topic, item.data, item.log_time_ns)
    writer.flush()
    assert [item.data for item in read_all(tmp_path / "run")] == [item.data for item in messages]
    writer.close()


@pytest.mark.process
def test_a_killed_recorder_loses_less_than_a_second(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", RECORDER, str(tmp_path / "run")], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline() == "started\n"
        time.sleep(1.3)
        killed_ns = time.time_ns()
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait(10)
        process.stdout.close()
    repair(tmp_path / "run")
    with BagReader(tmp_path / "run") as reader:
        assert not reader.problems
        assert killed_ns - 1_000_000_000 <= reader.end_ns
        assert reader.message_count > 50


def test_a_full_disk_is_reported_and_what_is_on_it_is_kept(tmp_path):
    """Bytes that cannot be compressed, on a disk that takes 300 kB of them."""
    data = np.random.default_rng(1).bytes(1000)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, hard))
    try:
        background = BackgroundWriter(BagWriter(tmp_path / "run", "none", chunk_bytes=10_000), flush_s=0.05)
        background.add_topic(TOPICS[0])
        for index in range(1000):
            background.write(TOPICS[0].name, data, index)
        with fails(BagError, file=str(tmp_path / "run"), code="disk") as caught:
            background.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "cannot write" in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    kept = read_all(tmp_path / "run")
    assert 200 < len(kept) < 300
    assert background.dropped + background.message_count == 1000
    assert background.message_count - len(kept) <= 20  # two chunks that were not whole
