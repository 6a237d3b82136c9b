"""What the event loops of board server and emulator have in common: signals end them, waits are exact."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from pathlib import Path


@contextlib.contextmanager
def ended_by_signals(stop: Callable[[], None], descriptor: int) -> Iterator[None]:
    """Call `stop` at SIGTERM and SIGINT, in a handler that has to be short.

    Parameters
    ----------
    stop : callable
        Sets the flag that ends the loop.
    descriptor : int
        Descriptor, not blocking, to which a byte is written to end the wait of the loop.
    """
    with contextlib.suppress(OSError):  # Linux delays waits by up to 50 us otherwise, half a frame
        Path("/proc/self/timerslack_ns").write_text("1000", encoding="ascii")
    numbers = (signal.SIGTERM, signal.SIGINT)
    former = {number: signal.signal(number, lambda *_: stop()) for number in numbers}
    former_fd = signal.set_wakeup_fd(descriptor)
    try:
        yield
    finally:
        signal.set_wakeup_fd(former_fd)
        for number, handler in former.items():
            signal.signal(number, handler)
