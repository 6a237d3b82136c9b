"""Driver for regulators on serial text lines, for both dialects.

These devices are slow (an ITV takes 23 ms for a set point and a reading at 9600 baud) and have no watchdog.
So `exchange` never waits longer than `cycle_budget_s` for an answer: it takes what has come, sends what is
due, and says in `fresh` which chambers were sampled since the last one. Because a device whose host dies
keeps its pressure, a supervisor process lives beside the driver (`soro_core.hardware.supervisor`); an arm on
these families needs a normally open dump valve besides.
"""

from __future__ import annotations

import contextlib
import select
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.driver_base import DriverBase
from soro_core.hardware.finding import Finding
from soro_core.hardware.port import Array, BusStatistics, Exchange, Fault
from soro_core.hardware.rest import ramp_down
from soro_core.hardware.serial_line.channel import Channel
from soro_core.hardware.serial_line.config import SerialPlatform
from soro_core.hardware.serial_line.engine import LineEngine
from soro_core.hardware.serial_line.lockstep import MARK, START_MARK, LockstepPort
from soro_core.hardware.serial_line.port import BytePort
from soro_core.hardware.serial_line.probe import look
from soro_core.hardware.serial_line.session import Session
from soro_core.hardware.supervisor_client import LOST, Supervisor, VentPlan, running

LONGEST_WAIT_S = 1.0
_BOOTED_S = 0.2  # for devices that must have booted
_ROUNDS = 20  # of the supervisor, while nothing confirms


