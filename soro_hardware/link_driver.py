"""Driver of devices behind one TCP connection, which answer each cycle with one message."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, Protocol, Self, TypeVar

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import HardwareError
from soro_hardware.driver import Driver
from soro_hardware.platform import Freshness, TcpPlatform
from soro_hardware.supervisor_client import VentPlan
from soro_hardware.transport.tcp import ByteLink, link_to

P = TypeVar("P", bound=TcpPlatform)


class Traffic(Protocol):
    """Counts of the messages of a connection, with the meaning of the fields of `BusStatistics`."""

    sent: int
    received: int
    late: int
    refused: int

    @property
    def garbled(self) -> int:
        """Number of invalid messages."""


class LinkDriver(Driver[P]):
    """Driver of one arm behind a connection; after a loss it reconnects and sends zeros.

    Parameters
    ----------
    platform, times, clock, lockstep : PlatformBase, Freshness, callable, bool
        As in `Driver`.
    link : ByteLink
        Connection to the devices; `start_up` opens it.

    Attributes
    ----------
    traffic : Traffic or None
        Counts for `BusStatistics`.
    """

    answers_together = True
    traffic: Traffic | None = None

    def __init__(
        self,
        platform: P,
        times: Freshness,
        link: ByteLink,
        clock: Callable[[], float],
        lockstep: bool = False,
    ) -> None:
        super().__init__(platform, times, clock, lockstep)
        self.link, self._freshness = link, times
        link.before_send = self.require_watch

    @classmethod
    def over_tcp(
        cls, platform: Any, endpoint: str | None, clock: Callable[[], float], lockstep: bool
    ) -> Self:
        """Make the driver of a platform; parameters as in `Family.open`.

        Raises
        ------
        HardwareError
            If neither the platform nor the endpoint states an address.
        """
        address, patience_s = endpoint or platform.device, platform.transport.connect_timeout_s
        make: Callable[..., Self] = cls
        return make(platform, link_to(address, cls.kind, patience_s, clock), clock, lockstep)

    # -- hooks -------------------------------------------------------------------------------------

    @abstractmethod
    def send_and_receive(self, setpoint_pa: Array) -> Flags | bool:
        """Send set points (n,) [Pa gauge] over an open connection and process the answers, as `transfer`."""

    def connected(self) -> None:
        """Prepare a new connection."""

    def post_zeros(self) -> None:
        """Send 0 Pa over an open connection, without waiting for an answer."""
        self.send_and_receive(np.zeros(self.n_chambers))

    def vent_plan(self) -> VentPlan | None:
        """Return the messages with which the supervisor vents the arm, or None for no supervisor."""
        return None

    def counts(self) -> Mapping[str, int]:
        names = () if self.traffic is None else ("sent", "received", "late", "garbled", "refused")
        return {f"frames_{name}": getattr(self.traffic, name) for name in names}

    # -- hooks of `Driver` -------------------------------------------------------------------------

    @property
    def is_open(self) -> bool:
        return self.link.is_open

    def transfer(self, setpoint_pa: Array, is_vent: bool) -> Flags | bool:
        if self.link.is_open:
            return self.send_and_receive(setpoint_pa)
        self.sent_pa = np.zeros(self.n_chambers)
        if not self.latched:
            self.latch.add("link_lost", self.source, "the connection is gone")
        return self._reconnected() and self.send_and_receive(self.sent_pa)

    def on_lost(self, error: HardwareError) -> None:
        super().on_lost(error)
        if not self.link.is_open:
            self.sent_pa = np.zeros(self.n_chambers)

    def send_zeros(self) -> None:
        if self.link.is_open or self._reconnected():
            self.post_zeros()

    def disconnect(self) -> None:
        self.link.close()

    def patience_s(self, budget_s: float) -> float:
        """Return the longest wait for an answer [s]; in lockstep it is long while the devices answer."""
        is_waiting = self.lockstep and self._lateness.missed.min() < self._freshness.stale_cycles
        return self.platform.lockstep_timeout_s if is_waiting else budget_s

    def share(self) -> None:
        """Pass the connection to the supervisor."""
        plan = self.vent_plan()
        if self.supervisor is not None and plan is not None:
            self.supervisor.hold([plan], [self.link.fileno()])

    def give_up(self) -> None:
        """Close the connection, here and in the supervisor."""
        self.link.close()
        if self.supervisor is not None:
            self.supervisor.release()

    def _reconnected(self) -> bool:
        """Try once to restore a lost connection, without waiting; return whether it is open."""
        if not self.link.reconnect():
            return False
        self.connected()
        return True
