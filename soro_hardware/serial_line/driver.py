"""Driver for regulators on serial text lines, for both dialects.

These devices are slow (an ITV takes 23 ms for a set point and a reading at 9600 baud) and have no watchdog.
So `exchange` never waits longer than `cycle_budget_s` for an answer: it takes what has come, sends what is
due, and says in `fresh` which chambers were sampled since the last one. Because a device whose host dies
keeps its pressure, a supervisor process lives beside the driver (`soro_hardware.supervisor`); an arm on
these families needs a normally open dump valve besides.
"""

from __future__ import annotations

import contextlib
import select
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import HardwareError
from soro_hardware.driver import Driver
from soro_hardware.finding import Finding
from soro_hardware.port import Fault
from soro_hardware.serial_line.config import SerialPlatform
from soro_hardware.serial_line.line.channel import Channel
from soro_hardware.serial_line.line.engine import LineEngine
from soro_hardware.serial_line.line.port import BytePort
from soro_hardware.serial_line.line.session import StartupSession
from soro_hardware.serial_line.lockstep import MARK, START_MARK, LockstepPort
from soro_hardware.serial_line.probe import examine
from soro_hardware.serial_line.start_up import plan_of, start_all
from soro_hardware.supervisor_client import VentPlan

_LONGEST_WAIT_S = 1.0  # for an empty arm, at the end
_REOPEN_NS = 50_000_000  # between attempts to open lost ports


