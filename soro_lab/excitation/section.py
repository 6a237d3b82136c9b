"""A section of an excitation: set points as a function of the time since its begin."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array

# Part of a sweep in which its amplitude grows, and in which it falls again.
TAPER = 0.05


@dataclass(frozen=True)
class Sweep:
    """A sine whose frequency grows exponentially.

    Attributes
    ----------
    amplitude_pa : ndarray (n_u,)
        Largest amplitude [Pa].
    low_hz, high_hz : float
        Frequencies at begin and end.
    rate_pa_s : float
        Fastest change of a set point [Pa/s]; it bounds the amplitude at high frequencies.
    """

    amplitude_pa: Array
    low_hz: float
    high_hz: float
    rate_pa_s: float

    def at(self, t: float, length_s: float) -> Array:
        """Return the deviation from the centre (n_u,) [Pa] at a time [s] of a sweep of a length [s]."""
        growth = math.log(self.high_hz / self.low_hz)
        part = min(max(t / length_s, 0.0), 1.0)
        frequency = self.low_hz * math.exp(growth * part)
        phase = 2.0 * math.pi * length_s * (frequency - self.low_hz) / growth
        taper = min(1.0, part / TAPER, (1.0 - part) / TAPER)
        # The sine and the taper change the set point together.
        most = self.rate_pa_s / (2.0 * math.pi * frequency + 1.0 / (TAPER * length_s))
        amplitude = np.minimum(self.amplitude_pa, most)
        return np.asarray(taper * math.sin(phase) * amplitude)


@dataclass(frozen=True)
class ExcitationSegment:
    """Set points from the end of the segment before to a level, and there.

    Attributes
    ----------
    stage : str
        Name of the stage.
    name : str
        What happens, within the stage; no two sections of one stage have the same.
    level_pa : ndarray (n_u,)
        Set points after the ramp, the centre of a sweep [Pa gauge].
    ramp_s : float
        Time of the ramp [s].
    hold_s : float
        Longest time after it [s].
    shortest_s : float
        A section ends when the arm has been still for this time after the ramp [s]; `hold_s`: it lasts.
    sweep : Sweep or None
        Deviation from the level.
    asks : str
        What a person is asked to do; the section ends with the answer.
    """

    stage: str
    name: str
    level_pa: Array
    ramp_s: float
    hold_s: float
    shortest_s: float
    sweep: Sweep | None = None
    asks: str = ""

    @property
    def lasts(self) -> bool:
        """Whether it has its time, or waits for a person, whatever the arm does."""
        return bool(self.asks) or self.shortest_s >= self.hold_s

    @property
    def longest_s(self) -> float:
        """Longest time [s]."""
        return self.ramp_s + self.hold_s

    def setpoint(self, begin_pa: Array, t: float) -> Array:
        """Return set points (n_u,) [Pa gauge].

        Parameters
        ----------
        begin_pa : ndarray (n_u,)
            Set points at the begin of the section [Pa gauge].
        t : float
            Time since then [s]; before it, as where a clock has been set back, the set points are `begin_pa`.
        """
        t = max(t, 0.0)
        if t < self.ramp_s:
            return np.asarray(begin_pa + (self.level_pa - begin_pa) * (t / self.ramp_s))
        if self.sweep is None:
            return self.level_pa
        return self.level_pa + self.sweep.at(t - self.ramp_s, self.hold_s)
