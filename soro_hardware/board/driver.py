"""Driver of a board that runs `soro board`: one SET and one STATE in each cycle.

The board vents by itself when its host dies, so the driver only reports faults.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import HardwareError
from soro_hardware.board import frames, messages, texts
from soro_hardware.board.config import BoardPlatform
from soro_hardware.board.messages import Cause, PortFlag, StateMessage
from soro_hardware.board.session import BoardSession
from soro_hardware.finding import Finding, run_check
from soro_hardware.link_driver import LinkDriver
from soro_hardware.port import Fault
from soro_hardware.transport.tcp import ByteLink

Answer = TypeVar("Answer")


class BoardRegulator(LinkDriver[BoardPlatform]):
    """Regulators of one arm behind one board.

    Parameters
    ----------
    platform : BoardPlatform
        Ports, range and times.
    link : ByteLink
        Connection to the board; `configure` opens it.
    clock, lockstep : callable, bool
        As in `Driver`.
    """

    source, kind = "board", "board"
    device_watchdog = True

    def __init__(
        self, platform: BoardPlatform, link: ByteLink, clock: Callable[[], float], lockstep: bool = False
    ) -> None:
        super().__init__(platform, platform.host, link, clock, lockstep)
        self._ports = [valve.port for valve in platform.valves]
        self._session = self.traffic = BoardSession(link, len(platform.ports))
        # The applied set point may differ by one count of the DAC.
        self._tolerance_pa = np.array([1.0 + platform.resolution_pa(port) for port in self._ports])
        self._boot: int | None = None
        self._taken: StateMessage | None = None  # newest state of an earlier cycle
        self._received = 0  # frames up to the last cycle
        self._received_ns: int | None = None

    def probe(self) -> Iterator[Finding]:
        return examine(self.platform, self._session, self.clock)

    def start_up(self) -> None:
        session, self._boot, self._received_ns = self._session, None, None
        self.link.open()
        self.connected()
        welcome = self._await(lambda: session.welcome, "HELLO")
        allowed = (round(self.platform.range.minimum_pa), round(self.platform.range.maximum_pa))
        for number in self._ports:
            if welcome.limits_pa[number] != allowed:
                raise self._failed(
                    f"port {number} is limited to {welcome.limits_pa[number]} Pa, not {allowed}"
                )
        self._boot = welcome.boot
        self._reset()

    def _reset(self) -> None:
        session = self._session
        session.reset()
        state = self._await(lambda: session.state if session.is_answered else None, "RESET")
        if state.cause:
            raise self._failed(f"{texts.CAUSES[state.cause][1]}{texts.complaints(state)}")
        self._take(state)
        self.sent_pa = np.zeros(self.n_chambers)

    def test_watchdogs(self) -> None:
        session = self._session
        self._set(np.zeros(self.n_chambers))
        watchdog_s = 0.0 if session.welcome is None else session.welcome.watchdog_ms * 1e-3
        limit_s = watchdog_s + self.platform.host.start_timeout_s
        end_s = self.clock() + limit_s
        while session.state is None or not session.state.cause:
            if (left_s := end_s - self.clock()) <= 0:
                raise self._failed(f"test at 0 Pa: its watchdog has not vented in {limit_s:g} s of silence")
            session.receive(left_s)
        self._reset()

    def connected(self) -> None:
        self._session.greet()  # after a lost connection, for the readings: set points need `configure`

    def send_and_receive(self, setpoint_pa: Array) -> Flags | bool:
        session = self._session
        if not self._closed:  # at the end wait for every answer
            session.drain()
        deadline = self.clock() + self.patience_s(self.platform.cycle_budget_s)
        self._receive_until(lambda: session.welcome is not None, deadline)  # of a new connection
        self._set(setpoint_pa)
        self._receive_until(lambda: session.is_answered, deadline)
        self.answers_lost += not session.is_answered
        # An answer that is some cycles late is still a reading; its sequence number shows the delay.
        state, taken, self._taken = session.state, self._taken, session.state
        if state is None or state is taken:
            return False
        if session.is_answered and not state.cause:
            self._compare(state)
        return self._take(state) & (session.lag < self.platform.host.stale_cycles)

    def judge(self) -> Iterable[Fault]:
        session, limit_s = self._session, self.platform.host.heartbeat_consumer_s
        state, welcome = session.state, session.welcome
        if session.received != self._received or self._received_ns is None:
            self._received, self._received_ns = session.received, self._now_ns
        if welcome is not None and welcome.boot != self._boot:
            self.latch.add("rebooted", self.source, "the server of the board has restarted")
        if session.refusal is not None:
            text = f"the board {texts.refusal(session.refusal[0])}"
            self.latch.add("command_rejected", self.source, text)
            session.refusal = None
        if state is not None and state.cause:
            code, text = texts.CAUSES[state.cause]
            self.latch.add(code, self.source, f"the board {text}{texts.complaints(state)}")
        if self._now_ns - self._received_ns > limit_s * 1e9:
            self.latch.add("heartbeat_lost", self.source, f"no frame for {limit_s * 1e3:.0f} ms")
        return ()

    def post_zeros(self) -> None:
        self._session.drain()
        self._set(np.zeros(self.n_chambers))

    def wait(self, duration_s: float) -> None:
        self._session.receive(duration_s)

    def shut_down(self, is_empty: bool) -> None:
        self._session.bye()

    def _receive_until(self, has_come: Callable[[], bool], deadline_s: float) -> None:
        """Receive until a frame or a refusal has come, at most until a time of the clock [s]."""
        session = self._session
        while not has_come() and session.refusal is None:
            left = deadline_s - self.clock()
            if left <= 0 or not session.receive(left):
                break

    def _set(self, setpoint_pa: Array) -> None:
        values = [0] * len(self.platform.ports)
        for port, value in zip(self._ports, setpoint_pa.tolist(), strict=True):
            values[port] = round(value)
        self.sent_pa = np.array([values[port] for port in self._ports], dtype=np.float64)
        self._session.set(values)

    def _take(self, state: StateMessage) -> Flags:
        """Process the readings of a state; return which chambers (n,) have one."""
        readings = [state.ports[port] for port in self._ports]
        works = np.array([not reading.flags & PortFlag.ADC_ERROR for reading in readings])
        known = works & np.array([reading.age_ms != messages.NEVER_MS for reading in readings])
        self.pressure_pa = np.where(known, [reading.pressure_pa for reading in readings], self.pressure_pa)
        return works

    def _compare(self, state: StateMessage) -> None:
        """Compare the applied set points of the board with the sent ones."""
        applied_pa = np.array([state.ports[port].applied_pa for port in self._ports], dtype=np.float64)
        for n in map(int, np.flatnonzero(np.abs(applied_pa - self.sent_pa) > self._tolerance_pa)):
            text = f"was given {self.sent_pa[n]:.0f} Pa and applies {applied_pa[n]:.0f} Pa"
            self.latch.add("setpoint_ignored", self._names[n], text)

    # -- start-up ----------------------------------------------------------------------------------

    def _await(self, find: Callable[[], Answer | None], step: str) -> Answer:
        """Wait for the answer to a step of the start-up."""
        deadline = self.clock() + self.platform.host.start_timeout_s
        while (answer := find()) is None:
            if self._session.refusal is not None:
                raise self._failed(texts.refusal(self._session.refusal[0]))
            left = deadline - self.clock()
            if left <= 0:
                raise self._failed(texts.SILENT if step == "HELLO" else f"does not answer {step}", "silent")
            self._session.receive(left)
        return answer

    def _failed(self, text: str, code: str = "refused") -> HardwareError:
        return HardwareError(text, "board", code, "start-up")


open_driver = BoardRegulator.over_tcp


def examine(platform: BoardPlatform, session: BoardSession, clock: Callable[[], float]) -> Iterator[Finding]:
    """Send HELLO to the board, read its answer, and disconnect; yields findings.

    Parameters
    ----------
    platform : BoardPlatform
        Ports, range and times.
    session : BoardSession
        Frames of the driver.
    clock : callable
        Returns a monotonic time [s].
    """
    advice = "start `soro board` on the Pi; check address, port and cable"
    return run_check("board", advice, _greet(platform, session, clock), session.link.close)


def _greet(platform: BoardPlatform, session: BoardSession, clock: Callable[[], float]) -> Iterator[Finding]:
    session.link.open()
    session.greet()
    deadline = clock() + platform.host.start_timeout_s
    while (session.welcome is None or session.state is None) and session.refusal is None:
        if (left := deadline - clock()) <= 0:
            advice = (
                f"install the same version of soro on the Pi (frames {frames.VERSION}); "
                "use family veab_tcp for the published server, or another port"
            )
            yield Finding("board", "fail", "the server does not send frames of soro board", advice)
            return
        session.receive(left)
    if session.refusal is not None or session.welcome is None or session.state is None:
        code = 0 if session.refusal is None else session.refusal[0]
        yield Finding("board", "fail", f"it {texts.refusal(code)}", texts.advice(code))
        return
    welcome, state = session.welcome, session.state
    known = f"boot {welcome.boot:08x}, {len(welcome.limits_pa)} ports, watchdog {welcome.watchdog_ms} ms"
    yield Finding("board", "ok", known)
    low, high = round(platform.range.minimum_pa), round(platform.range.maximum_pa)
    other = [valve.port for valve in platform.valves if welcome.limits_pa[valve.port] != (low, high)]
    if other:
        lowest, highest = welcome.limits_pa[other[0]]
        found = f"port {other[0]}: {lowest / 1e3:g} to {highest / 1e3:g} kPa on the board"
        yield Finding(
            "range on the board", "fail", found, "give the Pi the same platform file and restart it"
        )
    if state.cause is Cause.STOP_CONTACT:
        advice = "release the emergency stop; if it is, look for a broken wire of its contact"
        yield Finding("stop contact", "warn", f"the board {texts.CAUSES[state.cause][1]}", advice)
    if complaints := texts.complaints(state):
        advice = "check the chips' power, address and bus: `soro board CONFIG --check` on the Pi"
        yield Finding("chips", "warn", complaints.strip(" ()"), advice)