class SerialRegulator(Driver[SerialPlatform]):
    """Regulators of one arm on one or more serial lines.

    Parameters
    ----------
    platform : SerialPlatform
        Valves, range and times.
    open_ports : callable
        Opens the ports, in the order of the lines; called by `configure`.
    clock : callable
        Monotonic time [s].
    lockstep : bool
        The devices' time advances with the exchanges only.
    """

    device_watchdog = False
    rest_s = (0.0, 0.0)  # `find_empty` waits

    def __init__(
        self,
        platform: SerialPlatform,
        open_ports: Callable[[], Sequence[BytePort]],
        clock: Callable[[], float],
        lockstep: bool = False,
    ) -> None:
        super().__init__(platform, platform.line, clock, lockstep)
        self.kind = platform.family
        self._open_ports = open_ports
        self._period_ns = round(1e9 / platform.cycle_hz)
        self._line_ns = self._last_ns = 0
        self._ports: list[BytePort] = []
        self._engines: list[LineEngine] = []
        self._channels: list[Channel] = []
        self._closed_counts: Counter[str] = Counter()
        self.vent_plans: list[VentPlan] = []

    # -- what a dialect gives ----------------------------------------------------------------------

    @abstractmethod
    def make_lines(self, ports: Sequence[BytePort]) -> list[LineEngine]:
        """Engines with their channels; the channels in the order of the platform's valves."""

    def stop_streaming(self, session: StartupSession) -> None:
        """Stop devices on a line that send without a request."""

    # -- the driver's hooks ------------------------------------------------------------------------

    def counts(self) -> Mapping[str, int]:
        counts = self._closed_counts + self._counts()
        kinds = ("sent", "received", "lost", "late", "garbled", "refused")
        return {f"frames_{kind}": counts[kind] for kind in kinds}

    @property
    def reading_age_s(self) -> float:
        return 1.0 / self.update_hz + self.platform.line.patience_s

    def probe(self) -> Iterator[Finding]:
        return examine(self.platform, self._open_ports, self.make_lines, self.stop_streaming, self.clock)

    def start_up(self) -> None:
        self._close_ports()
        self._ports = [LockstepPort(port) if self.lockstep else port for port in self._open_ports()]
        self.supervise()
        self.share()  # the former plan, while the devices start again
        self._closed_counts += self._counts()
        self._engines = self.make_lines(self._ports)
        by_name = {channel.chamber: channel for engine in self._engines for channel in engine.channels}
        before, self._channels = self._channels, [by_name[name] for name in self._names]
        self._sources = tuple(channel.source for channel in self._channels)
        for channel in self._channels:
            channel.latched = self.latch
        for channel, old in zip(self._channels, before, strict=False):
            channel.remember(old)
        try:
            start_all(self._engines, self, self.stop_streaming, self.platform.line)
        finally:  # after a failure too: what has been found so far is vented if this process dies
            self.vent_plans = [plan_of(engine, self.platform) for engine in self._engines]
            self.share()
        self._last_ns = now_ns = self.now_ns()
        for channel in self._channels:
            channel.restart(now_ns)
        self._take()

    def transfer(self, setpoint_pa: Array, is_vent: bool) -> Flags:
        dt = self._since_last()
        for channel, target in zip(self._channels, setpoint_pa.tolist(), strict=True):
            channel.fresh = False
            channel.vent() if is_vent else channel.follow(target, dt)
        self._cycle()
        self._now_ns = self.now_ns()
        self._take()
        return np.array([channel.fresh for channel in self._channels])

    def judge(self) -> Iterable[Fault]:
        return [fault for channel in self._channels for fault in channel.device_faults()]

    def send_zeros(self) -> None:
        if not self._engines:
            return
        for channel in self._channels:
            channel.vent()
        if self.lockstep:  # a tick is all that a call may take; the caller repeats
            self._drive()
            with contextlib.suppress(HardwareError):
                self._tick()
        else:
            end_ns = self.now_ns() + round(1e9 * self.platform.line.vent_s)
            self._drive_until(lambda channel: channel.at_zero or channel.is_silent, end_ns)
        self._take()

    def on_lost(self, error: HardwareError) -> None:
        raise error

    def is_pressed(self, setpoint_pa: Array) -> bool:
        return bool(setpoint_pa.any()) or not all(channel.at_zero for channel in self._channels)

    def find_empty(self) -> bool:
        was_empty = {channel.chamber for channel in self._channels if channel.is_empty}
        end_ns = self.now_ns() + round(1e9 * _LONGEST_WAIT_S)
        lost = []
        for _ in range(2):  # another host may give a valve pressure while the others are read
            for channel in self._channels:
                channel.vent()
                channel.doubt()
            lost = self._drive_until(lambda channel: channel.is_empty, end_ns)
        # Behind a lost port only the last reading is known.
        known = was_empty.intersection(channel.chamber for engine in lost for channel in engine.channels)
        return all(c.is_empty or c.chamber in known for c in self._channels)

    def after_test(self) -> None:
        for engine in self._engines:
            engine.discard(self.now_ns())

    def disconnect(self) -> None:
        self._close_ports()

    # -- for start-up ------------------------------------------------------------------------------

    def now_ns(self) -> int:
        """Time of the lines: the clock's, or in lockstep the devices'."""
        return self._line_ns if self.lockstep else round(self.clock() * 1e9)

    def wait(self, timeout_s: float) -> None:
        """Wait until bytes arrive; in lockstep for one cycle."""
        if self.lockstep:
            self._tick(START_MARK)
        else:
            self._await_bytes(self._engines, timeout_s)

    # -- a cycle -----------------------------------------------------------------------------------

    def _cycle(self) -> None:
        """Advance the lines for a cycle; raise the error of a lost line after the others have had theirs."""
        lost = self._drive()
        if self.lockstep and not lost:
            self._tick()
            for engine in self._engines:
                engine.receive(self.now_ns())
        end_s = self.clock() + self.platform.cycle_budget_s
        while not self.lockstep and (left_s := end_s - self.clock()) > 0:
            self._await_bytes([engine for engine in self._engines if engine not in lost], left_s)
            lost = {engine: lost.get(engine, error) for engine, error in self._drive().items()}
        for error in lost.values():
            raise error

    def _since_last(self) -> float:
        """Return the time since the last cycle [s], at most two periods: no jump follows a pause."""
        # In lockstep the time advances at the end of a cycle.
        now_ns = self.now_ns() + (self._period_ns if self.lockstep else 0)
        dt_ns, self._last_ns = now_ns - self._last_ns, now_ns
        return min(dt_ns, 2 * self._period_ns) * 1e-9

    def _tick(self, mark: bytes = MARK) -> None:
        ports = [port for port in self._ports if isinstance(port, LockstepPort)]
        for port in ports:
            port.end_cycle(mark)
        for port in ports:
            port.await_cycle(self.platform.lockstep_timeout_s, self.clock)
        self._line_ns += self._period_ns

    def _await_bytes(self, engines: Sequence[LineEngine], timeout_s: float) -> None:
        """Wait for bytes, at most `timeout_s` [s]; without a port for the whole time."""
        descriptors = [engine.port.fileno() for engine in engines]
        # A lost port is readable at once; the next read raises its error.
        select.select([number for number in descriptors if number >= 0], [], [], max(timeout_s, 0.0))

    def _drive_until(self, is_done: Callable[[Channel], bool], end_ns: int) -> list[LineEngine]:
        """Advance the lines until a condition holds for all readable channels; return the lost lines."""
        while True:
            lost = self._drive()
            working = [engine for engine in self._engines if engine not in lost]
            is_over = all(is_done(c) for engine in working for c in engine.channels if c.is_known)
            left_s = (end_ns - self.now_ns()) * 1e-9
            self._watched(np.zeros(self.n_chambers))
            if is_over or left_s <= 0:
                return list(lost)
            try:
                self._tick() if self.lockstep else self._await_bytes(working, min(left_s, 0.005))
            except HardwareError:
                return self._engines

    def _drive(self) -> dict[LineEngine, HardwareError]:
        """Advance the lines and try to reopen lost ones; return those that stay lost, with their errors."""
        lost = {}
        for engine in self._engines:
            self.require_watch()
            try:
                engine.advance(self.now_ns())
            except HardwareError as error:
                if not engine.reopen(self.now_ns(), 0 if self.lockstep else _REOPEN_NS):
                    lost[engine] = error
                    continue
                with contextlib.suppress(HardwareError):  # the driver reports a lost supervisor elsewhere
                    self.share()
        return lost

    def share(self) -> None:
        """Share the ports with the supervisor, once the messages for a vent are known."""
        if self.supervisor is not None and self.vent_plans:
            there = [n for n, port in enumerate(self._ports) if port.fileno() >= 0]
            plan = [self.vent_plans[n] for n in there]
            self.supervisor.hold(plan, [self._ports[n].fileno() for n in there])

    def _close_ports(self) -> None:
        """Close the ports; the lines stay until the next start-up replaces them."""
        if self.supervisor is not None:
            self.supervisor.release()
        for port in self._ports:
            port.close()

    def _counts(self) -> Counter[str]:
        return sum((engine.counts for engine in self._engines), Counter())

    def _take(self) -> None:
        self.sent_pa = np.array([channel.setpoint.sent_pa for channel in self._channels])
        self.pressure_pa = np.array([channel.pressure_pa for channel in self._channels])

    def _late(self, fresh: Flags) -> list[Fault]:
        """A device that answers nothing at all is `device_silent`, and not late besides."""
        codes = [("device_silent", channel.source) in self.latch for channel in self._channels]
        return super()._late(fresh | np.array(codes))
