"""Keys of the terminal, one at a time."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable
from typing import Any

_NAMES = {"\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left", " ": "space"}
_POLL_S = 0.1


class Keyboard:
    """Calls a function for every key, in a thread; Ctrl-C stays a signal.

    Without a terminal, or in the background of one, there are no keys.

    Parameters
    ----------
    on_key : callable
        Takes the name of a key: space, up, down, left, right, or the letter.
    """

    def __init__(self, on_key: Callable[[str], None]) -> None:
        self._on_key, self._ended = on_key, threading.Event()
        self._fd, self._before = -1, list[Any]()
        self._thread: threading.Thread | None = None
        try:
            self._fd = sys.stdin.fileno()
            if not os.isatty(self._fd) or not self._in_foreground():
                return
            self._before = termios.tcgetattr(self._fd)
        except (OSError, ValueError, AttributeError, termios.error):  # no standard input, or a closed one
            return
        tty.setcbreak(self._fd)
        self._thread = threading.Thread(target=self._run, name="keyboard", daemon=True)
        self._thread.start()

    @property
    def is_there(self) -> bool:
        """Whether there are keys."""
        return self._thread is not None

    def close(self) -> None:
        """Leave the terminal as it was; may be called again."""
        self._ended.set()
        if self._thread is None:
            return
        if self._thread is not threading.current_thread():
            self._thread.join()
        self._thread = None
        if self._in_foreground():
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)

    def _in_foreground(self) -> bool:
        """Whether the terminal is this program's: one in the background that reads is stopped."""
        return os.tcgetpgrp(self._fd) == os.getpgrp()

    def _run(self) -> None:
        while not self._ended.is_set():
            ready, _, _ = select.select([self._fd], [], [], _POLL_S)
            if not ready or not self._in_foreground():
                continue
            text = os.read(self._fd, 64).decode(errors="replace")
            if not text:  # the terminal is gone
                return
            for key in keys(text):
                self._on_key(key)


def keys(text: str) -> list[str]:
    """Return the names of the keys whose bytes a terminal has sent."""
    found, at = [], 0
    while at < len(text):
        size = 3 if text.startswith("\x1b[", at) else 1
        letters = text[at : at + size]
        found.append(_NAMES.get(letters, letters))
        at += size
    return found
