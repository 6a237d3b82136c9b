"""Driver for the published TCP server of the VEAB boards.

That server has no watchdog, and when it ends, for whatever reason, the valves hold their pressure for good.
It ends when its client leaves, when it hears nothing for 0.5 s, and at any message of another length. So this
driver never leaves before readings have shown that the arm is empty, a thread of it sends 0 Pa while the
control loop is silent, each message goes out in one piece, and a second process holds the connection and
vents when this one is killed. For the rest, a cable or the machine itself, the arm needs a normally open dump
valve.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware import rest
from soro_core.hardware.driver_base import ConnectionDriver
from soro_core.hardware.finding import Finding
from soro_core.hardware.port import Array, BusStatistics, Exchange
from soro_core.hardware.supervisor_client import LOST
from soro_core.hardware.transport.tcp import ByteLink, link_to
from soro_core.hardware.veab.config import VeabPlatform
from soro_core.hardware.veab.keeper import Keeper
from soro_core.hardware.veab.stream import Stream

_SERVER_HZ = 250.0
# A message reaches the DACs in the server's next round, 4 ms; then the connection may be given up.
_SETTLE_NS = 10_000_000
_LEAST_S = 0.05  # time at 0 Pa before leaving: readings may be older than the set points


class VeabRegulator(ConnectionDriver[VeabPlatform]):
    """Regulators of one arm behind the published server.

    Parameters
    ----------
    platform : VeabPlatform
        Ports, range and times.
    link : ByteLink
        Connection to the server; opened by `configure`.
    clock, lockstep
        As for every driver; in lockstep it waits for one reading a message, and keeps nothing alive.

    Attributes
    ----------
    vent_confirmed : bool
        Whether readings have shown every chamber empty since 0 Pa was last commanded.
    """

    source = "link"
    device_watchdog = False

    def __init__(
        self, platform: VeabPlatform, link: ByteLink, clock: Callable[[], float], lockstep: bool = False
    ) -> None:
        super().__init__(platform, platform.host, clock, lockstep)
        self.vent_confirmed = False
        self._stream = Stream(platform, link, clock)
        self._lock = threading.Lock()
        self._keeper: Keeper | None = None
        self._broken_ns: int | None = None  # since when the readings make no sense
        self._now_ns = self._lost = self._garbled = 0
        self._zeros: Array = np.zeros(len(self._names))

    @property
    def update_hz(self) -> float:
        return min(self.platform.cycle_hz, _SERVER_HZ)

    @property
    def statistics(self) -> BusStatistics:
        return BusStatistics(
            cycles=self._cycles,
            frames_sent=self._stream.sent,
            frames_received=self._stream.received,
            frames_lost=self._lost,
            frames_garbled=self._garbled,
        )

    def probe(self) -> Iterator[Finding]:
        # To connect and leave is what ends that server: it is seen by starting up only.
        found = "it ends when its client leaves, as this examination does"
        yield Finding("published server", "warn", found, "start it again afterwards; soro_board's stays")

    def configure(self) -> None:
        with self._lock:
            self._begin()
            self._broken_ns = None
            if self.platform.host.supervisor and not self.lockstep:
                self._stream.supervise()
            is_new = self._stream.open()
            if self._keeper is None and not self.lockstep:
                self._keeper = Keeper(self._keep, self.platform.host.keep_alive_s / 4)
            self._bring_to_zero(is_new)
            self._configured = True

    def exchange(self, setpoint_pa: Array, now_ns: int) -> Exchange:
        setpoint, refused = self._checked(setpoint_pa)
        if self._keeper is not None and not self._keeper.is_alive:
            self._latch("device_error", "the thread that keeps the server alive has died")
        with self._lock:
            self._now_ns = now_ns
            if not self._stream.watched:
                self._latched.setdefault((LOST.code, ""), LOST)
            usable = not refused and not self._latched
            fresh = np.full(self.n_chambers, self._cycle(setpoint if usable else self._zeros))
            self._confirm_vent(bool(fresh.all()))
            faults = (*refused, *self._faults(fresh, now_ns))
            return Exchange(self._stream.sent_pa.copy(), self._stream.pressure_pa.copy(), fresh, faults)

    def vent(self) -> None:
        with self._lock:
            if self._begun and not self._closed:
                try:
                    if self._stream.reconnect():
                        self._stream.drain()
                        self._stream.send(self._zeros)
                except HardwareError as error:
                    self._latch("link_lost", str(error))

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        if self._keeper is not None:
            self._keeper.stop()
        with self._lock:
            # Leaving ends the server, which holds what it has: the arm must be empty before.
            with contextlib.suppress(HardwareError):
                if self._configured and self._stream.is_open:
                    period_s = 1.0 / self.platform.cycle_hz
                    fall_pa = self.platform.shutdown_ramp_pa_s * period_s
                    waits = [round(s / period_s) for s in (_LEAST_S, self.platform.host.vent_timeout_s)]
                    start_pa = self._stream.sent_pa
                    is_empty = rest.ramp_down(self._paced, start_pa, fall_pa, *waits)
                    # A server that has gone meanwhile cannot show again what it has shown before.
                    self.vent_confirmed = is_empty or (self.vent_confirmed and not self._stream.is_open)
            self._configured = False
            self._stream.close(self.vent_confirmed)

    # -- a cycle -----------------------------------------------------------------------------------

    def _cycle(self, setpoint_pa: Array) -> bool:
        """Send, and take a reading that has come since the last cycle; whether there was one."""
        stream = self._stream
        try:
            if not stream.is_open:
                stream.sent_pa, setpoint_pa = self._zeros.copy(), self._zeros
                if not stream.reconnect():
                    return False
                self._broken_ns = None
            if not self.lockstep:
                stream.drain()
            stream.send(setpoint_pa)
            self._wait_for_reading()
            if stream.broken:
                self._resynchronise(stream.broken)
        except HardwareError as error:
            self._latch("link_lost", str(error))
            return False
        new = stream.take_new()
        self._lost += not new
        return new

    def _wait_for_reading(self) -> None:
        stream = self._stream
        deadline = self.clock() + self._patience_s(self.platform.cycle_budget_s)
        while not stream.has_new and not stream.broken and (left := deadline - self.clock()) > 0:
            if not stream.receive(left):
                return

    def _resynchronise(self, why: str) -> None:
        """Give up a stream that makes no sense, once the server has had time to write 0 Pa to its DACs."""
        self._latch("out_of_sync", f"the server sends {why}")
        if self._broken_ns is None:
            self._broken_ns = self._now_ns
            self._garbled += 1
            self._stream.send(self._zeros)
        elif self._now_ns - self._broken_ns >= _SETTLE_NS:
            self._stream.give_up()

    def _confirm_vent(self, fresh: bool) -> None:
        """Note whether readings show an empty arm: this server is not taken at its word."""
        if self._stream.sent_pa.any():
            self.vent_confirmed = False
        elif fresh and self._stream.is_empty(self.platform.host.vented_pa):
            self.vent_confirmed = True

    def _paced(self, setpoint_pa: Array) -> Array:
        """One cycle of the shutdown."""
        next_s = self.clock() + 1.0 / self.platform.cycle_hz
        fresh = self._cycle(setpoint_pa)
        while not self.lockstep and self._stream.is_open and (left := next_s - self.clock()) > 0:
            self._stream.receive(left)
        return self._stream.pressure_pa if fresh else np.full(self.n_chambers, np.nan)

    def _keep(self) -> None:
        """The keeper's turn: 0 Pa if the control loop has been silent, and room for the server's readings."""
        stream = self._stream
        with self._lock:
            if not stream.is_open:
                return
            try:
                stream.drain()
                silent_s = stream.silent_s
                if silent_s >= self.platform.host.keep_alive_s:
                    if stream.sent_pa.any():
                        self._latch("watchdog_vented", f"no exchange for {silent_s * 1e3:.0f} ms", "host")
                    stream.send(self._zeros)
            except HardwareError as error:
                self._latch("link_lost", str(error))

    def _bring_to_zero(self, is_new: bool) -> None:
        """Send 0 Pa until the readings show that every chamber is empty."""
        times, stream, heard = self.platform.host, self._stream, False
        # In lockstep each message is a cycle of the devices' time, so none is sent without need.
        has_read = self.lockstep and (not is_new or stream.receive(self.platform.lockstep_timeout_s))
        if has_read and not stream.sent_pa.any() and stream.is_empty(times.vented_pa):
            stream.take_new()
            self.vent_confirmed = True
            return
        for _ in range(round(times.vent_timeout_s * self.platform.cycle_hz)):
            fresh = not np.isnan(self._paced(self._zeros)).any()
            if not stream.is_open or stream.broken:
                why = next(iter(self._latched.values())).message
                advice = "is `ports` what the server has, and was it started again after its last client?"
                raise HardwareError(f"start-up: {why}; {advice}")
            heard = heard or fresh
            if fresh and stream.is_empty(times.vented_pa):
                self.vent_confirmed = True
                return
        if not heard:
            raise HardwareError("start-up: the server sends no readings; is `ports` what it has?")
        n = int(np.argmax(np.abs(stream.pressure_pa)))
        kept = f"{stream.pressure_pa[n] / 1e3:.1f} kPa after {times.vent_timeout_s:g} s of set point 0"
        which = f"{self._names[n]} (port {self.platform.valves[n].port})"
        raise HardwareError(f"{which}: start-up: {kept}; look at that valve, its sensor and its wires")


def open_driver(
    platform: VeabPlatform, endpoint: str | None, clock: Callable[[], float], lockstep: bool
) -> VeabRegulator:
    """Make the driver of a platform; `endpoint` takes the place of the server's address.

    Raises
    ------
    HardwareError
        If neither names an address.
    """
    link = link_to(endpoint or platform.device, "VEAB server", platform.transport.connect_timeout_s, clock)
    return VeabRegulator(platform, link, clock, lockstep)
