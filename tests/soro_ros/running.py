"""Running `soro` and single nodes as processes, as a user would."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from soro_lab.bag import BagReader
from soro_ros.conversion import messages
from soro_ros.host import middleware
from tests.patience import LIMIT_S
from tests.warm import Popen

SORO = [sys.executable, "-m", "soro_ros.cli"]
SCENE = "track_circle"


def start_run(
    folder: Path, *changes: str, scene: str = SCENE, popen: type[subprocess.Popen[str]] = Popen
) -> subprocess.Popen[str]:
    """Start `soro run` with changes ``key=value``; without the probe, which takes seconds in real time.

    In lockstep by ``mode=lockstep`` it has half of the ticks of most scenes, unless a change states the rate.
    """
    if not any(change.startswith("controller.probe_at_enable") for change in changes):
        changes = (*changes, "controller.probe_at_enable=off")
    if "mode=lockstep" in changes and not any(change.startswith("rate_hz=") for change in changes):
        changes = (*changes, "rate_hz=100")
    options = [option for change in changes for option in ("--set", change)]
    command = [*SORO, "run", scene, "--no-figure", "--folder", str(folder), *options]
    return popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def run(
    folder: Path,
    *changes: str,
    scene: str = SCENE,
    limit_s: float = 250,
    popen: type[subprocess.Popen[str]] = Popen,
) -> tuple[int, str, Path]:
    """Run a scene to its end; returns exit status, output and the folder of the run."""
    process = start_run(folder, *changes, scene=scene, popen=popen)
    try:
        out, err = process.communicate(timeout=limit_s)
    finally:
        process.kill()
    return process.returncode, out + err, only_run(folder)


def only_run(folder: Path) -> Path:
    """The one folder of a run."""
    (found,) = folder.iterdir()
    return found


def summary(run_folder: Path) -> dict:
    """The figures of a run."""
    return json.loads((run_folder / "summary.json").read_text())


def payloads(bag: Path, without: tuple[str, ...] = ()) -> dict[str, list[bytes]]:
    """Raw messages by topic, in order."""
    found: dict[str, list[bytes]] = {}
    with BagReader(bag) as reader:
        assert not reader.problems
        for message in reader.messages():
            if not message.topic.endswith(without):
                found.setdefault(message.topic, []).append(message.data)
    return found


def wait_until(
    condition: Callable[[], object], what: str, limit_s: float = LIMIT_S, every_s: float = 0.02
) -> None:
    """Poll with a limit, which is one of the tests and none of the product."""
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline, f"{what} not within {limit_s} s"
        time.sleep(every_s)


class ClockListener:
    """Hears /clock in the domain of this process, until it is closed."""

    def __init__(self) -> None:
        middleware.init()
        self._node, self._now_ns = Node("listener"), -1
        # The newest one alone: who does not listen for a while hears nothing old afterwards.
        self._node.create_subscription(Clock, "/clock", self._hear, 1)

    def _hear(self, tick: Clock) -> None:
        self._now_ns = messages.to_ns(tick.clock)

    def wait(self, time_s: float, limit_s: float = LIMIT_S) -> None:
        """Wait until it has come to a time."""

        def reached() -> bool:
            rclpy.spin_once(self._node, timeout_sec=0.1)
            return self._now_ns >= time_s * 1e9

        wait_until(reached, f"/clock at {time_s} s", limit_s, every_s=0.0)

    def wait_for(self, duration_s: float, limit_s: float = LIMIT_S) -> None:
        """Wait until it has gone on for some time from now."""
        self._now_ns = -1
        self.wait(0.0, limit_s)
        self.wait(self._now_ns / 1e9 + duration_s, limit_s)

    def close(self) -> None:
        """Leave the domain."""
        self._node.destroy_node()
        rclpy.shutdown()


def child(parent: int, word: str) -> int | None:
    """Process id of the child of `parent` whose command line holds `word`."""
    for entry in Path("/proc").iterdir():
        try:
            stat = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            if int(stat[1]) == parent and word in (entry / "cmdline").read_bytes().decode():
                return int(entry.name)
        except (OSError, IndexError, ValueError):
            continue
    return None


def end(
    process: subprocess.Popen[str], number: int = signal.SIGINT, limit_s: float = 2 * LIMIT_S
) -> tuple[int, str, str]:
    """Send a signal and wait for the end."""
    if process.poll() is None:
        process.send_signal(number)
    try:
        out, err = process.communicate(timeout=limit_s)
    finally:
        process.kill()
    return process.returncode, out, err


def alive(pid: int) -> bool:
    """Whether a process exists (a zombie does not)."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False
