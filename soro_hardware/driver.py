"""The common driver of all families: cycle, vent, start-up and end.

A family derives its driver from `Driver`, or from `LinkDriver` for devices behind one TCP connection, and
implements the hooks. The supervisor is the process that vents when the driver dies.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from typing import ClassVar, Generic, TypeVar

import numpy as np

from soro_core.arrays import Array, Flags
from soro_core.errors import HardwareError
from soro_hardware.latch import Latch, Lateness
from soro_hardware.platform import PlatformBase, ReadingAge
from soro_hardware.port import EMPTY_PA, BusStatistics, Exchange, Fault, Regulator
from soro_hardware.supervisor import SILENCE_S
from soro_hardware.supervisor_client import Supervisor, TakenOverError, end, running

P = TypeVar("P", bound=PlatformBase)

_TEST_S = 5.0  # longest time for the vent in the test of the supervisor
LOST = "supervisor_lost", "supervisor"  # code and source of the fault


class Driver(Regulator, Generic[P]):
    """Driver of one arm.

    Parameters
    ----------
    platform : PlatformBase
        Valves, range and times.
    times : ReadingAge
        Limits of the age of a reading.
    clock : callable
        Returns a monotonic time [s].
    lockstep : bool
        Whether the cycles advance the time of the devices: wait for every answer, not for the clock.

    Attributes
    ----------
    source : str
        Source of faults that concern no single chamber.
    answers_together : bool
        Whether one answer has all readings, so that equally late chambers are one fault.
    kind : str
        Name of the devices in messages.
    empty_pa : float
        Pressure [Pa] below which a chamber counts as empty for `seen_empty`.
    rest_s : tuple of float
        Shortest and longest time [s] at 0 Pa before the end.
    latch : Latch
        Faults that stay until the next start-up.
    sent_pa, pressure_pa : ndarray (n,)
        Last sent set points, and newest readings [Pa gauge]; a family replaces both.
    answers_lost : int
        Number of answers missing at the end of their cycle; a family counts them.
    seen_empty : bool
        Whether 0 Pa is commanded and readings since then have shown every chamber empty.
    supervisor : Supervisor or None
        Process that vents when the driver dies.
    """

    source: ClassVar[str] = "device"
    answers_together: ClassVar[bool] = False
    kind: str = "device"
    empty_pa: float = EMPTY_PA
    rest_s: tuple[float, float] = (0.0, 1.0)

    def __init__(
        self, platform: P, times: ReadingAge, clock: Callable[[], float], lockstep: bool = False
    ) -> None:
        self.platform, self.clock, self.lockstep = platform, clock, lockstep
        self.latch = Latch()
        self.supervisor: Supervisor | None = None
        self._names = platform.chamber_names
        self._lateness = Lateness(times, self.n_chambers)
        self.sent_pa: Array = np.zeros(self.n_chambers)
        self.pressure_pa: Array = np.full(self.n_chambers, np.nan)
        self.seen_empty = False
        self._sources: tuple[str, ...] = self._names  # what faults call the chambers
        self._started = self._configured = self._closed = False
        self._is_tested = False  # whether the watchdogs have vented in the test of the first start
        self._presses = False  # whether set points other than 0 are on their way
        self._watched_s = 0.0  # time of the last report to the supervisor
        self._cycles = self._now_ns = self.answers_lost = 0
        # One thread owns a driver; some families keep their devices alive by a second one.
        self._lock = threading.RLock()

    # -- hooks of the families ---------------------------------------------------------------------

    @abstractmethod
    def start_up(self) -> None:
        """Open the connection, start every device and bring it to 0 Pa; raises `HardwareError`."""

    @abstractmethod
    def transfer(self, setpoint_pa: Array, is_vent: bool) -> Flags | bool:
        """Send set points (n,) [Pa gauge], zeros in a vent; return which chambers were sampled."""

    @abstractmethod
    def disconnect(self) -> None:
        """Close the connection; never raises."""

    def counts(self) -> Mapping[str, int]:
        """Counts for `BusStatistics`, beyond cycles and lost answers."""
        return {}

    def send_zeros(self) -> None:
        """Send 0 Pa to every device at once."""
        self.transfer(np.zeros(self.n_chambers), True)

    def judge(self) -> Iterable[Fault]:
        """Judge the answers of a cycle: latch faults, and return those that do not latch."""
        return ()

    def supply_pa(self) -> Array | None:
        """Return the supply pressures (n,) [Pa gauge], or None if no device reports them."""
        return None

    def on_lost(self, error: HardwareError) -> None:
        """Process a lost connection; `exchange` raises what this hook raises."""
        self.latch.add("link_lost", self.source, str(error))

    @property
    def is_open(self) -> bool:
        """Whether a connection is open for an orderly end."""
        return True

    def wait(self, duration_s: float) -> None:
        """Wait between two cycles of the start-up or the end; a family may receive bytes meanwhile."""
        time.sleep(duration_s)

    def shut_down(self, is_empty: bool) -> None:
        """Stop the devices, after the ramp to 0 Pa."""

    def begin_end(self) -> None:
        """Stop the threads of the family, at the begin of `close`."""

    def test_watchdogs(self) -> None:
        """Fall silent at 0 Pa and require that the devices vent by themselves, then start them again.

        Raises
        ------
        HardwareError
            If a device does not.
        """
        self._test_supervisor()

    def share(self) -> None:
        """Pass the connections to the supervisor, with the messages that vent."""

    def silence(self, duration_s: float) -> None:
        """Wait in the test of the supervisor, which has the connections meanwhile."""
        time.sleep(duration_s)

    def after_test(self) -> None:
        """Drop what the devices have answered to the supervisor."""

    def find_empty(self) -> bool:
        """Try again to read every chamber empty, in any state; return whether they were."""
        return False

    def is_pressed(self, setpoint_pa: Array) -> bool:
        """Return whether a device may have pressure, or gets pressure by set points (n,)."""
        return bool(setpoint_pa.any() or self.sent_pa.any())

    # -- the port ----------------------------------------------------------------------------------

    @property
    def chamber_names(self) -> tuple[str, ...]:
        return self._names

    @cached_property
    def n_chambers(self) -> int:
        return len(self._names)

    @property
    def update_hz(self) -> float:
        return self.platform.update_hz

    @property
    def statistics(self) -> BusStatistics:
        return BusStatistics(**{"cycles": self._cycles, "frames_lost": self.answers_lost, **self.counts()})

    @property
    def latched(self) -> tuple[Fault, ...]:
        """Faults that only `configure` clears."""
        return tuple(self.latch.values())

    def configure(self) -> None:
        with self._lock:
            if self._closed:
                raise HardwareError("the driver is closed; make a new one", code="order")
            self._started, self._configured, self.seen_empty = True, False, False
            self.latch.clear()
            self._lateness.restart()
            self.start_up()
            if self.platform.watchdog_test and not (self._is_tested or self.lockstep):
                self.test_watchdogs()
                self._is_tested = True
            self._configured = True

    def exchange(self, setpoint_pa: Array, now_ns: int) -> Exchange:
        if not self._configured:
            raise HardwareError("exchange before configure", code="order")
        found, allowed = np.asarray(setpoint_pa, dtype=np.float64), self.platform.range
        if found.shape != (self.n_chambers,):
            raise HardwareError(f"{found.shape} set points for {self.n_chambers} chambers", code="setting")
        low, high = allowed.minimum_pa, allowed.maximum_pa
        slack = 1e-6 * (high - low)  # rounding of a limiter's arithmetic
        good = (found >= low - slack) & (found <= high + slack)  # a comparison with NaN is false
        refused = [
            Fault("refused_setpoint", self._names[n], f"{found[n]} Pa is not within the platform's range")
            for n in map(int, np.flatnonzero(~good))
        ]
        with self._lock:
            self._cycles, self._now_ns = self._cycles + 1, now_ns
            zeros = np.zeros(self.n_chambers)
            # Report to the supervisor before pressure is commanded, because the driver may hang then.
            self._watched(zeros if refused or self.latched else found)
            setpoint, is_vent = found.clip(low, high), bool(refused or self.latched)
            fresh = self._transferred(zeros if is_vent else setpoint, is_vent)
            passing = list(self.judge())
            return Exchange(
                sent_pa=self.sent_pa.copy(),
                pressure_pa=self.pressure_pa.copy(),
                fresh=fresh,
                faults=(*refused, *self.latched, *passing, *self._late(fresh)),
                supply_pa=self.supply_pa(),
            )

    def vent(self) -> None:
        with self._lock:
            if not self._started or self._closed:
                return
            self.seen_empty = False  # until a cycle has read it
            with contextlib.suppress(HardwareError):
                try:
                    self.send_zeros()
                except HardwareError as error:
                    self.on_lost(error)
            self._watched(self.sent_pa)

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        self.begin_end()
        with self._lock:
            is_empty = False
            with contextlib.suppress(HardwareError):
                if self._configured and self.is_open:
                    is_empty = self._ramped_down()
                    self.shut_down(is_empty)
            # Behind a lost connection the last readings count; behind an open one the arm is read again.
            is_known = not self._started or (self.seen_empty and not self.is_open)
            is_empty = is_empty or is_known or self.find_empty()
            if not self.device_watchdog:
                end(self.supervisor, self.kind, is_empty)
            self.disconnect()
            self._configured = False

    # -- for the families --------------------------------------------------------------------------

    def supervise(self) -> None:
        """Start the supervisor, if the platform demands it."""
        if self.platform.is_supervised and not self.lockstep:
            self.supervisor = running(self.supervisor)
            self.supervisor.wait_until_ready()  # some devices give a new host little time

    def _test_supervisor(self) -> None:
        """Let the supervisor vent once, as if the driver hung, and start another one."""
        if self.supervisor is None:
            return
        if not np.all(np.abs(self.pressure_pa) < self.empty_pa):  # the supervisor could not confirm its vent
            logging.getLogger(__name__).warning(
                "%s: no test of the supervisor: a chamber reads %.1f kPa at 0 Pa",
                self.kind,
                np.max(np.abs(self.pressure_pa)) / 1e3,
            )
            return
        following = Supervisor()  # starts while the other one waits
        try:
            self.supervisor.test(_TEST_S, self.silence)
            following.wait_until_ready()
        except HardwareError:
            following.dismiss()
            raise
        self.supervisor.dismiss()
        self.supervisor = following
        self.after_test()
        self.share()

    def paced(self, setpoint_pa: Array) -> Array:
        """Make a cycle of the start-up or the end; return pressures (n,) [Pa gauge], NaN without a sample."""
        period_s = 1.0 / self.platform.cycle_hz
        end_s = self.clock() + period_s
        self._now_ns += round(1e9 * period_s)
        self._watched(setpoint_pa)
        if self._lost_supervisor:
            setpoint_pa = np.zeros(self.n_chambers)
        fresh = self._transferred(setpoint_pa, False)
        try:
            while not self.lockstep and (left_s := end_s - self.clock()) > 0:
                self.wait(left_s)
        except HardwareError as error:
            self.on_lost(error)
        return np.where(fresh, self.pressure_pa, np.nan)

    def require_watch(self) -> None:
        """Check the time directly before a message; set points that come too late must not follow a vent.

        The process of the driver may stand still anywhere in a cycle, and the supervisor vents meanwhile.

        Raises
        ------
        TakenOverError
            If the cycle commands pressure and the supervisor may have vented since its last report.
        """
        if self.supervisor is not None and self._presses and not self._lost_supervisor:
            pause_s = time.monotonic() - self._watched_s
            if pause_s > SILENCE_S:
                raise TakenOverError(
                    f"the driver stood still for {pause_s:.2f} s, the supervisor may have vented"
                )

    # -- a cycle -----------------------------------------------------------------------------------

    def _transferred(self, setpoint_pa: Array, is_vent: bool) -> Flags:
        """Transfer set points; return which chambers (n,) were sampled."""
        if setpoint_pa.any():
            self.seen_empty = False  # a connection may be lost after the set points have passed it
        self._presses = bool(setpoint_pa.any())
        try:
            try:
                fresh = self.transfer(setpoint_pa, is_vent)
            except TakenOverError as error:
                self.latch.add(*LOST, str(error))
                fresh = self.transfer(np.zeros(self.n_chambers), True)
        except HardwareError as error:
            self.on_lost(error)
            fresh = False
        finally:
            self._presses = False
        sampled = np.broadcast_to(fresh, (self.n_chambers,)).copy()
        if self.sent_pa.any():
            self.seen_empty = False
        elif sampled.any():
            self.seen_empty = bool(np.all(sampled & (np.abs(self.pressure_pa) < self.empty_pa)))
        return sampled

    def _late(self, fresh: Flags) -> list[Fault]:
        """Return the faults of readings that are too old, at the end of a cycle."""
        return self._lateness.end_cycle(fresh, self._now_ns, self._sources, self.answers_together)

    def _ramped_down(self) -> bool:
        """Ramp the set points to 0 and wait; return whether readings have shown every chamber empty."""
        period_s = 1.0 / self.platform.cycle_hz
        fall_pa = self.platform.shutdown_ramp_pa_s * period_s
        setpoint = np.zeros(self.n_chambers) if self.latched else self.sent_pa.copy()
        while setpoint.any():
            setpoint -= setpoint if self.latched else np.clip(setpoint, -fall_pa, fall_pa)
            self.paced(setpoint)
        shortest, longest = (round(time_s / period_s) for time_s in self.rest_s)
        for done in range(longest):
            # A comparison with NaN is false: a chamber without a reading does not count as empty.
            is_empty = bool(np.all(np.abs(self.paced(setpoint)) < EMPTY_PA))
            if is_empty and done + 1 >= shortest:
                return True
        return False

    def _watched(self, setpoint_pa: Array) -> None:
        """Report to the supervisor; latch a fault if there should be one and it does not protect the arm."""
        if self.supervisor is None:
            return
        self._watched_s = time.monotonic()
        if not self.supervisor.watches(self.is_pressed(setpoint_pa)):
            self.latch.add(*LOST, self.supervisor.lost)

    @property
    def _lost_supervisor(self) -> bool:
        return LOST in self.latch