class SerialRegulator(DriverBase[SerialPlatform]):
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

    def __init__(
        self,
        platform: SerialPlatform,
        open_ports: Callable[[], Sequence[BytePort]],
        clock: Callable[[], float],
        lockstep: bool = False,
    ) -> None:
        super().__init__(platform, clock, lockstep)
        self._open_ports = open_ports
        self._period_ns = round(1e9 / platform.cycle_hz)
        self._line_ns = 0
        self._ports: list[BytePort] = []
        self._engines: list[LineEngine] = []
        self._channels: list[Channel] = []
        self._closed_counts: Counter[str] = Counter()
        self._last_ns = 0
        self._supervisor: Supervisor | None = None
        self._vent_plan: list[VentPlan] = []

    # -- what a dialect gives ----------------------------------------------------------------------

    @abstractmethod
    def make_lines(self, ports: Sequence[BytePort]) -> list[LineEngine]:
        """Engines with their channels; the channels in the order of the platform's valves."""

    def calm(self, session: Session) -> None:
        """Stop devices on a line that send without being asked."""

    # -- the port ----------------------------------------------------------------------------------

    @property
    def statistics(self) -> BusStatistics:
        counts = self._closed_counts + self._counts()
        kinds = ("sent", "received", "lost", "late", "garbled", "refused")
        return BusStatistics(self._cycles, **{f"frames_{kind}": counts[kind] for kind in kinds})

    @property
    def reading_age_s(self) -> float:
        return 1.0 / self.update_hz + self.platform.line.patience_s

    @property
    def latched(self) -> tuple[Fault, ...]:
        """Faults that only `configure` clears."""
        return tuple(fault for channel in self._channels for fault in channel.latched.values())

    def probe(self) -> Iterator[Finding]:
        return look(self.platform, self._open_ports, self.make_lines, self.calm, self.clock)

    def configure(self) -> None:
        self._begin()
        self._close_ports()
        ports = self._open_ports()
        if self.platform.line.supervisor and not self.lockstep:
            self._supervisor = running(self._supervisor)  # it gets ready while the devices start
        self._ports = [LockstepPort(port) if self.lockstep else port for port in ports]
        self._share()  # as it was before, while the devices start anew
        self._engines = self.make_lines(self._ports)
        by_name = {channel.chamber: channel for engine in self._engines for channel in engine.channels}
        self._channels = [by_name[name] for name in self._names]
        self._start_devices()
        self._vent_plan = [self._plan_of(engine) for engine in self._engines]
        self._share()
        self._last_ns = now_ns = self.now_ns()
        for channel in self._channels:
            channel.restart(now_ns)
        self._configured = True

    def exchange(self, setpoint_pa: Array, now_ns: int) -> Exchange:
        setpoint, refused = self._checked(setpoint_pa)
        dt = self._since_last()
        lost = [] if self._watched() else [LOST]
        for channel, target in zip(self._channels, setpoint.tolist(), strict=True):
            channel.fresh = False
            channel.vent() if refused or lost or self.latched else channel.follow(target, dt)
        self._cycle()
        faults = [fault for channel in self._channels for fault in channel.faults(self.now_ns())]
        return Exchange(
            sent_pa=np.array([channel.sent_pa for channel in self._channels]),
            pressure_pa=np.array([channel.pressure_pa for channel in self._channels]),
            fresh=np.array([channel.fresh for channel in self._channels]),
            faults=(*refused, *lost, *faults),
        )

    def vent(self) -> None:
        # A line whose start-up has failed is not known well enough to be spoken to.
        engines = [engine for engine in self._engines if all(c.started for c in engine.channels)]
        if not engines:
            return
        for channel in self._channels:
            channel.vent()
        end_s = self.clock() + self.platform.line.vent_s
        while True:
            working = [engine for engine in engines if self._advanced(engine)]
            if self.lockstep:  # a tick is all that a call may take; the caller repeats
                with contextlib.suppress(HardwareError):
                    self._tick()
                return
            left_s = end_s - self.clock()
            self._watched()
            if left_s <= 0 or all(c.at_zero or not c.urgent for e in working for c in e.channels):
                return
            self._await_bytes(working, min(left_s, 0.005))

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        if self._configured:
            with contextlib.suppress(HardwareError):
                self._bring_down()
            self.vent()
        self._configured = False
        if self._supervisor is not None:  # before the ports are closed, which has it let them go
            self._supervisor.dismiss(all(channel.at_zero for channel in self._channels))
        self._close_ports()

    # -- for start-up ------------------------------------------------------------------------------

    def now_ns(self) -> int:
        """Time of the lines: the clock's, or in lockstep the devices'."""
        return self._line_ns if self.lockstep else round(self.clock() * 1e9)

    def wait(self, timeout_s: float) -> None:
        """Let time pass until bytes come; in lockstep one cycle."""
        if self.lockstep:
            self._tick(START_MARK)
        else:
            self._await_bytes(self._engines, timeout_s)

    def _start_devices(self) -> None:
        """Start all: one that does not is no reason to leave the others at the pressure that they have."""
        boot_s, failed = self.platform.line.boot_timeout_s, None
        for engine in self._engines:
            try:
                self.calm(Session(engine, self, engine.port.name, self.platform.line))
            except HardwareError as error:
                failed = failed or error
            for channel in engine.channels:
                session = Session(engine, self, channel.source, self.platform.line)
                try:
                    session.wait_for_boot(channel.wake, boot_s)
                    channel.start(session)
                except HardwareError as error:
                    failed, boot_s = failed or error, _BOOTED_S  # by now the others have had their time
            with contextlib.suppress(HardwareError):  # a port that is gone has said so
                engine.discard(self.now_ns())
        if failed is not None:
            raise failed

    # -- a cycle -----------------------------------------------------------------------------------

    def _cycle(self) -> None:
        for engine in self._engines:
            self._advance(engine)
        if self.lockstep:
            self._tick()
            for engine in self._engines:
                engine.receive(self.now_ns())
            return
        end_s = self.clock() + self.platform.cycle_budget_s
        while (left_s := end_s - self.clock()) > 0:
            self._await_bytes(self._engines, left_s)
            for engine in self._engines:
                self._advance(engine)

    def _since_last(self) -> float:
        """Time since the last cycle [s], at most two periods: a pause is no licence to jump."""
        # In lockstep a cycle's time comes at its end.
        now_ns = self.now_ns() + (self._period_ns if self.lockstep else 0)
        dt_ns, self._last_ns = now_ns - self._last_ns, now_ns
        return min(dt_ns, 2 * self._period_ns) * 1e-9

    def _advance(self, engine: LineEngine) -> None:
        engine.receive(self.now_ns())
        engine.send(self.now_ns())

    def _tick(self, mark: bytes = MARK) -> None:
        ports = [port for port in self._ports if isinstance(port, LockstepPort)]
        for port in ports:
            port.end_cycle(mark)
        for port in ports:
            port.await_cycle(self.platform.lockstep_timeout_s, self.clock)
        self._line_ns += self._period_ns

    def _await_bytes(self, engines: Sequence[LineEngine], timeout_s: float) -> None:
        """Wait for bytes, at most so long; also when there is no port to wait for."""
        descriptors = [engine.port.fileno() for engine in engines]
        # A port that has gone is readable at once; the next read says so.
        select.select([number for number in descriptors if number >= 0], [], [], max(timeout_s, 0.0))

    def _bring_down(self) -> None:
        """Ramp to 0 from what was sent, then wait for the pressure to go; bounded in time."""
        sent = np.array([0.0 if self.latched else channel.sent_pa for channel in self._channels])
        fall_pa = self.platform.shutdown_ramp_pa_s * self._period_ns * 1e-9
        ramp_down(self._rest_cycle, sent, fall_pa, 1, round(LONGEST_WAIT_S * 1e9 / self._period_ns))

    def _watched(self) -> bool:
        """Tell the supervisor whether it would have to vent; false if it has gone."""
        rests = all(channel.at_zero for channel in self._channels)
        return self._supervisor is None or self._supervisor.watches(not rests)

    def _rest_cycle(self, setpoint_pa: Array) -> Array:
        """One cycle of the shutdown, paced; pressures, NaN while a device has not confirmed 0."""
        start_ns, dt = self.now_ns(), self._since_last()
        for channel, target in zip(self._channels, setpoint_pa.tolist(), strict=True):
            channel.follow(target, dt)
        self._watched()
        self._cycle()
        left_s = (start_ns + self._period_ns - self.now_ns()) * 1e-9
        if not self.lockstep and left_s > 0:
            select.select([], [], [], left_s)
        return np.array([channel.pressure_pa if channel.at_zero else np.nan for channel in self._channels])

    def _share(self) -> None:
        """Share the ports with the supervisor; before the first start-up it would not know what to send."""
        if self._supervisor is not None and self._vent_plan:
            self._supervisor.hold(self._vent_plan, [port.fileno() for port in self._ports])

    def _close_ports(self) -> None:
        self._closed_counts += self._counts()
        self._engines = []
        if self._supervisor is not None:
            self._supervisor.let_go()
        ports, self._ports = self._ports, []
        for port in ports:
            port.close()

    def _counts(self) -> Counter[str]:
        return sum((engine.counts for engine in self._engines), Counter())

    def _plan_of(self, engine: LineEngine) -> VentPlan:
        """What the supervisor is to do on a line; all of it some twenty times."""
        steps = tuple(step for channel in engine.channels for step in channel.vent_steps())
        # Shorter than the driver's own patience: what is not confirmed is sent again at once.
        timeout_s = min(self.platform.line.answer_timeout_s, 0.03 + 400 / self.platform.baud)
        longest_s = _ROUNDS * timeout_s * len(steps)
        return VentPlan(engine.port.name, steps, timeout_s, longest_s, begin="\r\n")

    def _advanced(self, engine: LineEngine) -> bool:
        """Advance a line that may have gone; whether it has not."""
        try:
            self._advance(engine)
        except HardwareError:
            return False
        return True
