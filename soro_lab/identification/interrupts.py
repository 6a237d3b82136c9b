"""Ctrl-C ends a search and nothing between two searches, so that what was found is kept."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass


@dataclass
class _Interrupts:
    """What has come. Signals belong to the process, and so does this."""

    is_searching: bool = False
    is_waiting: bool = False

    def come(self, *_: object) -> None:
        """Interrupt a search, or keep the signal for the next one; a second one interrupts anything."""
        if self.is_searching or self.is_waiting:
            raise KeyboardInterrupt
        self.is_waiting = True


_INTERRUPTS = _Interrupts()


@contextmanager
def only_in_searches() -> Iterator[None]:
    """Let Ctrl-C wait for the next search of this work; outside the main thread nothing changes."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, _INTERRUPTS.come)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _INTERRUPTS.is_waiting = False


@contextmanager
def searching() -> Iterator[None]:
    """Mark a search.

    Raises
    ------
    KeyboardInterrupt
        In it; at once if Ctrl-C came before.
    """
    waited, _INTERRUPTS.is_waiting = _INTERRUPTS.is_waiting, False
    if waited:
        raise KeyboardInterrupt
    _INTERRUPTS.is_searching = True
    try:
        yield
    finally:
        _INTERRUPTS.is_searching = False
