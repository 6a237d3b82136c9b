"""The board without sockets: processes bytes of the host, returns the answers, drives the ports."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Sequence

from soro_hardware.board import frames, messages
from soro_hardware.board.config import BoardPlatform
from soro_hardware.board.frames import BoardFrame, FrameType
from soro_hardware.board.messages import Cause, PortState, Refusal
from soro_hardware.board.pi import core
from soro_hardware.board.pi.contact import StopInput
from soro_hardware.board.pi.ports import PortReading, PortReport, Ports

_ANSWERED = (FrameType.SET, FrameType.RESET)
_IDLE_NS = 1_000_000_000  # a new host may replace a host without messages for this time [ns]


class Board:
    """Decisions, ports and frames of one board; `now_ns` is a monotonic time of the caller [ns].

    Parameters
    ----------
    platform : BoardPlatform
        Ports, range and times.
    ports : Ports
        Chips of the ports.
    boot : int
        Number that differs at each start of the server.
    on_report : callable
        Called with the result of every self-test.
    stop : StopInput, optional
        Contact of the emergency stop.

    Attributes
    ----------
    set_points : int
        Number of accepted SETs.
    hang_up : bool
        Whether the connection is to be closed once the answer is sent: the host has sent no greeting, or a
        frame with another number than that of its welcome.
    draw : callable
        Draws the number of a welcome, which nobody can guess.
    """

    def __init__(
        self,
        platform: BoardPlatform,
        ports: Ports,
        boot: int,
        on_report: Callable[[list[PortReport]], None] = lambda reports: None,
        stop: StopInput | None = None,
    ) -> None:
        options, allowed = platform.board, platform.range
        self.rules = core.Rules(
            ports=len(ports),
            minimum_pa=round(allowed.minimum_pa),
            maximum_pa=round(allowed.maximum_pa),
            watchdog_ns=round(options.watchdog_s * 1e9),
            tolerated_errors=options.tolerated_errors,
        )
        self.state = core.initial_state(self.rules)
        self.ports, self.set_points, self.hang_up = ports, 0, False
        self.draw: Callable[[], int] = _draw
        self._boot, self._on_report, self._stop = boot & 0xFFFFFFFF, on_report, stop
        self._watchdog_ms = round(options.watchdog_s * 1e3)
        self._refresh_ns = round(1e9 / options.refresh_hz)
        self._heartbeat_ns = round(options.heartbeat_s * 1e9)
        self._decoder = frames.BoardFrameDecoder(messages.lengths(len(ports)))
        self._readings: list[PortReading] = []
        self._read_ns: list[int | None] = [None] * len(ports)
        self._exchanged_ns = self._sent_ns = 0
        self._admits = options.admits
        self._received_ns: int | None = None  # when the host last sent a frame; None without a host

    @property
    def garbled(self) -> int:
        """Number of byte runs that were no frame."""
        return self._decoder.garbled

    @property
    def next_event_ns(self) -> int:
        """Time [ns] of the next event of `poll`."""
        due = self._exchanged_ns + self._refresh_ns
        if self.state.greeted:
            due = min(due, self._sent_ns + self._heartbeat_ns)
        return due if self.watchdog_ns is None else min(due, self.watchdog_ns)

    @property
    def watchdog_ns(self) -> int | None:
        """Time [ns] at which the watchdog vents; None while it is not armed."""
        return None if self.state.fed_ns is None else self.state.fed_ns + self.rules.watchdog_ns

    def start(self, now_ns: int) -> list[PortReport]:
        """Make the self-test; afterwards every port is at 0 Pa."""
        reports = self._test(now_ns)
        self._exchange(now_ns)
        return reports

    def refuse_host(self, address: str, now_ns: int) -> bytes | None:
        """Return None to accept a host at an IP address, or the bytes sent to a refused one."""
        if not self._admits(address):
            return _refused(Refusal.STRANGER)
        if self._received_ns is not None and now_ns - self._received_ns < _IDLE_NS:
            return _refused(Refusal.BUSY)
        return None

    def host_came(self, now_ns: int) -> None:
        """Process that a host has connected."""
        self._received_ns, self.hang_up = now_ns, False

    def feed(self, chunk: bytes, now_ns: int) -> bytes:
        """Process bytes of the host; return the answer."""
        if self.hang_up:
            return b""
        self.watch(now_ns)
        output, answer, garbled = b"", False, self.garbled
        found = self._decoder.feed(chunk)
        if not self.state.greeted and self.garbled != garbled:
            return self._part(now_ns)  # whatever follows: it may be the body of a web page's request
        for frame in found:
            self.state, why, port = core.receive(self.rules, self.state, frame, now_ns, self.draw())
            if why is not None:
                output += frames.encode(core.refusal(frame, why, port))
                if core.parts(why):
                    return output + self._part(now_ns)
            elif frame.kind is FrameType.HELLO:
                output += frames.encode(self._welcome(frame.sequence))
            elif frame.kind is FrameType.RESET:
                self._test(now_ns)
            self.set_points += why is None and frame.kind is FrameType.SET
            answer = answer or (why is None and frame.kind in _ANSWERED)
            if frame.kind is FrameType.BYE:
                self._exchange(now_ns)
        if answer:  # of several SETs in one chunk, only the newest is applied
            self._exchange(now_ns)
            output += self._report(now_ns)
        if output:
            self._received_ns = now_ns  # invalid bytes do not count as a message
        return output

    def poll(self, now_ns: int) -> bytes:
        """Process the due events (watchdog, refresh of the ports, heartbeat); return bytes for the host."""
        tripped = self.watch(now_ns)
        if now_ns >= self._exchanged_ns + self._refresh_ns:
            self._exchange(now_ns)
        if self.state.greeted and (tripped or now_ns >= self._sent_ns + self._heartbeat_ns):
            return self._report(now_ns)
        return b""

    def watch(self, now_ns: int) -> bool:
        """Look at stop contact and watchdog; return whether the latch has closed, with every port at 0 Pa."""
        before = self.state.cause
        is_pressed = self._stop is not None and self._stop.is_pressed(now_ns)
        self.state = core.watch(self.rules, self.state, now_ns, is_pressed)
        tripped = self.state.cause is not before
        if tripped:
            self._exchange(now_ns)
        return tripped

    def host_gone(self, now_ns: int) -> None:
        """Vent, because the connection has ended."""
        self.state, self._received_ns = core.host_gone(self.state), None
        self._decoder.reset()
        self._exchange(now_ns)

    def stop(self, now_ns: int) -> bytes:
        """Vent at the end of the server; return bytes for the host."""
        self.state = core.latch(self.state, Cause.STOPPING)
        self.ports.vent()
        return self._report(now_ns) if self.state.greeted else b""

    def _part(self, now_ns: int) -> bytes:
        """Vent and ask for the end of the connection; return what a host of another version is told."""
        version = self._decoder.other_version
        self.host_gone(now_ns)
        self.hang_up = True
        return b"" if version is None else _refused(Refusal.VERSION, version)

    def _test(self, now_ns: int) -> list[PortReport]:
        reports = self.ports.self_test()
        self.state = core.tested(self.state, not any(report.error for report in reports))
        self.watch(now_ns)
        self._on_report(reports)
        return reports

    def _exchange(self, now_ns: int) -> None:
        self._exchanged_ns = now_ns
        self._readings = self.ports.exchange(self.state.setpoint_pa)
        for port, reading in enumerate(self._readings):
            if reading.pressure_pa is not None:
                self._read_ns[port] = now_ns
        before = self.state.cause
        self.state = core.judge(self.rules, self.state, [reading.flags for reading in self._readings])
        if self.state.cause is not before:
            self.ports.vent()

    def _welcome(self, sequence: int) -> BoardFrame:
        limits = ((self.rules.minimum_pa, self.rules.maximum_pa),) * self.rules.ports
        welcome = messages.Welcome(self._boot, self._watchdog_ms, limits)
        return BoardFrame(FrameType.WELCOME, sequence, messages.pack_welcome(welcome), self.state.number)

    def _report(self, now_ns: int) -> bytes:
        self._sent_ns = now_ns
        state = messages.StateMessage(
            time_us=now_ns // 1000,
            armed=self.state.fed_ns is not None,
            cause=self.state.cause,
            garbled=self.garbled,
            ports=tuple(map(self._port, self._readings, self._read_ns, [now_ns] * self.rules.ports)),
        )
        return frames.encode(BoardFrame(FrameType.STATE, self.state.sequence, messages.pack_state(state)))

    def _port(self, reading: PortReading, read_ns: int | None, now_ns: int) -> PortState:
        age_ms = messages.NEVER_MS if read_ns is None else (now_ns - read_ns) // 1_000_000
        pressure = 0 if reading.pressure_pa is None else round(reading.pressure_pa)
        return PortState(round(reading.applied_pa), pressure, reading.flags, age_ms)


def _draw() -> int:
    return 1 + secrets.randbelow(2**64 - 1)


def _refused(why: Refusal, version: int = frames.VERSION) -> bytes:
    return frames.encode(BoardFrame(FrameType.REFUSED, 0, messages.pack_refused(why)), version)


def describe(reports: Sequence[PortReport]) -> list[str]:
    """Return the lines of a self-test report."""
    lines = []
    for report in reports:
        pressure = "" if report.pressure_pa is None else f"{report.pressure_pa / 1e3:.1f} kPa"
        text = report.error or ", ".join(part for part in (pressure, report.warning) if part)
        lines.append(f"port {report.port}: {'FAILED, ' if report.error else 'ok, '}{text}")
    return lines
