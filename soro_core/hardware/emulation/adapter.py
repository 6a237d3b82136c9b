"""What an emulated CAN adapter is to the bus, whatever it speaks with its host."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

from soro_core.hardware.emulation.devices import Line
from soro_core.hardware.emulation.error_counters import ErrorCounters
from soro_core.hardware.transport.frame import Frame

LONGEST_OUTPUT = 65536  # bytes kept for a host that does not read; lines beyond are lost


class Adapter(Line):
    """One adapter on the bus.

    Attributes
    ----------
    send : callable
        Takes a frame of the host; False when the bus does not take it.
    rejoin : callable
        Resets the controller, as a host does by closing and opening an adapter that is off the bus.
    overruns : int
        Messages lost because the host does not read.
    """

    def __init__(self, send: Callable[[Frame], bool]) -> None:
        super().__init__()
        self.send = send
        self.rejoin: Callable[[], None] = lambda: None
        self.overruns = 0

    @abstractmethod
    def deliver(self, frame: Frame, now_ns: int) -> None:
        """Take a frame from the bus."""

    @abstractmethod
    def report(self, errors: ErrorCounters, letter: str) -> None:
        """Take a change of the controller's state, or an error on the wire."""

    def say(self, text: bytes) -> None:
        """Give the host a message, if it reads."""
        if len(self.output) > LONGEST_OUTPUT:
            self.overruns += 1
        else:
            self.put(text)
