"""`soro`, its nodes and emulated valves as forks of a process that has their imports, not a Python each.

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

from soro_core.safety import vent_check
from soro_ros.run import fork_server, forks
from soro_ros.run.fork_server import ForkRequest

_STDERR = "TESTS_STDERR"
# What a forked Python has taken from its environment before.
_FIXED = ("PYTHON", "XDG_CACHE_HOME", "NUMBA", "OPENBLAS")
_environment = dict(os.environ)  # a test may change it
# What the valves of most scenes need.
_FAMILY = ("soro_hardware.emulation.canopen.world", "soro_hardware.canopen.driver")
# What a server imports, by the package of the programs that it forks.
_IMPORTS = {
    "soro_hardware": ("soro_hardware.emulation.__main__", *_FAMILY),
    "soro_ros": (
        *fork_server.MODULES,
        *_FAMILY,
        "soro_ros.cli",
        "soro_ros.commands.run",
        "soro_ros.run.compose",
        "scipy.interpolate",
    ),
}
# Time for which an arm stays empty until its recording ends [s]: two seconds of ticks are a third of the work
# of a short run. What starts a Python of its own waits as long as it does for a user.
_REST_S = 0.2
_servers: dict[str, tuple[socket.socket, subprocess.Popen[bytes]]] = {}


class Popen(subprocess.Popen):  # type: ignore[type-arg]
    """A `subprocess.Popen` that forks ``python -m MODULE ...``, unless this needs a Python of its own."""

    def _execute_child(self, args: Any, *rest: Any) -> None:
        executable, prepare, _, descriptors, folder, environment, _, _, shell = rest[:9]
        command = [str(part) for part in args]
        own = dict(os.environ if environment is None else environment)
        fixed = {name for name in {*own, *_environment} if name.startswith(_FIXED)}
        is_own = any(own.get(name) != _environment.get(name) for name in fixed)
        asks = (
            executable or prepare or descriptors or shell or rest[9] != -1 or rest[20] or rest[21:] != (-1,)
        )
        package = command[2].partition(".")[0] if command[:2] == [sys.executable, "-m"] else ""
        if asks or is_own or package not in _IMPORTS:
            super()._execute_child(args, *rest)  # type: ignore[misc]
            return
        what = {"environment": own, "folder": str(folder or Path.cwd())}
        request = ForkRequest("tests.warm", [json.dumps(what), *command[2:]], pipe=_STDERR)
        self.pid = _fork(
            package, request, [rest[12] if rest[12] != -1 else 1, rest[14] if rest[14] != -1 else 2]
        )
        self._child_created = True
        self._close_pipe_fds(*rest[9:15])  # type: ignore[attr-defined]


def completed(command: list[str], limit_s: float, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, as `subprocess.run` does."""
    with Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options) as process:
        try:
            out, err = process.communicate(timeout=limit_s)
        finally:
            process.kill()
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def _fork(package: str, request: ForkRequest, descriptors: list[int]) -> int:
    if package not in _servers:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "tests.warm", str(theirs.fileno()), package, "-" * fork_server.TITLE]
        with theirs:
            environment = {"OPENBLAS_NUM_THREADS": "1", **_environment, "PYTHONUNBUFFERED": "1"}
            process = subprocess.Popen(command, pass_fds=[theirs.fileno()], env=environment)
        _servers[package] = ours, process
        atexit.register(_close, ours, process)
        assert ours.recv(100) == b"ready"
    asked, _ = _servers[package]
    with fork_server.adopting():
        socket.send_fds(asked, [json.dumps(request._asdict()).encode()], descriptors)
        return int(asked.recv(100))


def _close(asked: socket.socket, process: subprocess.Popen[bytes]) -> None:
    asked.close()
    process.wait()


def main() -> None:
    """A server of the tests, and in its forks the program that was asked for."""
    parent = os.getppid()
    fork_server.prepare(parent)
    asked = socket.socket(fileno=int(sys.argv[1]))
    vent_check.REST_S = _REST_S
    for module in _IMPORTS[sys.argv[2]]:
        __import__(module)
    if sys.argv[2] == "soro_ros":
        fork_server.warm("track_circle")
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
    sys.argv = [module, *arguments]
    fork_server.name_process([sys.executable, "-m", *sys.argv])
    if module == "soro_ros.cli":
        _fork_server_beside()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    fork_server.run(ForkRequest(module, arguments))


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
    if request := fork_server.serve(theirs, parent):
        fork_server.run(request)
    os._exit(0)


if __name__ == "__main__":
    main()
