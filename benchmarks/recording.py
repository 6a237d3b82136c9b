"""How many messages a second a bag takes, and the recorder from topics."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.options import Options
from benchmarks.report import figure, met, table
from benchmarks.timing import all_cores
from soro_lab.bag import BackgroundWriter, BagReader, BagWriter, Topic

TITLE = "Recording"
DOMAIN = "58"
TARGET_HZ = 20_000
SIZES_B = (124, 1024)  # chambers/state of three chambers; a larger message
RATES_HZ = (1000, 2000, 4000, 6000, 8000, 10_000, 12_000, 16_000, 20_000, 30_000)
_STARTS_S = 60.0

# A publisher with the quality of soro's topics, or with that of sensors: rate, seconds, bytes, reliability.
_LOAD = """
import os, sys, time
import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from std_msgs.msg import UInt8MultiArray
from soro_ros.host import middleware
rate, seconds, size, reliability = float(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
middleware.init()
node = Node("load", start_parameter_services=False)
quality = QoSProfile(depth=100, reliability=ReliabilityPolicy[reliability.upper()])
publisher = node.create_publisher(UInt8MultiArray, "load", quality)
data = serialize_message(UInt8MultiArray(data=os.urandom(size - 20)))
while not publisher.get_subscription_count():
    time.sleep(0.01)
time.sleep(0.5)  # the reader has found the writer too
begin, sent, total = time.monotonic(), 0, round(rate * seconds)
while sent < total:
    due = min(total, int((time.monotonic() - begin) * rate) + 1)
    for _ in range(due - sent):
        publisher.publish(data)
    sent = due
    time.sleep(0.001)
took = time.monotonic() - begin
publisher.wait_for_all_acked(Duration(seconds=5))
time.sleep(0.5)
print(sent, took)
"""


def run(options: Options) -> str:
    """Write and record, and report."""
    with all_cores():  # writer, publisher and recorder are programs of their own
        writers = [_writer_row(size, options) for size in SIZES_B]
        recorders = [
            row for reliability in ("reliable", "best_effort") for row in _recorder_rows(reliability, options)
        ]
    wrote = ["message, B", "asked, 1/s", "written", "lost", f"at {TARGET_HZ} 1/s", "CPU", "most waiting, MB"]
    wrote += ["as fast as it can, 1/s"]
    recorded = ["publisher", "sent, 1/s", "sent", "recorded", "lost", "of them reported"]
    return "\n\n".join(
        [
            f"The bag alone (`BackgroundWriter`, zstd), {options.pick(10, 1)} s of random bytes:",
            table(wrote, writers),
            f"The recorder over rclpy: one publisher in a process of its own, {SIZES_B[0]} B a message, "
            "depth 100, 5 s a rate, up to the first rate at which a message is lost or that the publisher "
            "does not reach:",
            table(recorded, recorders),
        ]
    )


def _writer_row(size: int, options: Options) -> list[object]:
    options.say(f"writer, {size} B")
    asked = round(TARGET_HZ * options.pick(10, 1))
    sent, dropped, written, most, cpu, _ = _write(size, asked, TARGET_HZ)
    fast = _write(size, options.pick(200_000, 2000), None)
    good = dropped == 0 and written == sent
    rate = fast[2] / fast[5]
    return [
        size,
        TARGET_HZ,
        written,
        sent - written,
        met(good),
        f"{100 * cpu:.0f} %",
        figure(most / 1e6),
        figure(rate, 2),
    ]


def _write(size: int, count: int, rate_hz: float | None) -> tuple[int, int, int, int, float, float]:
    """Return messages sent, dropped and in the bag, most bytes waiting, share of a core, and seconds."""
    data, most = [os.urandom(size) for _ in range(4096)], 0
    with tempfile.TemporaryDirectory() as folder:
        writer = BackgroundWriter(BagWriter(Path(folder) / "bag"))
        writer.add_topic(Topic("/load", "std_msgs/msg/UInt8MultiArray"))
        begin, cpu, sent = time.monotonic(), time.process_time(), 0
        while sent < count:
            due = count if rate_hz is None else min(count, int((time.monotonic() - begin) * rate_hz) + 1)
            for number in range(sent, due):
                writer.write("/load", data[number % len(data)], time.time_ns())
            sent = due
            most = max(most, writer.waiting_bytes)
            time.sleep(0.001)
        writer.close()
        took, cpu = time.monotonic() - begin, time.process_time() - cpu
        with BagReader(Path(folder) / "bag") as reader:
            return sent, writer.dropped, reader.message_count, most, cpu / took, took


def _recorder_rows(reliability: str, options: Options) -> list[list[object]]:
    rows: list[list[object]] = []
    for rate in RATES_HZ[: options.pick(len(RATES_HZ), 1)]:
        options.say(f"recorder, {reliability}, {rate} 1/s")
        sent, took, recorded, told = _record(rate, options.pick(5.0, 0.2), reliability)
        rows.append([reliability, figure(sent / took, 3), sent, recorded, sent - recorded, told])
        if recorded != sent or sent / took < 0.95 * rate:
            break
    return rows


def _record(rate_hz: float, seconds: float, reliability: str) -> tuple[int, float, int, int]:
    """Return messages sent, the time that took [s], messages in the bag, and those reported as lost."""
    environment = {**os.environ, "ROS_DOMAIN_ID": DOMAIN}
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        arguments = ["--ros-args", "-p", f"folder:={bag}", "-p", "topics:=['/load']"]
        recorder = subprocess.Popen(
            [sys.executable, "-m", "soro_ros.nodes.recorder", *arguments],
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            limit = time.monotonic() + _STARTS_S
            while not bag.exists():
                assert recorder.poll() is None, "the recorder has ended"
                assert time.monotonic() < limit, "the recorder does not record"
                time.sleep(0.01)
            load = [sys.executable, "-c", _LOAD, str(rate_hz), str(seconds), str(SIZES_B[0]), reliability]
            done = subprocess.run(load, env=environment, stdout=subprocess.PIPE, text=True, check=True)
        finally:
            recorder.terminate()
            _, said = recorder.communicate(timeout=30)
        sent, took = done.stdout.split()
        with BagReader(bag) as reader:
            told = re.search(r"/load: (\d+) lost on the way", said)
            return int(sent), float(took), reader.message_count, int(told[1]) if told else 0
