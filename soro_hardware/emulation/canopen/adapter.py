"""An emulated CAN adapter, independent of its protocol with the host."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

from soro_hardware.emulation.canopen.error_counters import ErrorCounters
from soro_hardware.emulation.line import Line
from soro_hardware.transport.frame import Frame

LONGEST_OUTPUT = 65536  # bytes kept for a host that does not read; further messages are lost


class Adapter(Line):
    """One adapter on the bus.

    Parameters
    ----------
    send : callable
        Sends a frame of the host to the bus; returns False if the bus refuses it.

    Attributes
    ----------
    rejoin : callable
        Resets the controller, as a host does when it closes and opens an adapter in bus-off.
    overruns : int
        Number of messages lost because the host does not read.
    """

    def __init__(self, send: Callable[[Frame], bool]) -> None:
        super().__init__()
        self.send = send
        self.rejoin: Callable[[], None] = lambda: None
        self.overruns = 0

    @abstractmethod
    def deliver(self, frame: Frame, now_ns: int) -> None:
        """Receive a frame from the bus."""

    @abstractmethod
    def report(self, errors: ErrorCounters, letter: str) -> None:
        """Report the state of the controller, or an error on the bus, to the host; as `Controller.report`."""

    def say(self, text: bytes) -> None:
        """Send a message to the host; count an overrun if the output is full."""
        if len(self.output) > LONGEST_OUTPUT:
            self.overruns += 1
        else:
            self.put(text)
