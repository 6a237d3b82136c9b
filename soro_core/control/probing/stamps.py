"""Whether poses are stamped when they are taken, from readings and poses of the probe.

A second-order system with the readings as its inputs moves as the sensor does: its frequency, its damping and
what each chamber does are fitted, and the delay with them. The rise and the fall of each pressure show both:
frequency and damping by how the arm swings, the delay by when it begins. Part of the answer comes late in its
own right: what creeps, and what friction holds back. A slow branch behind the system takes that up; without
it a soft silicone looks 14 ms late. A delay counts that both show, the system with the branch and without it.
A filter cannot be asked: it knows the pressures, and moves on time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from soro_core.arrays import Array
from soro_core.control.probing.findings import FAIL, ProbeFinding

# Named above this delay, and above this part of the period of the sensor's samples, by so many deviations.
_ALLOWED_S, _PERIODS, _DEVIATIONS = 0.012, 1.2, 4.0
# Time constant of the slow branch, in that of the system, one over its frequency.
_SLOW = 20.0
# Part of the motion that the fit must explain, and fewest samples.
_EXPLAINED, _LEAST_SAMPLES = 0.85, 30
# A sensor whose poses differ by less does not move [m].
_LEAST_MOTION_M = 1e-6
# Frequencies [rad/s] and damping ratios that the fit starts from; delays that it may find [s].
_RATES, _RATIOS, _LONGEST_S = np.geomspace(3.0, 100.0, 24), (0.05, 0.15, 0.5, 1.5), 0.3
# Time between two points of the response [s].
_STEP_S = 0.005
_MAIN = 2


class StampedPosition(NamedTuple):
    """Position (3,) [m] that a sensor has seen, in any frame, and its stamp [s]."""

    sensor: str
    stamp_s: float
    position: Array


class StampDelay(NamedTuple):
    """How much later than their poses stamps are, and its deviation [s]."""

    late_s: float
    std_s: float


def judge_stamps(
    t_s: Array,
    reading_pa: Array,
    seen: Sequence[StampedPosition],
    length_m: float,
    between: Callable[[], None] = lambda: None,
) -> list[ProbeFinding]:
    """Return a finding if a sensor's poses are stamped later or earlier than they are taken.

    Parameters
    ----------
    t_s : ndarray (n,)
        Times of the readings [s].
    reading_pa : ndarray (n, n_u)
        Measured pressures [Pa gauge], at rest first.
    seen : sequence of StampedPosition
        All of the probe, in any order.
    length_m : float
        Length of the arm [m]: positions farther off from their median are no poses of it.
    between : callable
        Called again and again.
    """
    found = []
    for name in dict.fromkeys(one.sensor for one in seen):
        # A sensor that repeats a pose under one stamp says nothing new.
        own = {
            one.stamp_s: one.position
            for one in seen
            if one.sensor == name and np.isfinite([one.stamp_s, *one.position]).all()
        }
        if not own:
            continue
        stamps = np.array(sorted(own))
        positions = np.array([own[stamp] for stamp in stamps])
        near = (np.abs(positions - np.median(positions, axis=0)) <= length_m).all(axis=1)
        stamps, positions = stamps[near], positions[near]
        delay = stamp_delay(t_s, reading_pa, stamps, positions, between)
        if delay is None:
            continue
        period_s = float(np.median(np.diff(stamps)))
        allowed = max(_ALLOWED_S, _PERIODS * period_s)
        if abs(delay.late_s) > max(allowed, _DEVIATIONS * delay.std_s):
            found.append((abs(delay.late_s), name, delay))
    if not found:
        return []
    size, name, delay = max(found)
    side, other = ("late", "early") if delay.late_s > 0.0 else ("early", "late")
    text = f"{name}: poses are stamped {1e3 * size:.0f} ms {side} (+-{1e3 * delay.std_s:.0f})"
    step = "stamp each pose with the time at which it is taken, by the clock of chambers/state"
    return [ProbeFinding(FAIL, text, step, (f"readings of chambers/state that are stamped {other}",))]


def stamp_delay(
    t_s: Array,
    reading_pa: Array,
    stamp_s: Array,
    position_m: Array,
    between: Callable[[], None] = lambda: None,
) -> StampDelay | None:
    """Return the delay of one sensor's stamps; None where its poses do not show it.

    Parameters
    ----------
    t_s : ndarray (n,)
        Times of the readings [s].
    reading_pa : ndarray (n, n_u)
    stamp_s : ndarray (m,)
        Increasing [s].
    position_m : ndarray (m, 3)
    between : callable
        Called again and again.
    """
    from scipy.optimize import least_squares  # a run without the probe need not wait for it

    if stamp_s.size < _LEAST_SAMPLES:
        return None
    grid = np.arange(t_s[0], t_s[-1], _STEP_S)
    pressure = np.column_stack([np.interp(grid, t_s, one) for one in (reading_pa - reading_pa[0]).T])
    pressure /= max(float(np.abs(pressure).max()), 1e-9)
    inside = (stamp_s > t_s[0] + _LONGEST_S) & (stamp_s < t_s[-1] - _LONGEST_S)
    stamps, moved = stamp_s[inside], position_m[inside] - position_m[inside].mean(axis=0)
    if stamps.size < _LEAST_SAMPLES:
        return None
    if np.abs(moved).max() < _LEAST_MOTION_M:
        return None
    # An arm bends in two directions with one frequency, and stretches with another.
    motion = moved @ np.linalg.svd(moved, full_matrices=False)[2][:_MAIN].T

    def missed(fitted: Array, slow: bool = False) -> Array:
        """`fitted`: logarithms of the frequency [rad/s] and of the damping ratio, and the delay [s]."""
        between()
        rate, ratio = np.exp(fitted[:2])
        return _missed(grid, _response(pressure, rate, ratio, slow), stamps - fitted[2], motion)

    starts = [np.array([np.log(rate), np.log(ratio), 0.0]) for rate in _RATES for ratio in _RATIOS]
    start = min(starts, key=lambda one: float(np.sum(missed(one) ** 2)))
    bounds = np.array([[0.0, np.log(0.01), -_LONGEST_S], [7.0, 5.0, _LONGEST_S]])
    delays = []
    for slow in (False, True):
        best = least_squares(
            missed, start, bounds=tuple(bounds), x_scale=[0.1, 0.1, 0.01], max_nfev=30, args=(slow,)
        )
        start, left = best.x, best.fun.reshape(motion.shape)
        if np.sum(left**2) > (1.0 - _EXPLAINED) ** 2 * np.sum(motion**2):
            return None
        # Residuals that follow one another say less: by the mean of their products.
        variance = np.mean(left**2)
        alike = float(np.clip(np.mean(left[1:] * left[:-1]) / variance, 0.0, 0.98))
        variance *= (1.0 + alike) / (1.0 - alike)
        covariance = np.linalg.pinv(best.jac.T @ best.jac) * variance
        delays.append(StampDelay(float(best.x[2]), float(np.sqrt(covariance[2, 2]))))
    without, creeping = delays
    if without.late_s * creeping.late_s < 0.0:
        return StampDelay(0.0, max(delay.std_s for delay in delays))
    return min(delays, key=lambda delay: abs(delay.late_s))


def _missed(grid: Array, response: Array, stamps: Array, motion: Array) -> Array:
    """Return what the best gains of the chambers leave of a motion (m, 2), flat."""
    columns = [np.interp(stamps, grid, one) for one in response.T]
    columns.append(np.ones(stamps.size))
    rows = np.column_stack(columns)
    return np.asarray(motion - rows @ np.linalg.lstsq(rows, motion, rcond=None)[0]).ravel()


def _response(pressure: Array, rate: float, ratio: float, slow: bool) -> Array:
    """Return the answer (n, n_u) of a second-order system to pressures, by the trapezoidal rule.

    `slow`: with that of the slow branch behind it, (n, 2 n_u).
    """
    from scipy.signal import lfilter

    w = 0.5 * _STEP_S * rate
    first, second = 1.0 + 2.0 * ratio * w + w * w, 1.0 - 2.0 * ratio * w + w * w
    inputs, outputs = np.array([1.0, 2.0, 1.0]) * w * w, [first, 2.0 * w * w - 2.0, second]
    response = lfilter(inputs, outputs, pressure, axis=0)
    if slow:
        kept = np.exp(-_STEP_S * rate / _SLOW)
        response = np.hstack([response, lfilter([1.0 - kept], [1.0, -kept], response, axis=0)])
    return np.asarray(response)
