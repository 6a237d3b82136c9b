"""Pressures that were not measured: stated levels, reached with the lag of a regulator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from soro_core.arrays import Array


def stated_pressure(steps: Sequence[Sequence[float]], lag_s: Sequence[float], t: Array) -> Array:
    """Return the pressure (n,) at times t: of first order from level to level.

    Parameters
    ----------
    steps : sequence of (time, level)
        Time [s] at which each level is commanded, in order; the first holds before its time too.
    lag_s : (rise, fall)
        Lags [s] towards a higher and a lower level; 0: at once.
    t : (n,)
        Times [s], rising.
    """
    pressure = np.full(len(t), float(steps[0][1]))
    value, begin = float(steps[0][1]), float(steps[0][0])
    target, lag = value, 0.0
    for time, level in steps[1:]:
        value += (target - value) * _share(np.array([time - begin]), lag)[0]
        target, lag, begin = float(level), lag_s[0] if level > value else lag_s[1], float(time)
        later = t >= begin
        pressure[later] = value + (target - value) * _share(t[later] - begin, lag)
    return pressure


def _share(after: Array, lag: float) -> Array:
    """Share of a step that is done at some times [s] after it."""
    return -np.expm1(-after / lag) if lag > 0.0 else np.ones(len(after))
