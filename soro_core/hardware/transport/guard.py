"""A bus that is lost and found again: noticed in the cycle in which it happens, silent until configured."""

from __future__ import annotations

import time
from collections.abc import Callable

from soro_core.errors import HardwareError
from soro_core.hardware.port import Fault
from soro_core.hardware.transport.link import CanLink
from soro_core.hardware.transport.reconnect import FIRST_S, Reconnect


class BusGuard:
    """Watches a link for its driver.

    Parameters
    ----------
    link : CanLink
        The bus.
    clock : callable
        Monotonic time [s].
    """

    def __init__(self, link: CanLink, clock: Callable[[], float]) -> None:
        self._link, self._clock = link, clock
        self._reconnect = Reconnect()
        self._why = ""
        self.fault: Fault | None = None

    def open(self) -> None:
        """Open the bus for a start-up; after bus-off not at once, and not again and again.

        Raises
        ------
        HardwareError
            If it cannot be opened, or has been off too often.
        """
        self._notice_bus_off()
        if self.fault is not None and self.fault.code == "bus_off":
            wait_s = self._reconnect.wait_s(self._clock())
            if wait_s > FIRST_S:
                raise HardwareError(
                    "bus: off three times within a minute: check wiring, terminators and bit rate; "
                    f"it can be opened again in {wait_s:.0f} s"
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
        """The devices have been configured: a later break starts with a short pause."""
        self._reconnect.healthy()

    def usable(self) -> bool:
        """Whether a cycle may use the bus; a lost one is opened again when it is time to.

        A bus that has been lost stays unused, open or not, until `open`.

        Raises
        ------
        HardwareError
            While the connection is broken.
        """
        self._notice_bus_off()
        # The last try of a minute is left to the user's reset.
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
            raise HardwareError(self._why)
        return False

    def broke(self, error: HardwareError) -> None:
        """The connection has broken: close it; the devices' own watchdogs vent them."""
        self._why = str(error)
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
