"""The fork server of a run, from the side of the program that runs it."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import sys
from pathlib import Path

from soro_core.errors import SoroError
from soro_ros.host import pulse
from soro_ros.run import fork_server, processes
from soro_ros.run.fork_server import ForkRequest
from soro_ros.run.processes import Child, ForkedProcess

# Longest wait for a fork [s]: a server that is ready answers at once.
FORK_LIMIT_S = 20.0
VARIABLE = "SORO_FORK_SERVER"
"""Variable of the environment with the socket of a fork server that was forked beside this program."""


class ForkServer:
    """Starts processes as forks of one that has their imports and kernels; a context manager.

    Parameters
    ----------
    folder : Path
        Folder of the run, for its log.
    """

    def __init__(self, folder: Path) -> None:
        self._child: Child | None = None
        if given := os.environ.pop(VARIABLE, ""):
            self._socket = socket.socket(fileno=int(given))
        else:
            self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            room = "-" * fork_server.TITLE
            command = [sys.executable, "-m", fork_server.__name__, str(theirs.fileno()), room]
            with theirs:
                self._child = processes.start("fork_server", command, folder, passed=[theirs.fileno()])
        self._socket.setblocking(False)

    def __enter__(self) -> ForkServer:
        return self

    def __exit__(self, *error: object) -> None:
        self._socket.close()
        if self._child is not None:
            self._child.process.terminate()  # it may compile
            self._child.process.wait()

    def warm(self, scene_file: Path) -> None:
        """Have it load the kernels of a scene, or compile them; it `has_answered` then."""
        with contextlib.suppress(ConnectionError):  # `has_answered` says why
            self._socket.send(fork_server.WARM + str(scene_file.resolve()).encode())

    def has_answered(self) -> bool:
        """Whether it has done what it was asked for last, first its imports.

        Raises
        ------
        SoroError
            If it has ended.
        """
        return bool(self._answer())

    def start(
        self, name: str, command: list[str], folder: Path, priority: int = 0, pipe: int | None = None
    ) -> Child:
        """Start a process as `processes.start` does.

        Parameters
        ----------
        name : str
        command : list of str
            Its command line, ``python -m MODULE ...``.
        folder : Path
            Folder of the run.
        priority : int
            Above 0: priority of the scheduler SCHED_FIFO.
        pipe : int, optional
            Pipe of `pulse.Pulse`, for a process that listens to this one.

        Raises
        ------
        SoroError
            If the server has ended, or does not answer.
        """
        request = ForkRequest(command[2], command[3:], priority, "" if pipe is None else pulse.VARIABLE)
        sink = processes.log_of(name, folder).open("wb")
        self._socket.settimeout(FORK_LIMIT_S)
        with sink, fork_server.adopting():
            passed = [sink.fileno(), *([] if pipe is None else [pipe])]
            with contextlib.suppress(ConnectionError):  # the answer says why
                socket.send_fds(self._socket, [json.dumps(request._asdict()).encode()], passed)
            pid = int(self._answer())
        self._socket.setblocking(False)
        return Child(name, ForkedProcess(pid), processes.log_of(name, folder))

    def _answer(self) -> bytes:
        """Return its next answer; empty where there is none yet."""
        try:
            answer = self._socket.recv(100)
        except BlockingIOError:
            return b""
        except ConnectionError:
            answer = b""
        except TimeoutError:
            raise SoroError(f"the fork server does not answer for {FORK_LIMIT_S:g} s") from None
        if not answer:
            if self._child is None:
                raise SoroError("the fork server has ended")
            self._child.process.wait()
            raise SoroError(self._child.end_report())
        return answer
