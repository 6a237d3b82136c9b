"""Child processes of a run: started in order, watched, ended in order, never left behind."""

from __future__ import annotations

import contextlib
import ctypes
import os
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


@dataclass(frozen=True)
class Child:
    """A running process and its log."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path

    def last_words(self, lines: int = 5) -> str:
        """The end of its log, in one line."""
        text = self.log.read_text(errors="replace").strip().splitlines()[-lines:]
        return " | ".join(line.strip() for line in text) or "it said nothing"


def start(name: str, command: list[str], folder: Path, priority: int = 0) -> Child:
    """Start a process whose output goes to ``folder/log/NAME.log``.

    It has a session of its own, so that Ctrl-C reaches the supervisor alone, and gets SIGTERM when the
    supervisor dies, so that nothing outlives it. A `priority` above 0 asks for SCHED_FIFO.
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


def stop(child: Child, patience_s: float) -> int:
    """End a process: SIGINT, then SIGTERM, then SIGKILL; returns its exit status."""
    for number, wait_s in ((signal.SIGINT, patience_s), (signal.SIGTERM, 2.0), (signal.SIGKILL, 2.0)):
        if child.process.poll() is not None:
            break
        child.process.send_signal(number)
        deadline = time.monotonic() + wait_s
        while child.process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.01)
    return child.process.wait()


def check(children: list[Child]) -> None:
    """Raise SoroError if a process has ended."""
    for child in children:
        status = child.process.poll()
        if status is not None:
            raise SoroError(f"{child.name} ended with status {status}: {child.last_words()}")


def _prepare(parent: int, priority: int) -> None:
    """Between fork and exec: only what needs no lock that another thread may have held at the fork."""
    _PRCTL(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before the request
        os._exit(1)
    if priority > 0:
        with contextlib.suppress(OSError):  # without the right to it; the nodes say so
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
