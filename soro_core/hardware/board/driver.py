"""Driver of a board that runs `soro board`: one SET and one STATE a cycle.

The board vents by itself when its host dies, so this driver only has to say what is wrong, not to mend it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware import rest
from soro_core.hardware.board import messages, texts
from soro_core.hardware.board.config import BoardPlatform
from soro_core.hardware.board.messages import PortFlag, State
from soro_core.hardware.board.probe import look
from soro_core.hardware.board.session import Session
from soro_core.hardware.driver_base import ConnectionDriver
from soro_core.hardware.finding import Finding
from soro_core.hardware.port import Array, BusStatistics, Exchange, Fault, Flags
from soro_core.hardware.transport.tcp import ByteLink, link_to

Answer = TypeVar("Answer")

_LONGEST_WAIT_S = 1.0


class BoardRegulator(ConnectionDriver[BoardPlatform]):
    """Regulators of one arm behind one board.

    Parameters
    ----------
    platform : BoardPlatform
        Ports, range and times.
    link : ByteLink
        Connection to the board; opened by `configure`.
    clock, lockstep
        As for every driver.
    """

    source = "board"
    device_watchdog = True

    def __init__(
        self, platform: BoardPlatform, link: ByteLink, clock: Callable[[], float], lockstep: bool = False
    ) -> None:
        super().__init__(platform, platform.host, clock, lockstep)
        self._ports = [valve.port for valve in platform.valves]
        self._session = Session(link, len(platform.ports))
        self._session.on_state = self._on_state
        # What the board applies may differ by a count of its DAC.
        self._tolerance_pa = [1.0 + platform.resolution_pa(port) for port in self._ports]
        self._boot: int | None = None
        self._taken: State | None = None
        self._heard_ns: int | None = None
        self._heard = self._lost = 0
        self._pressure_pa: Array = np.full(len(self._names), np.nan)
        self._sent_pa: Array = np.zeros(len(self._names))

    @property
    def statistics(self) -> BusStatistics:
        session = self._session
        return BusStatistics(
            cycles=self._cycles,
            frames_sent=session.sent,
            frames_received=session.received,
            frames_lost=self._lost,
            frames_late=session.late,
            frames_garbled=session.garbled,
            frames_refused=session.not_obeyed,
        )

    def probe(self) -> Iterator[Finding]:
        return look(self.platform, self._session, self.clock)

    def configure(self) -> None:
        self._begin()
        self._boot = self._heard_ns = None
        session = self._session
        session.link.open()
        session.greet()
        welcome = self._await(lambda: session.welcome, "HELLO")
        allowed = (round(self.platform.range.minimum_pa), round(self.platform.range.maximum_pa))
        for number in self._ports:
            if welcome.limits_pa[number] != allowed:
                raise self._failed(
                    f"port {number} is limited to {welcome.limits_pa[number]} Pa, not {allowed}"
                )
        self._boot = welcome.boot
        session.reset()
        state = self._await(lambda: session.state if session.is_answered else None, "RESET")
        if state.cause:
            raise self._failed(f"{texts.CAUSES[state.cause][1]}{texts.complaints(state)}")
        self._sent_pa = np.zeros(self.n_chambers)
        self._configured = True

    def exchange(self, setpoint_pa: Array, now_ns: int) -> Exchange:
        setpoint, refused = self._checked(setpoint_pa)
        self._drain()
        usable = not refused and not self._latched
        fresh = self._transact(setpoint if usable else np.zeros_like(setpoint))
        faults = [*refused, *self._judge(fresh, now_ns)]
        return Exchange(self._sent_pa.copy(), self._pressure_pa.copy(), fresh, tuple(faults))

    def vent(self) -> None:
        if self._configured and self._session.link.is_open:
            try:
                self._session.drain()
                self._send_set(np.zeros(self.n_chambers))
            except HardwareError as error:
                self._latch("link_lost", str(error))

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        # The board vents by itself where the connection is gone.
        with contextlib.suppress(HardwareError):
            if self._configured and self._session.link.is_open:
                period_s = 1.0 / self.platform.cycle_hz
                fall_pa = self.platform.shutdown_ramp_pa_s * period_s
                longest = round(_LONGEST_WAIT_S / period_s)
                rest.ramp_down(self._paced_cycle, self._sent_pa, fall_pa, 1, longest)
                self._session.bye()
        self._configured = False
        self._session.link.close()

    # -- a cycle -----------------------------------------------------------------------------------

    def _transact(self, setpoint_pa: Array) -> Flags:
        """Send set points and wait for the answer; where it is fresh. A lost connection is a fault."""
        session, fresh, taken = self._session, np.zeros(self.n_chambers, dtype=np.bool_), self._taken
        try:
            if not session.link.is_open:
                self._sent_pa = np.zeros(self.n_chambers)
                if session.link.reconnect():
                    session.greet()  # for the readings; only `configure` gets the board to obey
                return fresh
            self._send_set(setpoint_pa)
            self._wait_for_answer()
        except HardwareError as error:
            self._latch("link_lost", str(error))
            return fresh
        self._lost += not session.is_answered
        # An answer that is some cycles late is a reading all the same; how late is told by its number.
        state, self._taken = session.state, session.state
        if state is not None and state is not taken and session.lag < self.platform.host.stale_cycles:
            for n, port in enumerate(self._ports):
                fresh[n] = not state.ports[port].flags & PortFlag.ADC_ERROR
        return fresh

    def _wait_for_answer(self) -> None:
        session = self._session
        deadline = self.clock() + self._patience_s(self.platform.cycle_budget_s)
        while not session.is_answered and session.refused is None:
            left = deadline - self.clock()
            if left <= 0 or not session.receive(left):
                return

    def _judge(self, fresh: Flags, now_ns: int) -> list[Fault]:
        """Everything that is wrong after a cycle."""
        session, limit_s = self._session, self.platform.host.heartbeat_consumer_s
        state, welcome = session.state, session.welcome
        if session.received != self._heard or self._heard_ns is None:
            self._heard, self._heard_ns = session.received, now_ns
        if welcome is not None and welcome.boot != self._boot:
            self._latch("rebooted", "the board's server has been started anew")
        if session.refused is not None:
            self._latch("command_rejected", f"the board {texts.refusal(session.refused[0])}")
            session.refused = None
        if state is not None and state.cause:
            code, text = texts.CAUSES[state.cause]
            self._latch(code, f"the board {text}{texts.complaints(state)}")
        elif state is not None and fresh.any() and session.is_answered:
            self._compare(state)
        if now_ns - self._heard_ns > limit_s * 1e9:
            self._latch("heartbeat_lost", f"not heard for {limit_s * 1e3:.0f} ms")
        return self._faults(fresh, now_ns)

    def _compare(self, state: State) -> None:
        """The board says what its DACs were given: it must be what was sent."""
        for n, port in enumerate(self._ports):
            applied = state.ports[port].applied_pa
            if abs(applied - self._sent_pa[n]) > self._tolerance_pa[n]:
                text = f"was given {self._sent_pa[n]:.0f} Pa and applies {applied} Pa"
                self._latch("setpoint_ignored", text, self._names[n])

    def _send_set(self, setpoint_pa: Array) -> None:
        values = [0] * len(self.platform.ports)
        allowed = self.platform.range
        for n, port in enumerate(self._ports):
            limited = min(max(float(setpoint_pa[n]), allowed.minimum_pa), allowed.maximum_pa)
            values[port] = round(limited)
            self._sent_pa[n] = values[port]
        self._session.set(values)

    def _paced_cycle(self, setpoint_pa: Array) -> Array:
        """One cycle of the shutdown."""
        next_s = self.clock() + 1.0 / self.platform.cycle_hz
        fresh = self._transact(setpoint_pa)
        while not self.lockstep and (left := next_s - self.clock()) > 0:
            self._session.receive(left)
        return np.where(fresh, self._pressure_pa, np.nan)

    def _drain(self) -> None:
        try:
            if self._session.link.is_open:
                self._session.drain()
        except HardwareError as error:
            self._latch("link_lost", str(error))

    def _on_state(self, state: State) -> None:
        for n, port in enumerate(self._ports):
            reading = state.ports[port]
            if not reading.flags & PortFlag.ADC_ERROR and reading.age_ms != messages.NEVER_MS:
                self._pressure_pa[n] = reading.pressure_pa

    # -- start-up ----------------------------------------------------------------------------------

    def _await(self, look: Callable[[], Answer | None], step: str) -> Answer:
        """Wait for the answer to a step of the start-up."""
        deadline = self.clock() + self.platform.host.start_timeout_s
        while (answer := look()) is None:
            if self._session.refused is not None:
                raise self._failed(texts.refusal(self._session.refused[0]))
            left = deadline - self.clock()
            if left <= 0:
                raise self._failed(f"does not answer {step}")
            self._session.receive(left)
        return answer

    def _failed(self, text: str) -> HardwareError:
        return HardwareError(f"board: start-up: {text}")


def open_driver(
    platform: BoardPlatform, endpoint: str | None, clock: Callable[[], float], lockstep: bool
) -> BoardRegulator:
    """Make the driver of a platform; `endpoint` takes the place of the board's address.

    Raises
    ------
    HardwareError
        If neither names an address.
    """
    link = link_to(endpoint or platform.device, "board", platform.transport.connect_timeout_s, clock)
    return BoardRegulator(platform, link, clock, lockstep)
