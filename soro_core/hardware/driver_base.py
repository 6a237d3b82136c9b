"""What drivers have in common: their platform, what they check before a cycle, faults that stay."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, Generic, TypeVar

import numpy as np

from soro_core.errors import HardwareError
from soro_core.hardware.platform import Freshness, PlatformBase
from soro_core.hardware.port import Array, Fault, Flags, Regulator

P = TypeVar("P", bound=PlatformBase)


class DriverBase(Regulator, Generic[P]):
    """Driver of one arm.

    Parameters
    ----------
    platform : PlatformBase
        Valves, range and times.
    clock : callable
        Monotonic time [s] for the limits of blocking steps.
    lockstep : bool
        Wait for every answer, pace nothing.
    """

    def __init__(self, platform: P, clock: Callable[[], float], lockstep: bool = False) -> None:
        self.platform, self.clock, self.lockstep = platform, clock, lockstep
        self._names = platform.chamber_names
        self._begun = self._configured = self._closed = False
        self._cycles = 0

    @property
    def chamber_names(self) -> tuple[str, ...]:
        return self._names

    @property
    def update_hz(self) -> float:
        return self.platform.cycle_hz

    def _begin(self) -> None:
        """Begin a start-up; without its end there is no exchange."""
        if self._closed:
            raise HardwareError("the driver is closed; make a new one")
        self._begun, self._configured = True, False

    def _checked(self, setpoint_pa: Array) -> tuple[Array, list[Fault]]:
        """Begin a cycle: set points (n,) [Pa gauge] as floats, and a fault for each that is not to be sent.

        Raises
        ------
        HardwareError
            Before the start-up, or if there is not one a chamber.
        """
        if not self._configured:
            raise HardwareError("exchange before configure")
        found, allowed = np.asarray(setpoint_pa, dtype=np.float64), self.platform.range
        if found.shape != (self.n_chambers,):
            raise HardwareError(f"{found.shape} set points for {self.n_chambers} chambers")
        self._cycles += 1
        slack = 1e-6 * (allowed.maximum_pa - allowed.minimum_pa)  # rounding of a limiter's arithmetic
        good = (found >= allowed.minimum_pa - slack) & (found <= allowed.maximum_pa + slack)
        return found, [
            Fault("refused_setpoint", self._names[n], f"{found[n]} Pa is not within the platform's range")
            for n in map(int, np.flatnonzero(~good))  # a comparison with NaN is false, so NaN is refused here
        ]


class ConnectionDriver(DriverBase[P]):
    """Driver of devices that are reached over one connection and answer a cycle together.

    Parameters
    ----------
    platform, clock, lockstep
        As above.
    times : Freshness
        When a chamber's reading is no longer one.

    Attributes
    ----------
    source : str
        What a fault that is none of a single chamber's names.
    """

    source: ClassVar[str]

    def __init__(
        self, platform: P, times: Freshness, clock: Callable[[], float], lockstep: bool = False
    ) -> None:
        super().__init__(platform, clock, lockstep)
        self._times = times
        self._latched: dict[tuple[str, str], Fault] = {}
        self._missed = 0
        self._read_ns: int | None = None

    def _begin(self) -> None:
        super()._begin()
        self._latched.clear()
        self._missed, self._read_ns = 0, None

    def _latch(self, code: str, message: str, source: str = "") -> None:
        """Note a fault that stays until the next start-up."""
        source = source or self.source
        self._latched.setdefault((code, source), Fault(code, source, message, latched=True))

    def _patience_s(self, budget_s: float) -> float:
        """Longest wait for an answer [s]: in lockstep until it comes, unless the devices are silent."""
        is_waiting = self.lockstep and self._missed < self._times.stale_cycles
        return self.platform.lockstep_timeout_s if is_waiting else budget_s

    def _faults(self, fresh: Flags, now_ns: int) -> list[Fault]:
        """End a cycle: the faults that stay, and the chambers (n,) that have not been read for too long."""
        is_fresh = bool(fresh.all())
        self._read_ns = now_ns if is_fresh or self._read_ns is None else self._read_ns
        self._missed = 0 if is_fresh else self._missed + 1
        faults = list(self._latched.values())
        age_ns = now_ns - self._read_ns
        if self._times.is_stale(self._missed, age_ns):
            names = ", ".join(name for name, good in zip(self._names, fresh, strict=True) if not good)
            faults.append(Fault("stale_reading", names, self._times.too_old(self._missed, age_ns)))
        return faults
