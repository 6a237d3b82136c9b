"""What the live view costs: its share of a core, and the lateness of a loop in real time beside it.

Two loops, each in turns without a viewer, with a viewer and no open page, with a viewer and one open page:
`soro run` as a user starts it, on emulated valves, and `soro_arm`, one process without valves. The page is a
web socket that takes in all that a browser takes in but draws nothing: the cost of drawing depends on the
browser and its graphics card.
"""

from __future__ import annotations

import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.composed import FIRST_S
from benchmarks.composed_arm import parameter_file
from benchmarks.options import Options
from benchmarks.report import figure, met, table
from benchmarks.timing import all_cores

TITLE = "Live view"
DOMAIN = "59"
SHARE, LATER = 0.15, 1.10
_SCENE, _PERIOD_S = "track_circle", 0.25
_COMPOSED_HZ = 100.0
_MOST_TRIPS = 10
# What differs: name, whether the viewer runs, whether its page is open.
_TURNS = (
    ("without a viewer", False, False),
    ("viewer, no page", True, False),
    ("viewer, one page", True, True),
)
_CAMERA = {"type": "ViewerCameraMessage", "fov": 1.0, "near": 0.01, "far": 10.0}
_CAMERA |= {"image_height": 800, "image_width": 1200, "wxyz": [1.0, 0.0, 0.0, 0.0]}
_CAMERA |= {"position": [0.3, 0.3, 0.3], "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, 1.0]}


@dataclass(frozen=True)
class Turn:
    """One run: lateness of its loop [ms], lost cycles, the part of a core of the viewer, bytes a second."""

    p50_ms: float
    p99_ms: float
    lost: int
    share: float
    page_bps: float


def run(options: Options) -> str:
    """Run both loops in turns, and report medians."""
    repeats, seconds = options.pick(9, 1), options.pick(15.0, 3.0)
    more = f"{seconds:g} s under control, {repeats} times in turns; medians, in brackets the smallest and "
    more += "the largest:"
    about = (
        (f"`soro run {_SCENE}` in real time on emulated valves", _valves),
        (f"`soro_arm` in one process at {_COMPOSED_HZ:g} Hz, the arm of the section above", _composed),
    )
    with all_cores():
        return "\n\n".join(
            f"{text}, {more}\n\n{_turns(options.say, repeats, seconds, turn)}" for text, turn in about
        )


def _turns(
    say: Callable[[str], None],
    repeats: int,
    seconds: float,
    turn: Callable[[bool, bool, float], Turn | None],
) -> str:
    """Run one loop in turns."""
    found: dict[str, list[Turn]] = {name: [] for name, _, _ in _TURNS}
    tripped = 0
    for k in range(repeats):
        # Each of them is first as often: the machine's noise changes slowly.
        for name, viewer, page in (*_TURNS[k % 3 :], *_TURNS[: k % 3]):
            say(f"{name}, {k + 1} of {repeats}")
            while (one := turn(viewer, page, seconds)) is None:
                tripped += 1
                if tripped > _MOST_TRIPS:
                    return f"Not measured: {tripped} runs were vented, the machine is too busy."
            found[name].append(one)
    head = ["", "lateness p50, ms", "p99, ms", "lost cycles", "viewer, part of a core", "to the page, kB/s"]
    return "\n\n".join(
        [
            table(head, [_row(name, turns) for name, turns in found.items()]),
            _verdict(found),
            f"Runs that the machine vented by its delays, and that were repeated: {tripped}.",
        ]
    )


def _row(name: str, turns: list[Turn]) -> list[object]:
    def of(key: str, factor: float = 1.0) -> str:
        values = [factor * getattr(turn, key) for turn in turns]
        if not any(values):
            return "0" if key == "lost" else "-"
        return f"{figure(statistics.median(values))} ({figure(min(values))} to {figure(max(values))})"

    return [name, of("p50_ms"), of("p99_ms"), of("lost"), of("share"), of("page_bps", 1e-3)]


def _verdict(found: Mapping[str, list[Turn]]) -> str:
    def median(name: str, key: str) -> float:
        return statistics.median(getattr(turn, key) for turn in found[name])

    without, *views = found
    lines = []
    for name in views:
        share = median(name, "share")
        # Each turn against the one without a view of the same round.
        pairs = zip(found[name], found[without], strict=True)
        ratio = statistics.median(turn.p99_ms / before.p99_ms for turn, before in pairs)
        lines.append(
            f"- {name}: {figure(share)} of a core, wanted at most {SHARE:g}: {met(share <= SHARE)}; "
        )
        lines[-1] += (
            f"p99 {figure(ratio)} times that without, wanted at most {LATER:g}: {met(ratio <= LATER)}"
        )
    return "\n".join(lines)


def _valves(viewer: bool, page: bool, seconds: float) -> Turn | None:
    """Run the scene once; None if it was vented before its end."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        command = [sys.executable, "-m", "soro_ros.cli", "run", _SCENE, "--no-figure", "--folder", name]
        command += ["--set", f"duration_s={seconds:g}", *(["--view"] if viewer else [])]
        process = _start(command, folder / "out", stack)
        seen = _watch(
            process, folder / "out", lambda: _viewer(process.pid) if viewer else None, page, seconds
        )
        summary = next(folder.glob(f"{_SCENE}-*/summary.json"), None)
        told = json.loads(summary.read_text()) if summary else {}
        if told.get("verdict") not in ("good", "poor", "lost") or told["lateness_p99_ms"] is None:
            return None
        return Turn(told["lateness_p50_ms"], told["lateness_p99_ms"], told["overruns"], *seen)


def _composed(viewer: bool, page: bool, seconds: float) -> Turn | None:
    """Run the loop in one process once; None if it was vented before its end."""
    with tempfile.TemporaryDirectory(prefix="soro-") as name, ExitStack() as stack:
        folder, python = Path(name), [sys.executable, "-m"]
        parameters = parameter_file(folder, _COMPOSED_HZ)
        names = ["--ros-args", "-r", f"__ns:=/view{os.getpid()}"]
        command = [*python, "benchmarks.composed_process", str(seconds), str(FIRST_S), *names]
        process = _start([*command, "--params-file", str(parameters)], folder / "out", stack)
        pid = None
        if viewer:
            robot = f"robot:={folder / 'two_links.yaml'}"
            command = [*python, "soro_ros.nodes.viewer", *names, "-p", "autostart:=true", "-p", robot]
            beside = _start(command, folder / "view", stack)
            stack.callback(beside.wait)
            stack.callback(beside.terminate)
            pid = beside.pid
        seen = _watch(process, folder / "view", lambda: pid, page, seconds)
        told = json.loads((folder / "out").read_text().splitlines()[-1])
        if told["vented"]:
            return None
        p50_ms, p99_ms, _ = told["begin_ms"]
        return Turn(p50_ms, p99_ms, told["cycles"] - told["in_time"], *seen)


def _start(command: list[str], out: Path, stack: ExitStack) -> subprocess.Popen[bytes]:
    log = stack.enter_context(out.open("w"))
    environment = {**os.environ, "ROS_DOMAIN_ID": DOMAIN, "COLUMNS": "200"}
    return subprocess.Popen(command, stdout=log, stderr=log, env=environment)


def _watch(
    process: subprocess.Popen[bytes], log: Path, viewer: Callable[[], int | None], page: bool, seconds: float
) -> tuple[float, float]:
    """Wait for the end of a loop; return the viewer's share of a core, and what its page got [B/s]."""
    got, samples = [0], list[tuple[float, float]]()
    while process.poll() is None:
        address = re.search(r"http://\S+", log.read_text()) if log.exists() else None
        if address and page and not got[0]:
            got[0] = 1
            threading.Thread(target=_look, args=(address[0], got), daemon=True).start()
        if (pid := viewer()) and (used_s := _cpu_s(pid)) is not None:
            samples.append((time.monotonic(), used_s))
        time.sleep(_PERIOD_S)
    lasted_s = samples[-1][0] - samples[0][0] if samples else 1.0
    return _share(samples, seconds), got[0] / lasted_s


def _share(samples: list[tuple[float, float]], seconds: float) -> float:
    """Part of a core in the last seconds of a run, when all nodes were up."""
    late = [(at, used) for at, used in samples if at > samples[-1][0] - seconds]
    return (late[-1][1] - late[0][1]) / (late[-1][0] - late[0][0]) if late else 0.0


def _look(address: str, got: list[int]) -> None:
    """Take in what a page takes in, until the view ends."""
    import msgspec
    import viser
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    home, _, token = address.partition("?token=")
    port = home.rstrip("/").rpartition(":")[2]
    options: dict[str, Any] = {
        "origin": home.rstrip("/"),
        "subprotocols": [f"viser-v{viser.__version__}"],
        "additional_headers": {"Cookie": f"soro_view_{port}={token}"},
    }
    with connect(f"ws://127.0.0.1:{port}/", max_size=None, proxy=None, **options) as socket:
        socket.send(msgspec.msgpack.encode(_CAMERA))
        try:
            while True:
                got[0] += len(socket.recv())
        except ConnectionClosed:
            return


def _viewer(parent: int) -> int | None:
    """Process of the viewer that a run started."""
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            after = (folder / "stat").read_text().rpartition(")")[2].split()
            if int(after[1]) == parent and b"soro_ros.nodes.viewer" in (folder / "cmdline").read_bytes():
                return int(folder.name)
        except OSError:  # ended meanwhile
            continue
    return None


def _cpu_s(pid: int) -> float | None:
    try:
        after = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return (int(after[11]) + int(after[12])) / os.sysconf("SC_CLK_TCK")
