"""Child processes of a run: started in order, watched, ended in order, never left behind."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from soro_core.errors import SoroError
from soro_ros.parameters import overrides

_PR_SET_PDEATHSIG = 1
_PRCTL = ctypes.CDLL(None).prctl


# A line of a ROS log: level, time, logger, text.
_LOGGED = re.compile(r"\[(\w+)\] \[[\d.]+\] \[[^]]*\]: (.*)")

# So often a process is asked to end: one that still imports does not hear it.
REPEAT_S = 0.3


class NodeError(SoroError):
    """What went wrong, and in which node or process."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


@dataclass(frozen=True)
class Child:
    """A running process and its log."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path

    def obituary(self, forced: bool = False) -> str:
        """Status and last words of a process that has ended; `forced` for one that `stop` had to kill."""
        if forced:
            return f"{self.name} did not end when it was asked to, and was killed"
        status = self.process.poll()
        killed = status == -signal.SIGKILL  # its last words were of something else
        said = "killed (SIGKILL: by hand, or out of memory)" if killed else self.last_words()
        return f"{self.name} ended with status {status}: {said}"

    def last_words(self, lines: int = 5) -> str:
        """The end of its log, in one line; where a node has logged errors, these alone."""
        text = self.log.read_text(errors="replace").strip().splitlines()[-lines:]
        logged = [found for line in text if (found := _LOGGED.match(line))]
        errors = [line[2].strip() for line in logged if line[1] in ("ERROR", "FATAL")]
        return " | ".join(errors or (line.strip() for line in text)) or "it said nothing"


def start(name: str, command: list[str], folder: Path, priority: int = 0) -> Child:
    """Start a process whose output goes to ``folder/log/NAME.log``.

    It has a session of its own, so that Ctrl-C reaches the supervisor alone, and gets SIGTERM when the
    supervisor dies, so that nothing outlives it. SIGINT it hears only once it has a handler for it: within an
    import it would be a traceback. A `priority` above 0 asks for SCHED_FIFO.
    """
    log = folder / "log" / f"{name}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    parent = os.getpid()
    with log.open("wb") as sink:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=sink,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=lambda: _prepare(parent, priority),
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
    return Child(name, process, log)


def node_command(name: str, config: BaseModel, namespace: str, folder: Path, *extra: str) -> list[str]:
    """Command line of a node, its parameters in ``folder/parameters/NAME.yaml``."""
    file = folder / "parameters" / f"{name}.yaml"
    file.parent.mkdir(parents=True, exist_ok=True)
    values: dict[str, Any] = {
        # ROS parameters know no empty list; the model's default stands for it.
        key: value
        for key, value in overrides(config).items()
        if value != []
    }
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}, sort_keys=False))
    module = [sys.executable, "-m", f"soro_ros.nodes.{name}"]
    return [*module, "--ros-args", "--params-file", str(file), "-r", f"__ns:=/{namespace}", *extra]


def stop(child: Child, patience_s: float) -> tuple[int, bool]:
    """End a process: SIGINT until it listens, then SIGTERM, then SIGKILL.

    Returns
    -------
    status : int
    forced : bool
        Whether it took more than SIGINT.
    """
    process, begin = child.process, time.monotonic()
    while process.poll() is None and time.monotonic() - begin < patience_s:
        process.send_signal(signal.SIGINT)
        _ended(process, REPEAT_S)
    forced = process.poll() is None
    for number in (signal.SIGTERM, signal.SIGKILL):
        if process.poll() is None:
            process.send_signal(number)
            _ended(process, 2.0)
    return process.wait(), forced


def _ended(process: subprocess.Popen[bytes], limit_s: float) -> None:
    """Wait for the end of a process for a while."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(limit_s)


def check(children: list[Child]) -> None:
    """Raise NodeError if a process has ended."""
    for child in children:
        if child.process.poll() is not None:
            raise NodeError(child.name, child.obituary())


def _prepare(parent: int, priority: int) -> None:
    """Between fork and exec: only what needs no lock that another thread may have held at the fork."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _PRCTL(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before the request
        os._exit(1)
    if priority > 0:
        with contextlib.suppress(OSError):  # without the right to it; the nodes say so
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
