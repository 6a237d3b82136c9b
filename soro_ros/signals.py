"""The signals that ask a process to end, from its first moment on."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from types import FrameType

# Closing its terminal asks a process to end, too.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


@contextlib.contextmanager
def noted() -> Iterator[list[int]]:
    """Note these signals in a list, for whoever looks at it, instead of acting on them."""
    seen: list[int] = []
    previous = {number: signal.signal(number, lambda number, _: seen.append(number)) for number in SIGNALS}
    try:
        yield seen
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def raised(seen: list[int]) -> Iterator[None]:
    """Note these signals and raise KeyboardInterrupt: for work in which nobody looks at the list."""

    def on_signal(number: int, frame: FrameType | None) -> None:
        seen.append(number)
        raise KeyboardInterrupt

    previous = {number: signal.signal(number, on_signal) for number in SIGNALS}
    try:
        if seen:
            raise KeyboardInterrupt
        try:
            yield
        except Exception:
            if not seen:
                raise
        # A compiler's callback makes an error of its own of an interrupt, or forgets it.
        if seen:
            raise KeyboardInterrupt
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
