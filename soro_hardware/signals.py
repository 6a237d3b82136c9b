"""Signals that request the end of a process: noted, raised, or ending an event loop."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

# The terminal sends SIGHUP when it closes.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
# Period of the question whether the compiler is still in LLVM [s].
LLVM_PERIOD_S = 0.01


class Interrupt(KeyboardInterrupt):
    """A signal interrupted work.

    Python notes that a KeyboardInterrupt of exactly this type left an ``exec`` of text, as in a dataclass,
    and `python -m` then ends with SIGINT instead of its exit status, however the interrupt was handled.
    """


@contextlib.contextmanager
def noted() -> Iterator[list[int]]:
    """Append these signals to a list that the caller reads, instead of acting on them."""
    seen: list[int] = []
    previous = {number: signal.signal(number, lambda number, _: seen.append(number)) for number in SIGNALS}
    try:
        yield seen
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def raised(seen: list[int]) -> Iterator[None]:
    """Append these signals to the list and raise `Interrupt`, for work that does not read the list.

    It is not raised in the Python code around LLVM, whose half-made objects fail when they are deleted, but
    as soon as that has returned. SIGALRM is used for it.
    """

    is_inside = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        if is_inside and _is_in_llvm(frame):
            signal.setitimer(signal.ITIMER_REAL, LLVM_PERIOD_S)
        elif is_inside:
            raise Interrupt

    def on_signal(number: int, frame: FrameType | None) -> None:
        seen.append(number)
        interrupt(number, frame)

    def on_ignored(ignored: sys.UnraisableHookArgs) -> None:
        # A callback of the compiler cannot raise the interrupt; the list has it.
        if not isinstance(ignored.exc_value, KeyboardInterrupt):
            hook(ignored)

    previous = {signal.SIGALRM: signal.signal(signal.SIGALRM, interrupt)}
    previous |= {number: signal.signal(number, on_signal) for number in SIGNALS}
    hook, sys.unraisablehook = sys.unraisablehook, on_ignored
    try:
        is_inside = True  # one signal earlier would leave the handlers in place
        if seen:
            raise Interrupt
        try:
            yield
        except Exception:
            if not seen:
                raise
        # A callback of the compiler replaces an interrupt by another error, or ignores it.
        if seen:
            raise Interrupt
    finally:
        is_inside = False  # one more signal here would do so too, and interrupt a safe end
        signal.setitimer(signal.ITIMER_REAL, 0)
        sys.unraisablehook = hook
        for number, handler in previous.items():
            signal.signal(number, handler)


def _is_in_llvm(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] == "llvmlite":
            return True
        frame = frame.f_back
    return False


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
