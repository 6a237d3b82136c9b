"""Levels, drifts and times from samples; pure functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soro_core.arrays import Array
from soro_hardware.hil.paced import CycleSample

# Last part of a phase for means, and for drifts.
SETTLED_PART = 1 / 3
T63 = 1.0 - np.exp(-1.0)


@dataclass(frozen=True)
class RestReadings:
    """Readings at rest: mean and standard deviation (n,) [Pa gauge], and position of the tip (3,) [m]."""

    mean_pa: Array
    noise_pa: Array
    tip_m: Array | None


@dataclass(frozen=True)
class PressureHold:
    """One chamber held at one set point.

    Attributes
    ----------
    chamber : int
        Number of the chamber.
    setpoint_pa : float
        Set point [Pa gauge].
    level_pa : ndarray (n,)
        Mean readings at the end of the hold, minus those before the first step [Pa].
    drift_pa_s : float
        Slope of the chamber's reading in the second half [Pa/s].
    drift_error_pa_s : float
        Standard error of the slope [Pa/s].
    t63_s : float
        Time from the first set point of the step to 63 % of the change of the reading [s]; NaN if unknown.
    moved_m : ndarray (3,) or None
        Displacement of the tip since before the first step [m].
    """

    chamber: int
    setpoint_pa: float
    level_pa: Array
    drift_pa_s: float
    drift_error_pa_s: float
    t63_s: float
    moved_m: Array | None


@dataclass(frozen=True)
class Vent:
    """One vent.

    Attributes
    ----------
    chamber : int
        Number of the chamber that had pressure.
    from_pa, end_pa : ndarray (n,)
        Readings at start and end, minus those at rest [Pa].
    low_pa : float
        Pressure below which a chamber is empty [Pa].
    took_s : float
        Time until all chambers are empty [s]; NaN if they are not.
    """

    chamber: int
    from_pa: Array
    end_pa: Array
    low_pa: float
    took_s: float


def rest(samples: Sequence[CycleSample]) -> RestReadings:
    """Return mean and noise of the fresh readings of a phase, and the mean position of the tip."""
    readings, fresh = _readings(samples)
    columns = [readings[fresh[:, k], k] for k in range(readings.shape[1])]
    mean = np.array([column.mean() if column.size else np.nan for column in columns])
    noise = np.array([column.std() if column.size else np.nan for column in columns])
    return RestReadings(mean, noise, _tip(samples))


def hold(
    samples: Sequence[CycleSample], chamber: int, setpoint_pa: float, at_rest: RestReadings
) -> PressureHold:
    """Evaluate a hold.

    Parameters
    ----------
    samples : sequence of CycleSample
        All samples since the set point started to rise.
    chamber : int
        Number of the chamber.
    setpoint_pa : float
        Set point [Pa gauge].
    at_rest : RestReadings
        Readings before the first step.
    """
    readings, fresh = _readings(samples)
    t = np.array([sample.t_s for sample in samples])
    end = rest(_last(samples, SETTLED_PART))
    drift, error = _slope(t, readings[:, chamber], fresh[:, chamber] & (t >= t[0] + (t[-1] - t[0]) * 0.5))
    tip = None if end.tip_m is None or at_rest.tip_m is None else end.tip_m - at_rest.tip_m
    t63 = _t63(t, readings[:, chamber], fresh[:, chamber], end.mean_pa[chamber])
    return PressureHold(chamber, setpoint_pa, end.mean_pa - at_rest.mean_pa, drift, error, t63, tip)


def vent(samples: Sequence[CycleSample], chamber: int, low_pa: float, at_rest: RestReadings) -> Vent:
    """Evaluate a vent.

    Parameters
    ----------
    samples : sequence of CycleSample
        Samples since the vent.
    chamber : int
        Number of the chamber that had pressure.
    low_pa : float
        Pressure below which a chamber is empty [Pa].
    at_rest : RestReadings
    """
    readings, _ = _readings(samples)
    above = np.nan_to_num(readings - at_rest.mean_pa, nan=np.inf).max(axis=1) > low_pa
    t = np.array([sample.t_s for sample in samples])
    last = np.flatnonzero(above)
    took = 0.0 if not last.size else np.nan if last[-1] + 1 >= t.size else t[last[-1] + 1] - t[0]
    return Vent(chamber, readings[0] - at_rest.mean_pa, readings[-1] - at_rest.mean_pa, low_pa, float(took))


def _readings(samples: Sequence[CycleSample]) -> tuple[Array, np.ndarray]:
    return np.array([s.reading_pa for s in samples]), np.array([s.fresh for s in samples], dtype=bool)


def _last(samples: Sequence[CycleSample], part: float) -> Sequence[CycleSample]:
    begin = samples[-1].t_s - part * (samples[-1].t_s - samples[0].t_s)
    return [sample for sample in samples if sample.t_s >= begin]


def _tip(samples: Sequence[CycleSample]) -> Array | None:
    tips = [sample.tip_m for sample in samples if sample.tip_m is not None]
    return np.mean(tips, axis=0) if tips else None


def _slope(t: Array, values: Array, use: np.ndarray) -> tuple[float, float]:
    """Return the slope of a straight line through the samples in `use`, and its standard error."""
    if use.sum() < 4:
        return 0.0, np.inf
    x, y = t[use] - t[use].mean(), values[use] - values[use].mean()
    slope = float(x @ y / (x @ x))
    residual = y - slope * x
    return slope, float(np.sqrt(residual @ residual / (x.size - 2) / (x @ x)))


def _t63(t: Array, values: Array, fresh: np.ndarray, end: float) -> float:
    """Return the time of the first of two consecutive readings beyond 63 % of the change; else nan."""
    times, y = t[fresh] - t[0], values[fresh]
    if y.size < 4 or not np.isfinite(end):
        return float("nan")
    start = y[0]
    done = (y - start) * np.sign(end - start) >= T63 * abs(end - start)
    both = np.flatnonzero(done[:-1] & done[1:])
    return float(times[both[0]]) if both.size else float("nan")
