"""Regulators behind the limiter at the rate of their platform: how a procedure gives chambers pressure."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from soro_core import safety
from soro_core.hardware.guarded import GuardedRegulator
from soro_core.hardware.platform import PlatformBase
from soro_core.hardware.port import Array, Flags, Regulator
from soro_core.safety.limits import BURST, OVER_PRESSURE

# Above the highest set point of a procedure: where it trips after a moment, and at once.
OVER_PA, BURST_PA = 10e3, 20e3
# Age of a reading that trips: set points go slowly here, and a machine that is not tuned for real time is
# late now and then.
READING_AGE_S = 0.2


@dataclass(frozen=True)
class Sample:
    """What one cycle sent and brought back.

    Attributes
    ----------
    t_s : float
        When the set points were sent, from the first cycle on.
    sent_pa : ndarray (n,)
        Set points [Pa gauge] that went over the wire.
    reading_pa : ndarray (n,)
        Newest measured pressures [Pa gauge].
    fresh : ndarray (n,) of bool
        Whose reading came with this cycle.
    took_s : float
        Time from set points sent to readings back; 0 in lockstep.
    cause : str or None
        Why the limiter has vented.
    tip_m : ndarray (3,) or None
        Newest measured position of the tip in the world, where something measures it.
    """

    t_s: float
    sent_pa: Array
    reading_pa: Array
    fresh: Flags
    took_s: float
    cause: str | None = None
    tip_m: Array | None = None


def small_limits(
    platform: PlatformBase, most_pa: float, rise_pa_s: float, fall_pa_s: float = 400e3
) -> safety.Limits:
    """Limits that end just above the highest set point of a procedure.

    Parameters
    ----------
    most_pa : float
        Highest set point [Pa gauge].
    rise_pa_s, fall_pa_s : float
        Fastest rise and fall of a set point; a vent is not limited.

    Raises
    ------
    ConfigError
        If they lead beyond what the limiter or the platform's rating allows.
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
    """A configured regulator that is commanded through the limiter only.

    Parameters
    ----------
    platform : PlatformBase
        Of the regulator.
    regulator : Regulator
        Configured; the caller closes it.
    limits : Limits
        Of commands and readings.
    lockstep : bool
        Whether time goes on by one period a cycle, or by the clock.
    tip : callable, optional
        Newest measured position of the tip [m], None where there is none.
    """

    def __init__(
        self,
        platform: PlatformBase,
        regulator: Regulator,
        limits: safety.Limits,
        lockstep: bool = False,
        tip: Callable[[], Array | None] = lambda: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._guarded = GuardedRegulator(platform, regulator, limits)
        self._lockstep, self._tip, self._clock = lockstep, tip, clock
        self.period_s = 1.0 / platform.cycle_hz
        self._cycles = 0
        self._start_s: float | None = None

    @property
    def n_chambers(self) -> int:
        """Number of chambers."""
        return self._guarded.regulator.n_chambers

    @property
    def cause(self) -> str | None:
        """Why the limiter has vented, or None."""
        return self._guarded.cause

    @property
    def lost(self) -> str | None:
        """Why the devices cannot be commanded any more, or None."""
        return self._guarded.lost

    def cycle(self, wanted_pa: Array) -> Sample:
        """Wait for the next cycle, exchange, judge; what is wanted (n,) [Pa gauge] is sent in the one after.

        A vent is sent at once; while it is latched only zeros are.
        """
        now_s = self._next()
        now_ns = round(now_s * 1e9)
        self._guarded.offer(wanted_pa, now_ns, now_ns)
        began_s = self._clock()
        result = self._guarded.cycle(now_ns)
        took_s = 0.0 if self._lockstep else self._clock() - began_s
        if result is None:
            nothing = np.full(self.n_chambers, np.nan)
            return Sample(now_s, np.zeros_like(nothing), nothing, np.isfinite(nothing), 0.0, self.cause)
        return Sample(
            now_s, result.sent_pa, result.pressure_pa, result.fresh, took_s, self.cause, self._tip()
        )

    def vent(self, cause: str) -> None:
        """Latch, and send zeros at once."""
        self._guarded.vent(cause)

    def reset(self) -> str | None:
        """Leave the latch; the refusal, or None. A procedure does not go on with devices that were lost."""
        return self._guarded.lost or self._guarded.reset(lambda: round(self._now() * 1e9))

    def _now(self) -> float:
        if self._lockstep or self._start_s is None:
            return self._cycles * self.period_s
        return self._clock() - self._start_s

    def _next(self) -> float:
        """Time of the next cycle; one that comes late moves the schedule of those after it."""
        self._cycles += 1
        if self._lockstep:
            return self._now()
        if self._start_s is None:
            self._start_s = self._due_s = self._clock()
        self._due_s += self.period_s
        left_s = self._due_s - self._clock()
        if left_s > 0:
            time.sleep(left_s)
        elif left_s < -self.period_s:
            self._due_s = self._clock()
        return self._now()
