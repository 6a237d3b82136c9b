"""A process that has imported what the nodes of a run need, and forks them, so that they start at once.

It never joins ROS, and no thread of it works, so that a fork of it is a clean process: the import of rclpy
starts those that wait for a tracer (LTTng), which a fork is without. The program that has started it
becomes the parent of all that it forks (as their nearest subreaper), so it waits for them, and they end with
it, as with processes that it had started itself (ADR 0071).
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import gc
import importlib
import inspect
import json
import os
import signal
import socket
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
_PRCTL = ctypes.CDLL(None).prctl
# Begins a request for the kernels of a scene; its file follows.
WARM = b"warm "
# Longest request [bytes], and room for the command line of a process, which `ps` shows.
_LONGEST, TITLE = 1 << 16, 600
# What every run needs; the compiler is behind it.
MODULES = (
    "soro_hardware.emulation.__main__",
    *(f"soro_ros.nodes.{name}" for name in ("recorder", "twin", "estimator", "controller", "regulator")),
    "rosidl_generator_py",  # the first use of a message imports it, and its parser
)


class ForkRequest(NamedTuple):
    """A process to fork.

    Attributes
    ----------
    module : str
        Its function `main` runs.
    arguments : list of str
        Its command line behind the module.
    priority : int
        Above 0: priority of the scheduler SCHED_FIFO.
    pipe : str
        Variable of the environment that names the pipe, the second descriptor; empty without one.
    """

    module: str
    arguments: list[str]
    priority: int = 0
    pipe: str = ""


def prepare(parent: int, priority: int = 0) -> None:
    """Prepare a child of a run: SIGTERM when its parent dies, and no SIGINT before it has a handler.

    No step may need a lock, which another thread may have held at the fork.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _PRCTL(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # the parent died before the request
        os._exit(1)
    if priority > 0:
        with contextlib.suppress(OSError):  # without the right to it; the nodes report this
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))


@contextlib.contextmanager
def adopting() -> Iterator[None]:
    """Be the parent of what those below fork and leave; not longer: other orphans are not waited for."""
    _PRCTL(_PR_SET_CHILD_SUBREAPER, 1)
    try:
        yield
    finally:
        _PRCTL(_PR_SET_CHILD_SUBREAPER, 0)


def serve(asked: socket.socket, parent: int) -> ForkRequest | None:
    """Fork a process for each request; returns in each of them, and at the end of the program that asks.

    Parameters
    ----------
    asked : socket.socket
        Where requests come from, each with a descriptor for the output, and one of a pipe.
    parent : int
        Process id of the program that asks.

    Returns
    -------
    ForkRequest or None
        What the forked process is to do; None at the end of the server.
    """
    # Python 3.12 warns of the threads that wait for a tracer.
    warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
    # rclpy names the caller of a log line by it; the first call resolves the path of each module.
    inspect.getmodule(inspect.currentframe())
    gc.collect()
    gc.freeze()  # what is shared stays shared
    with contextlib.suppress(ConnectionError):  # the program that asks has ended
        asked.send(b"ready")
        while True:
            message, descriptors, _, _ = socket.recv_fds(asked, _LONGEST, 2)
            if not message:
                return None
            if message.startswith(WARM):
                warm(message.removeprefix(WARM).decode())
                asked.send(b"warm")
                continue
            between = os.fork()
            if between == 0:
                between = os.getpid()
                if os.fork() > 0:
                    os._exit(0)  # the parent adopts the other one
                return _begin(ForkRequest(**json.loads(message)), asked, descriptors, parent, between)
            os.waitpid(between, 0)
            for descriptor in descriptors:
                os.close(descriptor)
    return None


def _begin(
    request: ForkRequest, asked: socket.socket, descriptors: list[int], parent: int, between: int
) -> ForkRequest:
    """Make a forked process what a started one would be."""
    os.setsid()
    while os.getppid() == between:
        time.sleep(1e-4)
    prepare(parent, request.priority)
    output, *pipe = descriptors
    for stream in (sys.stdout.fileno(), sys.stderr.fileno()):
        os.dup2(output, stream)
    os.close(output)
    if request.pipe:
        os.environ[request.pipe] = str(pipe[0])
    sys.argv = [request.module, *request.arguments]
    name_process([sys.executable, "-m", *sys.argv])
    asked.send(str(os.getpid()).encode())
    asked.close()
    return request


def name_process(words: list[str]) -> None:
    """Write a command line over that of the server, as far as there is room."""
    fields = Path("/proc/self/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
    first, end = int(fields[45]), int(fields[46])
    text = "\0".join(words).encode()[: max(end - first - 1, 0)]
    ctypes.memset(first, 0, end - first)
    ctypes.memmove(first, text, len(text))


def warm(file: str) -> None:
    """Load the kernels of a scene, or compile them; the nodes say what is wrong with it."""
    from soro_core._jit import compiling_once
    from soro_core.config import with_changes
    from soro_core.twin import Twin
    from soro_lab.scene import load_scene
    from soro_lab.scene.loop import loop_of

    with contextlib.suppress(Exception), compiling_once():
        for scene in load_scene(file).each:
            config = with_changes(scene.twin_node(), pressures="regulators", plant_link="", plant_chambers=())
            twin = Twin(scene.loaded_robot, config)
            for _ in loop_of(scene).run(twin, 3, twin.dt, before_s=-twin.dt):
                pass
    gc.collect()
    gc.freeze()


def run(request: ForkRequest) -> NoReturn:
    """Run what a process was forked for, and end it, as `multiprocessing` ends its forks.

    To take down what it shares with the server, object by object, would copy all of it.
    """
    status: Any = 1
    try:
        module = importlib.import_module(request.module)
        if hasattr(module, "__path__"):  # as `python -m` does with a package
            module = importlib.import_module(f"{request.module}.__main__")
        status = module.main() or 0
    except SystemExit as end:
        status = end.code or 0
    except BaseException:
        traceback.print_exc()
    finally:
        threading._shutdown()  # type: ignore[attr-defined]
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status if isinstance(status, int) else 1)


def main() -> None:
    """Entry point of the server: ``python -m soro_ros.run.fork_server SOCKET ROOM``."""
    parent = os.getppid()
    prepare(parent)
    asked = socket.socket(fileno=int(sys.argv[1]))
    for module in MODULES:
        importlib.import_module(module)
    if request := serve(asked, parent):
        run(request)


if __name__ == "__main__":
    main()
