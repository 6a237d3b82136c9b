"""Detection of a lost bus within one cycle, and its reopening; it stays unused until the next start-up."""

from __future__ import annotations

import time
from collections.abc import Callable

from soro_core.errors import HardwareError
from soro_hardware.port import Fault
from soro_hardware.transport.link import CanLink
from soro_hardware.transport.reconnect import FIRST_S, Reconnect


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
