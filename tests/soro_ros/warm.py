"""`soro` and its nodes as forks of one process that has their imports and kernels, instead of a Python each.

What is forked is a process as any other one, with its own environment, folder, pipes and signals, and a
child of this process; `soro run` gets a fork server of its own, as it has otherwise.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

from soro_ros.run import fork_server, forks
from soro_ros.run.fork_server import Request

_STDERR = "TESTS_STDERR"
# What a forked Python has taken from its environment before.
_FIXED = ("PYTHON", "XDG_CACHE_HOME", "NUMBA", "OPENBLAS")
_server: list[tuple[socket.socket, subprocess.Popen[bytes]]] = []


class Popen(subprocess.Popen):  # type: ignore[type-arg]
    """A `subprocess.Popen` that forks ``python -m MODULE ...``, unless this needs a Python of its own."""

    def _execute_child(self, args: Any, *rest: Any) -> None:
        executable, prepare, _, descriptors, folder, environment, _, _, shell = rest[:9]
        command = [str(part) for part in args]
        own = dict(os.environ if environment is None else environment)
        fixed = {name for name in {*own, *os.environ} if name.startswith(_FIXED)}
        is_own = any(own.get(name) != os.environ.get(name) for name in fixed)
        asks = executable or prepare or descriptors or shell or rest[9] != -1 or rest[20]
        if asks or is_own or command[:2] != [sys.executable, "-m"]:
            super()._execute_child(args, *rest)  # type: ignore[misc]
            return
        what = {"environment": own, "folder": str(folder or Path.cwd())}
        request = Request("tests.soro_ros.warm", [json.dumps(what), *command[2:]], pipe=_STDERR)
        self.pid = _fork(request, [rest[12] if rest[12] != -1 else 1, rest[14] if rest[14] != -1 else 2])
        self._child_created = True
        self._close_pipe_fds(*rest[9:15])  # type: ignore[attr-defined]


def _fork(request: Request, descriptors: list[int]) -> int:
    fork_server.adopt(True)
    if not _server:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "tests.soro_ros.warm", str(theirs.fileno()), "-" * fork_server.TITLE]
        with theirs:
            environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ, "PYTHONUNBUFFERED": "1"}
            process = subprocess.Popen(command, pass_fds=[theirs.fileno()], env=environment)
        _server.append((ours, process))
        atexit.register(_close)
        assert ours.recv(100) == b"ready"
    asked, _ = _server[0]
    socket.send_fds(asked, [json.dumps(request._asdict()).encode()], descriptors)
    return int(asked.recv(100))


def _close() -> None:
    asked, process = _server.pop()
    asked.close()
    process.wait()


def main() -> None:
    """The server of the tests, and in its forks the program that was asked for."""
    parent = os.getppid()
    fork_server.prepare(parent)
    asked = socket.socket(fileno=int(sys.argv[1]))
    fork_server.warm("track_circle")
    for module in (*fork_server.MODULES, "soro_ros.cli", "soro_ros.commands.run", "soro_ros.run.compose"):
        __import__(module)
    asked.send(b"ready")
    request = fork_server.serve(asked, parent)
    if request is None:
        return
    what, module, *arguments = request.arguments
    os.dup2(int(os.environ[_STDERR]), sys.stderr.fileno())
    os.close(int(os.environ[_STDERR]))
    settings = json.loads(what)
    os.environ.clear()
    os.environ.update(settings["environment"])
    os.chdir(settings["folder"])
    if module == "soro_ros.cli":
        _fork_server_beside()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = [module, *arguments]
    fork_server.name_process([sys.executable, "-m", *sys.argv])
    fork_server.run(Request(module, arguments))


def _fork_server_beside() -> None:
    """Fork the fork server of a run, while this process has neither threads nor ROS."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    parent = os.getpid()
    if os.fork() > 0:
        theirs.close()
        os.environ[forks.VARIABLE] = str(ours.fileno())
        ours.detach()
        return
    ours.close()
    fork_server.prepare(parent)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    theirs.send(b"ready")
    if request := fork_server.serve(theirs, parent):
        fork_server.run(request)
    os._exit(0)


if __name__ == "__main__":
    main()
