"""Frequency and damping ratio of a motion that rings down, by a fit of a damped sine."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from soro_core.arrays import Array
from soro_core.errors import ModelError

# What a motion rings on: a straight line, and two decays [s], of pressures that still rise and of creep. With
# a parabola instead, the ratio of a recorded fill changes by half with the window; with these by a tenth.
_DECAYS_S = (0.1, 0.3)
_DRIFT = 2 + len(_DECAYS_S)
# Fewer cycles than these in all samples are drift.
_CYCLES = 3.0


class Ring(NamedTuple):
    """What a motion rings with.

    Attributes
    ----------
    frequency_hz : float
        Natural frequency, undamped.
    damping_ratio : float
    """

    frequency_hz: float
    damping_ratio: float


def ring_of(t: Array, y: Array) -> Ring:
    """Return frequency and damping ratio of a drifting, decaying sine.

    y = c0 + c1 t + c2 exp(-t / 0.1 s) + c3 exp(-t / 0.3 s) + exp(-zeta w t) (a cos(w_d t) + b sin(w_d t)),
    w_d = w sqrt(1 - zeta^2): least squares over all samples, the linear numbers found exactly at each trial
    of w and zeta. The search starts at the frequency that fits best with a ratio of 0.05.

    Parameters
    ----------
    t : (n,)
        Times [s], rising; need not be even.
    y : (n,)
        Motion, of any unit.

    Raises
    ------
    ModelError
        If there are fewer samples than numbers, or no decaying sine.
    """
    least = 2 * (_DRIFT + 4)
    if len(t) < least:
        raise ModelError(f"{len(t)} samples of a ring-down: allowed are {least} or more", "t")
    # The search ends by absolute sizes too.
    t, y = t - t[0], y / max(float(np.ptp(y)), 1e-300)

    def residuals(x: Array) -> Array:
        columns = _columns(t, *np.exp(x))
        return np.asarray(columns @ np.linalg.lstsq(columns, y, rcond=None)[0] - y)

    trials = np.linspace(_CYCLES / t[-1], 0.25 * len(t) / t[-1], 60)
    best = min(trials, key=lambda f: float(np.sum(residuals(np.log([2 * np.pi * f, 0.05])) ** 2)))
    start, span = np.log([2.0 * np.pi * best, 0.05]), np.array([0.4, np.inf])
    found: Any = least_squares(
        residuals, start, bounds=(start - span, start + span), x_scale=0.05, ftol=1e-12, xtol=1e-9
    )
    w, zeta = np.exp(found.x)
    if not 1e-4 < zeta < 0.9:
        raise ModelError(f"a damping ratio of {zeta:.3g} from a ring-down: allowed is 0.0001 to 0.9", "y")
    return Ring(float(w / (2.0 * np.pi)), float(zeta))


def _columns(t: Array, w: float, zeta: float) -> Array:
    """Return what the motion is a sum of, (n, _DRIFT + 2)."""
    zeta = min(zeta, 0.99)
    decay, phase = np.exp(-zeta * w * t), w * np.sqrt(1.0 - zeta**2) * t
    drift = [np.ones_like(t), t, *(np.exp(-t / tau) for tau in _DECAYS_S)]
    return np.column_stack([*drift, decay * np.cos(phase), decay * np.sin(phase)])
