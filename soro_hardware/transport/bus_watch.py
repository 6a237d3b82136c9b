"""Detection of a lost bus within one cycle, and its reopening; it stays unused until the next start-up."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from soro_core.errors import HardwareError
from soro_hardware.port import Fault
from soro_hardware.transport.link import CanLink

FIRST_S, LONGEST_S = 0.5, 10.0
MOST_TRIES, WINDOW_S = 3, 60.0


class Reconnect:
    """Times of attempts to open a bus; the caller states the present time.

    After a lost connection the pause doubles from 0.5 s to 10 s. After bus-off it is 0.5 s, with at most
    three openings per minute: repeated bus-off has its cause in the wiring, and more attempts only disturb
    other nodes.
    """

    def __init__(self) -> None:
        self._pause_s = FIRST_S
        self._due_s: float | None = None
        self._bus_offs: deque[float] = deque(maxlen=MOST_TRIES)

    @property
    def is_lost(self) -> bool:
        """Whether the bus is lost and has not been opened again."""
        return self._due_s is not None

    def broken(self, now_s: float) -> None:
        """Record that the connection was lost, or could not be opened."""
        self._due_s = now_s + self._pause_s
        self._pause_s = min(2 * self._pause_s, LONGEST_S)

    def bus_off(self, now_s: float) -> None:
        """Record bus-off."""
        self._due_s = now_s + FIRST_S
        self._bus_offs.append(now_s)

    def wait_s(self, now_s: float, keep: int = 0) -> float:
        """Return the time until the next attempt [s]; `keep` attempts of each minute stay reserved."""
        if self._due_s is None:
            return 0.0
        wait = self._due_s - now_s
        counted = list(self._bus_offs)[keep - MOST_TRIES :]
        if len(counted) == MOST_TRIES - keep:
            wait = max(wait, counted[0] + WINDOW_S - now_s)
        return max(wait, 0.0)

    def opened(self) -> None:
        """Record that the bus is open again."""
        self._due_s = None

    def healthy(self) -> None:
        """Reset the pause to its shortest value, after the configuration of the devices."""
        self._pause_s = FIRST_S


class BusWatch:
    """Watches a link for its driver.

    Parameters
    ----------
    link : CanLink
        Link to the bus.
    clock : callable
        Returns a monotonic time [s].
    """

    def __init__(self, link: CanLink, clock: Callable[[], float]) -> None:
        self._link, self._clock = link, clock
        self._reconnect = Reconnect()
        self._error = HardwareError("")
        self.fault: Fault | None = None

    def open(self) -> None:
        """Open the bus for a start-up; after bus-off with a pause, and not too often.

        Raises
        ------
        HardwareError
            If the bus cannot be opened, or was in bus-off too often.
        """
        self._notice_bus_off()
        if self.fault is not None and self.fault.code == "bus_off":
            wait_s = self._reconnect.wait_s(self._clock())
            if wait_s > FIRST_S:
                raise HardwareError(
                    "off three times within a minute: check wiring, terminators and bit rate; "
                    f"it can be opened again in {wait_s:.0f} s",
                    "bus",
                    "bus_off",
                )
            time.sleep(wait_s)
        try:
            self._link.open()
        except HardwareError:
            self._reconnect.broken(self._clock())
            raise
        self._reconnect.opened()
        self.fault = None

    def configured(self) -> None:
        """Reset the pauses of the reopening after the configuration of the devices."""
        self._reconnect.healthy()

    def usable(self) -> bool:
        """Return whether a cycle may use the bus; open a lost bus again when it is due.

        A lost bus stays unused until `open`, also after it is open again.

        Raises
        ------
        HardwareError
            While the connection is lost.
        """
        self._notice_bus_off()
        # The last try of a minute is reserved for the user's reset.
        if self._reconnect.is_lost and self._reconnect.wait_s(self._clock(), keep=1) <= 0:
            try:
                self._link.open()
            except HardwareError:
                self._reconnect.broken(self._clock())
            else:
                self._reconnect.opened()
        if self.fault is None:
            return True
        if self.fault.code == "connection_lost" and not self._link.is_open:
            raise self._error.with_traceback(None)  # a new raise each time, not a longer one
        return False

    def broke(self, error: HardwareError) -> None:
        """Close a lost connection; the watchdogs of the devices vent them."""
        self._error = error
        self._link.close()
        self._reconnect.broken(self._clock())
        if self.fault is None:
            self.fault = Fault("connection_lost", "bus", f"{error}; open again", latched=True)

    def _notice_bus_off(self) -> None:
        if self._link.is_bus_off:
            self._link.close()
            self._reconnect.bus_off(self._clock())
            if self.fault is None:
                self.fault = Fault("bus_off", "bus", "the adapter is off the bus", latched=True)
