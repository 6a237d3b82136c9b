"""Signs of life of the program that runs an arm: without them the node that drives the valves vents.

The nodes of a run have sessions of their own, so a program that is stopped (SIGSTOP, Ctrl-Z) or hangs leaves
them in motion. It writes to a pipe that the driver inherits; the end of the pipe is the end of the program.
"""

from __future__ import annotations

import contextlib
import os
import stat
import threading
import time
from collections.abc import Callable
from functools import cache

VARIABLE = "SORO_PULSE"
"""Variable of the environment with the number of the pipe."""
PERIOD_S = 0.1
# Silence after which the driver vents [s].
LIMIT_S = 1.0
# Above the priority of other programs, where the system permits it: a busy machine is no reason to vent.
_PRIORITY = 10


class Pulse:
    """Gives signs of life from a thread, until its end, or until the run should be over.

    Attributes
    ----------
    pipe : int
        Descriptor for the process that listens.
    stood_still_s : float
        Longest time without a sign, if it was long enough for a vent; else 0.
    """

    def __init__(self) -> None:
        self.pipe, self._out = os.pipe()
        os.set_blocking(self._out, False)  # one that does not listen must not hold up the run
        self.stood_still_s, self._until_s = 0.0, 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="pulse", daemon=True)

    def begin(self, longest_s: float) -> None:
        """Give the first sign and go on, for `longest_s` [s] unless it is renewed."""
        self.renew(longest_s)
        self._write()
        self._thread.start()

    def renew(self, left_s: float) -> None:
        """Go on for this time [s] from now on: a program that hangs does not renew it."""
        self._until_s = time.monotonic() + left_s

    def close(self) -> None:
        """Give no more signs; may be called again."""
        if self._ended.is_set():
            return
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        os.close(self.pipe)
        os.close(self._out)

    def _beat(self) -> None:
        with contextlib.suppress(AttributeError, OSError):  # no right to it
            os.sched_setscheduler(threading.get_native_id(), os.SCHED_FIFO, os.sched_param(_PRIORITY))
        last_s = time.monotonic()
        while not self._ended.wait(PERIOD_S):
            now_s = time.monotonic()
            if now_s - last_s > LIMIT_S:
                self.stood_still_s = max(self.stood_still_s, now_s - last_s)
            last_s = now_s
            if now_s < self._until_s:
                self._write()

    def _write(self) -> None:
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(self._out, b".")


class Listener:
    """Listens to the program that has started this process.

    Parameters
    ----------
    pipe : int
        Descriptor of the pipe.
    now_s : callable
        Gives the steady time [s].
    """

    def __init__(self, pipe: int, now_s: Callable[[], float] = time.monotonic) -> None:
        os.set_blocking(pipe, False)
        self._pipe, self._now_s = pipe, now_s
        self._last_s: float | None = None
        self._is_closed = False

    def failure(self) -> str | None:
        """Return why the arm must not go on; None while signs come, and before the first one."""
        if not self._is_closed:
            with contextlib.suppress(BlockingIOError):
                self._is_closed = not os.read(self._pipe, 1 << 16)
                self._last_s = self._now_s()
        if self._is_closed:
            return "the program that runs this arm has ended"
        if self._last_s is None or self._now_s() - self._last_s <= LIMIT_S:
            return None
        return f"the program that runs this arm is stopped or hangs: no sign of it for {LIMIT_S:g} s"


def listener() -> Listener | None:
    """Return what listens to the program that has started this process; None where none gives signs."""
    try:
        pipe = int(os.environ[VARIABLE])
        found = os.fstat(pipe)
    except (KeyError, ValueError, OSError):
        return None
    return _listener(pipe, found.st_ino) if stat.S_ISFIFO(found.st_mode) else None


@cache
def _listener(pipe: int, inode: int) -> Listener:
    """Return the one listener of a pipe: a byte that one of several reads is not there for the others."""
    return Listener(pipe)
