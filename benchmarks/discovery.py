"""How long a new process takes to find one that runs, with soro's times of Fast DDS and with its own."""

from __future__ import annotations

import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.options import Options
from benchmarks.report import table

TITLE = "Discovery"
DOMAIN = "57"
# Beyond an announcement of soro's, one every 0.5 s, and the first exchange.
LATE_S = 1.0

_NODE = """
import sys, time
from rclpy.node import Node
from std_msgs.msg import String
from soro_ros.host import middleware
import rclpy
middleware.init()
"""
_READER = """
node = Node("reader", start_parameter_services=False)
node.create_subscription(String, "words", lambda message: None, 10)
print("ready", flush=True)
rclpy.spin(node)
"""
_NEW = """
begin = time.monotonic()
node = Node("new", start_parameter_services=False)
publisher = node.create_publisher(String, "words", 10)
while not publisher.get_subscription_count():
    time.sleep(0.002)
print(time.monotonic() - begin)
"""
_EMPTY = """\
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="plain" is_default_profile="true"><rtps><name>plain</name></rtps></participant>
</profiles>
"""


def run(options: Options) -> str:
    """Start processes, one after another, and write how long each took."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        empty = Path(folder) / "empty.xml"
        empty.write_text(_EMPTY)
        for name, profiles in (("soro", None), ("Fast DDS by default", empty)):
            with _reader(profiles) as environment:
                times = [_found_after(environment, options) for _ in range(options.pick(40, 1))]
            late = sum(one > LATE_S for one in times)
            cells = [statistics.median(times), max(times)]
            rows.append([name, len(times), *(f"{one:.2f}" for one in cells), late])
    head = ["times of the middleware", "new processes", "median, s", "slowest, s", f"above {LATE_S:g} s"]
    return f"{_INTRO}\n\n{table(head, rows)}"


_INTRO = """\
From the creation of a node in a new process until it has found the subscription of one that runs
(ADR 0014)."""


@contextlib.contextmanager
def _reader(profiles: Path | None) -> Iterator[dict[str, str]]:
    environment = {**os.environ, "ROS_DOMAIN_ID": DOMAIN}
    environment.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
    if profiles is not None:
        environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(profiles)
    command = [sys.executable, "-c", _NODE + _READER]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        process.stdout.readline()
        yield environment
    finally:
        process.kill()
        process.communicate()


def _found_after(environment: dict[str, str], options: Options) -> float:
    options.say("a new process")
    command = [sys.executable, "-c", _NODE + _NEW]
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, timeout=60, check=True)
    return float(done.stdout)
