"""Driver of a VTEM motion terminal: all set points and all readings once a cycle.

As far as is known the terminal keeps its set points when its host falls silent. The bus node may reset its
outputs, but after which silence, and what the valves do then, depends on its parameters. So nothing is
counted on: a second process holds the connection and writes 0 Pa when this one is killed or hangs, and for
the rest, a cable or the machine itself, the arm needs a normally open dump valve.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware import rest
from soro_core.hardware.driver_base import ConnectionDriver
from soro_core.hardware.finding import Finding
from soro_core.hardware.port import Array, BusStatistics, Exchange, Flags
from soro_core.hardware.supervisor_client import LOST, Supervisor, VentPlan, running
from soro_core.hardware.transport.tcp import ByteLink, link_to
from soro_core.hardware.vtem.config import VtemPlatform
from soro_core.hardware.vtem.modbus import Client
from soro_core.hardware.vtem.probe import look
from soro_core.hardware.vtem.registers import State
from soro_core.hardware.vtem.terminal import Terminal

# The published driver lets a valve exhaust so long before it ends the app.
_EXHAUST_S = 1.0
# For the supervisor.
_ANSWER_S, _LONGEST_S = 0.1, 10.0


class VtemRegulator(ConnectionDriver[VtemPlatform]):
    """Regulators of one arm on one motion terminal.

    Parameters
    ----------
    platform : VtemPlatform
        Slots, range and times.
    link : ByteLink
        Connection to the bus node; opened by `configure`.
    clock, lockstep
        As for every driver.
    """

    source = "terminal"
    device_watchdog = False

    def __init__(
        self, platform: VtemPlatform, link: ByteLink, clock: Callable[[], float], lockstep: bool = False
    ) -> None:
        super().__init__(platform, platform.host, clock, lockstep)
        self._link = link
        self._client = Client(link, platform.registers.unit, clock)
        self._terminal = Terminal(platform, self._client, clock, lockstep)
        self._supervisor: Supervisor | None = None
        self._was_lost = self._seen_empty = False
        self._lost = 0
        self._none: Flags = np.zeros(len(self._names), dtype=np.bool_)

    @property
    def statistics(self) -> BusStatistics:
        client = self._client
        return BusStatistics(
            cycles=self._cycles,
            frames_sent=client.sent,
            frames_received=client.received,
            frames_lost=self._lost,
            frames_late=client.late,
            frames_garbled=client.garbled,
            frames_refused=client.refused,
        )

    def probe(self) -> Iterator[Finding]:
        return look(self.platform, self._link, self._terminal, self.clock)

    def configure(self) -> None:
        self._begin()
        self._was_lost = self._seen_empty = False
        if self.platform.host.supervisor and not self.lockstep:
            self._supervisor = running(self._supervisor)
            self._supervisor.wait_until_ready()
            self._supervisor.watches(False)  # what follows may take seconds, and begins with 0 Pa
        try:
            # A connection that is in order is kept: a bus node may have few of them.
            if not self._is_answered():
                self._link.open()
            self._share()
            self._terminal.start()
        except HardwareError as error:
            self._link.close()
            if self._supervisor is not None:
                self._supervisor.let_go()
            raise HardwareError(f"start-up: {error}") from None
        self._configured = True

    def exchange(self, setpoint_pa: Array, now_ns: int) -> Exchange:
        setpoint, refused = self._checked(setpoint_pa)
        if refused or self._latched:
            setpoint = np.zeros_like(setpoint)
        if not self._watched(setpoint):  # before pressure is asked for: a hang may follow at once
            self._latched.setdefault((LOST.code, ""), LOST)
            setpoint = np.zeros_like(setpoint)
        fresh = self._cycle(setpoint)
        faults = (*refused, *self._faults(fresh, now_ns))
        terminal = self._terminal
        return Exchange(terminal.sent_pa.copy(), terminal.pressure_pa.copy(), fresh.copy(), faults)

    def vent(self) -> None:
        if self._begun and not self._closed:
            try:
                if self._link.is_open or self._reconnected():
                    self._terminal.vent()
            except HardwareError as error:
                self._latch("link_lost", str(error))
            self._watched(self._terminal.sent_pa)

    def close(self) -> None:
        if self._closed:
            return
        is_empty = not self._configured
        with contextlib.suppress(HardwareError):
            if self._configured and self._link.is_open:
                period_s = 1.0 / self.platform.cycle_hz
                fall_pa = self.platform.shutdown_ramp_pa_s * period_s
                longest = round(_EXHAUST_S / period_s)
                is_empty = rest.ramp_down(self._paced, self._terminal.sent_pa, fall_pa, 1, longest)
                # An app that is ended with pressure behind it may keep it; one that goes on at 0 Pa exhausts.
                if is_empty:
                    self._terminal.stop()
        self._closed, self._configured = True, False
        self._link.close()
        if self._supervisor is not None:
            self._supervisor.dismiss(is_empty or self._seen_empty)

    # -- a cycle -----------------------------------------------------------------------------------

    def _cycle(self, setpoint_pa: Array) -> Flags:
        """One exchange with the terminal; where it gave readings of now. A lost connection is a fault."""
        try:
            if not self._link.is_open:
                self._terminal.sent_pa, setpoint_pa = np.zeros_like(setpoint_pa), np.zeros_like(setpoint_pa)
                self._was_lost = True
                self._latch("link_lost", "the connection is gone")
                if not self._reconnected():
                    return self._none
            fresh = self._terminal.exchange(
                setpoint_pa, self.clock() + self._patience_s(self.platform.budget_s)
            )
        except HardwareError as error:
            self._latch("link_lost", str(error))
            return self._none
        if self._client.refusal is not None:
            self._latch("command_rejected", self._client.refusal)
        if fresh is None:
            self._lost += 1
            return self._none
        self._look_at_slots()
        terminal = self._terminal
        readings = np.where(fresh, np.abs(terminal.pressure_pa), np.inf)
        self._seen_empty = bool(not terminal.sent_pa.any() and np.all(readings < rest.EMPTY_PA))
        return fresh

    def _look_at_slots(self) -> None:
        """A slot that regulates no longer follows nobody, and starts again only by `configure`."""
        for slot, status in self._terminal.statuses.items():
            if status.regulates:
                continue
            code = "rebooted" if self._was_lost else "left_operational"
            if status.state is State.FAILED:
                code = "device_error"
            self._latch(code, str(status), self._terminal.chambers_of(slot))

    def _paced(self, setpoint_pa: Array) -> Array:
        """One cycle of the shutdown."""
        next_s = self.clock() + 1.0 / self.platform.cycle_hz
        self._watched(setpoint_pa)
        fresh = self._cycle(setpoint_pa)
        if not self.lockstep:
            time.sleep(max(next_s - self.clock(), 0.0))
        return np.where(fresh, self._terminal.pressure_pa, np.nan)

    # -- the connection ----------------------------------------------------------------------------

    def _is_answered(self) -> bool:
        """Whether there is a connection that works."""
        with contextlib.suppress(HardwareError):
            return self._link.is_open and self._terminal.read(self.platform.host.answer_timeout_s)
        return False

    def _reconnected(self) -> bool:
        """Take one step, without waiting, to get a lost connection back; whether it stands."""
        if not self._link.reconnect():
            return False
        self._share()
        return True

    def _share(self) -> None:
        """Begin with a connection, and share it with the process that vents in need."""
        self._client.reset()
        if self._supervisor is None:
            return
        send, answer = (data.decode("latin-1") for data in self._terminal.vent_bytes())
        plan = VentPlan("motion terminal", ({"send": send, "bytes": answer},), _ANSWER_S, _LONGEST_S)
        self._supervisor.hold([plan], [self._link.fileno()])

    def _watched(self, setpoint_pa: Array) -> bool:
        """Tell the supervisor whether it would have to vent, by what is on its way; false if it has gone."""
        pressed = bool(setpoint_pa.any() or self._terminal.sent_pa.any())
        return self._supervisor is None or self._supervisor.watches(pressed)


def open_driver(
    platform: VtemPlatform, endpoint: str | None, clock: Callable[[], float], lockstep: bool
) -> VtemRegulator:
    """Make the driver of a platform; `endpoint` takes the place of the bus node's address.

    Raises
    ------
    HardwareError
        If neither names an address.
    """
    link = link_to(
        endpoint or platform.device, "motion terminal", platform.transport.connect_timeout_s, clock
    )
    return VtemRegulator(platform, link, clock, lockstep)
