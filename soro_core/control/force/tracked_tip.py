"""The tip as the force loop tracks it: quickly while it moves, ever more calmly the longer it rests.

The reference of a tip in contact goes with the measured tip, and what it moves by noise is a force: 0.1 mm
are 2 mN on the three-bellow arm. A tracker that averages for longer has less of it, and is late when a wall
moves. So there are two: the calm one averages over half of the time since the tip last moved, and begins anew
at the quick one where that is farther away than noise is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array

# Time constants of the quick tracker, of the calm one at most, and of a tip that a filter alone knows [s].
QUICK_S, CALMEST_S, FILTER_S = 0.15, 1.5, 0.5
# Part of the time since the tip last moved that the calm one averages over.
_GROWS = 0.5
# Distance of both from which on the tip has moved [m]: 4.6 deviations of the quick one, with positions of
# 0.3 mm a hundred times a second.
_MOVED_M = 4e-4
# Age of a measured tip, which is behind a low-pass [s].
_SEEN_S = 0.05


class Track(NamedTuple):
    """Position and velocity (3,) [m, m/s]."""

    tip: Array
    speed: Array

    def next(self, seen: Array, time_s: float, dt: float) -> Track:
        """Return it after a tick, without lag at constant speed.

        Parameters
        ----------
        seen : ndarray (3,)
            Position [m].
        time_s : float
            Its time constant [s].
        dt : float
            Time since the last tick [s].
        """
        part = 1.0 - float(np.exp(-dt / time_s))
        expected = self.tip + dt * self.speed
        off = seen - expected
        return Track(expected + part * (2.0 - part) * off, self.speed + part**2 / dt * off)


class TrackedTip(NamedTuple):
    """A tip that is tracked.

    Attributes
    ----------
    calm, quick : Track
    rests_s : float
        Time since the tip last moved [s].
    """

    calm: Track
    quick: Track
    rests_s: float = 0.0

    @property
    def tip(self) -> Array:
        """Position (3,) [m]."""
        return self.calm.tip

    @property
    def speed(self) -> Array:
        """Velocity (3,) [m/s]."""
        return self.calm.speed

    def stopped(self) -> TrackedTip:
        """Return it at rest, as by a wall that rests."""
        calm, quick = (one._replace(speed=np.zeros(3)) for one in (self.calm, self.quick))
        return TrackedTip(calm, quick)


def tracked(
    before: TrackedTip | None, believed: Track, measured: Array | None, touches: bool, dt: float
) -> TrackedTip:
    """Return the tip after a tick.

    Parameters
    ----------
    before : TrackedTip or None
        None at first.
    believed : Track
        The filter's.
    measured : ndarray (3,) or None
        Measured tip [m], behind the low-pass of the estimated force; None where it is not measured. The
        filter's goes with the pressures: a reference that follows it follows what it has caused.
    touches : bool
        Whether the tip is in contact. In free air it moves.
    dt : float
        Time since the last tick [s].
    """
    if before is None:
        return TrackedTip(believed, believed)
    if measured is None:
        track = before.calm.next(believed.tip, FILTER_S, dt)
        return TrackedTip(track, track)
    calm, quick, rests_s = before
    quick = quick.next(measured + _SEEN_S * quick.speed, QUICK_S, dt)
    rests_s += dt
    time_s = min(max(_GROWS * rests_s, QUICK_S), CALMEST_S)
    calm = calm.next(measured + _SEEN_S * calm.speed, time_s, dt)
    if not touches or float(np.linalg.norm(calm.tip - quick.tip)) > _MOVED_M:
        return TrackedTip(quick, quick)
    return TrackedTip(calm, quick, rests_s)
