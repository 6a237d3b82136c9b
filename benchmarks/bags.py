"""How long a bag of a million messages takes to open, to seek in and to read."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.options import Options
from benchmarks.report import figure, met, table
from soro_lab.bag import BagReader, BagWriter, Topic

TITLE = "Reading bags"
TARGET_S = 0.1
_STEP_NS = 10**6


def run(options: Options) -> str:
    """Write a bag, read it, and report."""
    count = options.pick(1_000_000, 2000)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        options.say(f"writing {count} messages")
        with BagWriter(bag) as writer:
            writer.add_topic(Topic("/load", "std_msgs/msg/Float64", "float64 data\n"))
            for k in range(count):
                writer.write("/load", b"\0\1\0\0" + k.to_bytes(8, "little"), k * _STEP_NS)
        with BagReader(bag) as reader:
            middle_ns = reader.end_ns // 2
            rows = [
                ["open by the index (info)", lambda: BagReader(bag).close(), TARGET_S],
                ["first message (start of play)", lambda: next(reader.messages()), TARGET_S],
                ["message in the middle (seek)", lambda: next(reader.messages(None, middle_ns)), TARGET_S],
                ["all messages", lambda: sum(1 for _ in reader.messages()), None],
                ["open without the index", lambda: BagReader(bag, index=False).close(), None],
            ]
            lines = [
                [name, figure(seconds := _seconds(work), 2), met(seconds < target) if target else ""]
                for name, work, target in rows
            ]
    head = f"A bag of {count} messages of 12 bytes (zstd); the fastest of three, s. Target: {TARGET_S} s."
    return f"{head}\n\n{table(['what', 'time, s', 'target'], lines)}"


def _seconds(work: Callable[[], object]) -> float:
    """Return the shortest time of three, the smaller of that of the wall and of the processor [s]."""
    times = []
    for _ in range(3):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        times.append(min(time.perf_counter() - wall, time.process_time() - cpu))
    return min(times)
