"""A process that watches the server's process, and vents the ports when it dies or hangs.

A DAC keeps its voltage when no program writes to it. The server vents when messages of its host stop; this
process vents when the server is killed, crashes or hangs. The server ends, with its ports at 0 Pa, when this
process is killed or stands still.
"""

from __future__ import annotations

import array
import contextlib
import fcntl
import math
import os
import select
import signal
import sys
import termios
import time
from collections.abc import Callable, Sequence

from soro_core.errors import SoroError

_ROUNDS, _PAUSE_S = 3, 0.02


def watched(
    run: Callable[[Callable[[], None]], int], vent: Callable[[], Sequence[int]], silence_s: float
) -> int:
    """Run a server in a child process and vent after it.

    Call it before any thread is started.

    Parameters
    ----------
    run : callable
        The server; it has to call its argument at least every `silence_s`, and returns its exit status.
    vent : callable
        Sets every port to 0 Pa and returns the ports that do not answer; called in this process when the
        child has ended.
    silence_s : float
        Time [s] without such a call after which the child is killed.

    Returns
    -------
    int
        Exit status of the child, 1 if it was killed.
    """
    receiver, sender = os.pipe()
    os.set_blocking(sender, False)
    child = os.fork()
    if child == 0:
        os.close(receiver)
        _serve(run, Beat(sender, silence_s))
    os.close(sender)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: _terminate(child))
    _watch(receiver, silence_s)
    with contextlib.suppress(ProcessLookupError):
        os.kill(child, signal.SIGKILL)  # the child has ended or hangs
    failed = vent()
    for _ in range(_ROUNDS - 1):
        time.sleep(_PAUSE_S if failed else 0.0)
        failed = vent()
    if failed:
        ports = ", ".join(map(str, failed))
        sys.stderr.write(
            f"NOT ALL VENTED: ports {ports} do not answer and hold their voltage: close the supply\n"
        )
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        sys.stderr.write(f"the server was killed by {signal.Signals(-code).name}\n")
    return 1 if code < 0 else code


def _serve(run: Callable[[Callable[[], None]], int], beat: Beat) -> None:
    """Run the child process; never returns."""
    code = 1
    try:
        code = run(beat)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
        if isinstance(end.code, str):
            sys.stderr.write(f"{end.code}\n")
    except SoroError as error:
        sys.stderr.write(f"{error}\n")
    except BaseException as error:
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
    finally:
        with contextlib.suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


class Beat:
    """Reports that the server works; ends the server if nobody reads the reports.

    Parameters
    ----------
    sender : int
        Pipe to the watching process.
    silence_s : float
        Time [s] for which that process may read nothing; a pause of the server itself does not count.
    """

    def __init__(self, sender: int, silence_s: float) -> None:
        self._sender, self._silence_s = sender, silence_s
        self._read_s, self._last_s = math.inf, math.inf

    def __call__(self) -> None:
        now_s, unread = time.monotonic(), array.array("i", [0])
        fcntl.ioctl(self._sender, termios.FIONREAD, unread)
        if not unread[0] or now_s - self._last_s > self._silence_s:
            self._read_s = now_s
        self._last_s = now_s
        if (silent_s := now_s - self._read_s) > self._silence_s:
            raise SystemExit(f"the watching process stood still for {silent_s:.2f} s")
        try:
            os.write(self._sender, b".")
        except BlockingIOError:
            pass
        except BrokenPipeError:
            raise SystemExit("the watching process has ended") from None


def _watch(receiver: int, silence_s: float) -> None:
    """Return when the child has ended or hangs; the time before its first beat is not limited."""
    poll = select.poll()
    poll.register(receiver, select.POLLIN)
    timeout_ms: float | None = None
    while poll.poll(timeout_ms):
        if not os.read(receiver, 4096):
            return
        timeout_ms = 1e3 * silence_s


def _terminate(child: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(child, signal.SIGTERM)
