"""A regulator behind the limiter at the rate of its platform, for procedures that pressurise chambers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from soro_core import safety
from soro_core.arrays import Array, Flags
from soro_core.safety.limits import BURST, OVER_PRESSURE
from soro_hardware.limited_regulator import LimitedRegulator
from soro_hardware.platform import PlatformBase
from soro_hardware.port import Regulator

# Trip levels above the highest set point of a procedure [Pa]: with delay, and immediate.
OVER_PA, BURST_PA = 10e3, 20e3
# Age of a reading that trips [s]: set points change slowly here, and a machine that is not tuned for real
# time is sometimes late.
READING_AGE_S = 0.2


@dataclass(frozen=True)
class CycleSample:
    """Commands and readings of one cycle.

    Attributes
    ----------
    t_s : float
        Start of the cycle since the first one [s], when the command was given and the set points were sent.
    wanted_pa : ndarray (n,)
        Command [Pa gauge].
    sent_pa : ndarray (n,)
        Set points sent to the devices [Pa gauge].
    reading_pa : ndarray (n,)
        Newest measured pressures [Pa gauge].
    fresh : ndarray (n,) of bool
        Whether the reading is from this cycle.
    took_s : float
        Time from sending the set points to receiving the readings [s]; 0 in lockstep.
    cause : str or None
        Why the limiter has vented; None if it has not.
    tip_m : ndarray (3,) or None
        Newest measured position of the tip in the world [m]; None without a sensor.
    """

    t_s: float
    wanted_pa: Array
    sent_pa: Array
    reading_pa: Array
    fresh: Flags
    took_s: float
    cause: str | None = None
    tip_m: Array | None = None


def small_limits(
    platform: PlatformBase, most_pa: float, rise_pa_s: float, fall_pa_s: float = 400e3
) -> safety.Limits:
    """Return limits just above the highest set point of a procedure.

    Parameters
    ----------
    platform : PlatformBase
        Platform, whose rating bounds the limits.
    most_pa : float
        Highest set point [Pa gauge].
    rise_pa_s, fall_pa_s : float
        Fastest rise and fall of a set point [Pa/s]; a vent is not limited.

    Raises
    ------
    ConfigError
        If the limits exceed those of the limiter or the platform's rating.
    """
    top = platform.rating.maximum_pa
    burst_pa = min(most_pa + BURST_PA, BURST * top)
    limits = safety.Limits(
        maximum_pa=most_pa,
        rise_pa_s=rise_pa_s,
        fall_pa_s=fall_pa_s,
        over_pressure_pa=min(most_pa + OVER_PA, OVER_PRESSURE * top),
        burst_pressure_pa=burst_pa,
        reading_age_s=READING_AGE_S,
        monitors=safety.Monitors(short_circuit_pa=max(150e3, 1.2 * burst_pa)),
    )
    safety.check_rating(limits, platform.rating, where="limits of the procedure")
    return limits


class PacedRegulator:
    """A configured regulator behind the limiter, at the rate of its platform.

    Parameters
    ----------
    platform : PlatformBase
        Platform of the regulator.
    regulator : Regulator
        Configured regulator; the caller closes it.
    limits : Limits
        Limits of commands and readings.
    lockstep : bool
        Whether each cycle advances the time by one period, instead of the clock.
    tip : callable, optional
        Function that returns the newest measured position of the tip (3,) [m], or None.
    why_stopped : callable
        Function that returns why an emergency stop demands a vent, or None.
    """

    def __init__(
        self,
        platform: PlatformBase,
        regulator: Regulator,
        limits: safety.Limits,
        lockstep: bool = False,
        tip: Callable[[], Array | None] = lambda: None,
        why_stopped: Callable[[], str | None] = lambda: None,
    ) -> None:
        self._limited = LimitedRegulator(platform, regulator, limits)
        self._limited.why_stopped = why_stopped
        self._lockstep, self._tip = lockstep, tip
        self.period_s = 1.0 / platform.cycle_hz
        self._cycles = 0
        self._start_s: float | None = None

    @property
    def n_chambers(self) -> int:
        """Number of chambers."""
        return self._limited.regulator.n_chambers

    @property
    def cause(self) -> str | None:
        """Why the limiter has vented, or None."""
        return self._limited.cause

    @property
    def lost(self) -> str | None:
        """Why the devices cannot be commanded any more, or None."""
        return self._limited.lost

    def cycle(self, wanted_pa: Array) -> CycleSample:
        """Wait for the next cycle, send the command (n,) [Pa gauge] through the limiter; return the sample.

        A vent is sent at once; while it is latched, the set points are zeros.
        """
        now_s = self._next()
        now_ns = round(now_s * 1e9)
        self._limited.offer(wanted_pa, now_ns, now_ns)
        began_s = time.monotonic()
        result = self._limited.cycle(now_ns)
        took_s = 0.0 if self._lockstep else time.monotonic() - began_s
        if result is None:
            missing = np.full(self.n_chambers, np.nan)
            zeros = np.zeros_like(missing)
            return CycleSample(now_s, wanted_pa, zeros, missing, np.isfinite(missing), 0.0, self.cause)
        exchanged = result.sent_pa, result.pressure_pa, result.fresh
        return CycleSample(now_s, wanted_pa, *exchanged, took_s, self.cause, self._tip())

    def vent(self, cause: str) -> None:
        """Latch the limiter, and send zeros at once."""
        self._limited.vent(cause)

    def reset(self) -> str | None:
        """Reset the latch; return the reason of a refusal, or None. Lost devices refuse it."""
        return self._limited.lost or self._limited.reset(lambda: round(self._now() * 1e9))

    def _now(self) -> float:
        if self._lockstep or self._start_s is None:
            return self._cycles * self.period_s
        return time.monotonic() - self._start_s

    def _next(self) -> float:
        """Wait for the next cycle and return its time [s]; a late cycle delays those after it."""
        self._cycles += 1
        if self._lockstep:
            return self._now()
        if self._start_s is None:
            self._start_s = self._due_s = time.monotonic()
        self._due_s += self.period_s
        left_s = self._due_s - time.monotonic()
        if left_s > 0:
            time.sleep(left_s)
        elif left_s < -self.period_s:
            self._due_s = time.monotonic()
        return self._now()
