"""Child processes of a run: how one starts, how one ends, and why it has ended."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from soro_core.errors import SoroError
from soro_ros.host import pulse
from soro_ros.run.fork_server import prepare

# A line of a ROS log: level, time, logger, text.
_LOGGED = re.compile(r"\[(\w+)\] \[[\d.]+\] \[[^]]*\]: (.*)")

# Period in which the end of a process is looked for [s].
_POLL_S = 0.005
# Period of SIGINT while a process ends [s]: a process that still imports ignores it.
REPEAT_S = 0.3


class NodeError(SoroError):
    """A node or a process failed; `name` is its name."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


class ForkedProcess:
    """A child that this process has not started itself; the methods are those of `subprocess.Popen`.

    Parameters
    ----------
    pid : int
        Its process id.
    """

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit status, negative after a signal; None while it runs."""
        if self.returncode is None:
            found, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if found else None
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end; raises subprocess.TimeoutExpired after `timeout` [s]."""
        begin = time.monotonic()
        while (status := self.poll()) is None:
            if timeout is not None and time.monotonic() - begin > timeout:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
            time.sleep(_POLL_S)
        return status

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Send SIGTERM."""
        self.send_signal(signal.SIGTERM)


@dataclass(frozen=True)
class Child:
    """A running process and its log."""

    name: str
    process: subprocess.Popen[bytes] | ForkedProcess
    log: Path

    def end_report(self, forced: bool = False) -> str:
        """Exit status of a process that has ended, and why; `forced` for one that `stop` had to kill."""
        if forced:
            return f"{self.name} did not end when it was asked to, and was killed"
        status = self.process.poll()
        killed = status == -signal.SIGKILL  # its log does not show the reason
        reason = "killed (SIGKILL: by hand, or out of memory)" if killed else self.last_lines()
        return f"{self.name} ended with status {status}: {reason}"

    def last_lines(self) -> str:
        """The end of the log, in one line; only the errors, if a node has logged some."""
        text = self.log.read_text(errors="replace").strip().splitlines()[-5:]
        logged = [found for line in text if (found := _LOGGED.match(line))]
        errors = [line[2].strip() for line in logged if line[1] in ("ERROR", "FATAL")]
        return " | ".join(errors or (line.strip() for line in text)) or "nothing in its log"


def log_of(name: str, folder: Path) -> Path:
    """Return the file for the output of a process of a run; its folder exists then."""
    log = folder / "log" / f"{name}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    return log


def start(
    name: str,
    command: list[str],
    folder: Path,
    priority: int = 0,
    pipe: int | None = None,
    passed: Sequence[int] = (),
) -> Child:
    """Start a process whose output goes to ``folder/log/NAME.log``.

    The process has its own session, so that Ctrl-C reaches the supervisor only, and gets SIGTERM when the
    supervisor dies, so that it does not outlive it. It ignores SIGINT until it has a handler: during imports
    SIGINT would cause a traceback.

    Parameters
    ----------
    name : str
    command : list of str
        Command line.
    folder : Path
        Folder of the run.
    priority : int
        Above 0: priority of the scheduler SCHED_FIFO.
    pipe : int, optional
        Pipe of `pulse.Pulse`, for a process that listens to this one.
    passed : sequence of int
        Other descriptors that it keeps.
    """
    log, parent = log_of(name, folder), os.getpid()
    heard = {} if pipe is None else {pulse.VARIABLE: str(pipe)}
    with log.open("wb") as sink:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=sink,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            pass_fds=(*passed, *([] if pipe is None else [pipe])),
            preexec_fn=lambda: prepare(parent, priority),
            # On busy cores a second thread of BLAS makes small matrices slower, up to 10 ms a call.
            env={"OPENBLAS_NUM_THREADS": "1", **os.environ, "PYTHONUNBUFFERED": "1", **heard},
        )
    return Child(name, process, log)


def node_command(name: str, config: BaseModel, namespace: str, folder: Path) -> list[str]:
    """Return the command line of a node, and write its parameters to ``folder/parameters/NAME.yaml``.

    Parameters
    ----------
    name : str
        Name of the node, behind that of its arm where there are several: ``left/controller``.
    config : pydantic.BaseModel
        Its parameters.
    namespace : str
        Namespace of the run.
    folder : Path
        Folder of the run.
    """
    inner, _, kind = f"{namespace}/{name}".rpartition("/")
    file = _parameter_file(name, "/**", config, folder)
    module = [sys.executable, "-m", f"soro_ros.nodes.{kind}"]
    return [*module, "--ros-args", "--params-file", str(file), "-r", f"__ns:=/{inner}"]


def arms_command(configs: Mapping[str, BaseModel], namespace: str, folder: Path) -> list[str]:
    """Return the command line of the nodes of one kind of several arms, as one process; see `node_command`.

    Parameters
    ----------
    configs : mapping of str to pydantic.BaseModel
        Parameters by the names of the nodes.
    namespace : str
    folder : Path
    """
    full = {name: f"/{namespace}/{name}" for name in configs}
    files = [_parameter_file(name, full[name], config, folder) for name, config in configs.items()]
    options = [text for file in files for text in ("--params-file", str(file))]
    namespaces = [name.rpartition("/")[0] for name in full.values()]
    kind = next(iter(configs)).rpartition("/")[2]
    return [sys.executable, "-m", f"soro_ros.nodes.{kind}", *namespaces, "--ros-args", *options]


def _parameter_file(name: str, entry: str, config: BaseModel, folder: Path) -> Path:
    """Write the parameters of a node for an entry of its file."""
    file = folder / "parameters" / f"{name}.yaml"
    file.parent.mkdir(parents=True, exist_ok=True)
    # Nested as in a scene. ROS has no null: a key that is None is left out, and None is its default.
    section = _without_empty_mappings(config.model_dump(mode="json", exclude_none=True))
    file.write_text(yaml.safe_dump({entry: {"ros__parameters": section}}, sort_keys=False))
    return file


def _without_empty_mappings(section: dict[str, Any]) -> dict[str, Any]:
    """Leave out what is ``{}``: rcl reads the keys behind it as its own."""
    kept = {}
    for name, value in section.items():
        inner = _without_empty_mappings(value) if isinstance(value, dict) else value
        if inner != {}:
            kept[name] = inner
    return kept


def stop(child: Child, limit_s: float) -> tuple[int, bool]:
    """End a process: SIGINT again and again for `limit_s` [s], then SIGTERM, then SIGKILL.

    Returns
    -------
    status : int
    forced : bool
        Whether it took more than SIGINT.
    """
    process, begin = child.process, time.monotonic()
    while process.poll() is None and time.monotonic() - begin < limit_s:
        process.send_signal(signal.SIGINT)
        _wait_for_end(process, REPEAT_S)
    forced = process.poll() is None
    for number in (signal.SIGTERM, signal.SIGKILL):
        if process.poll() is None:
            process.send_signal(number)
            _wait_for_end(process, 2.0)
    return process.wait(), forced


def _wait_for_end(process: subprocess.Popen[bytes] | ForkedProcess, limit_s: float) -> None:
    """Wait for the end of a process, at most `limit_s` [s]."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(limit_s)
