"""Latency of the loop: from a command to its set point sent, to the exchange, to the first motion, to 63 %.

Small steps up and down, one chamber at a time, each within one cycle. Superimposed, the steps give dead time
and lag with a resolution finer than the cycle.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.optimize import least_squares

from soro_core.arrays import Array
from soro_core.config import Strict
from soro_core.pneumatics.lag import follow
from soro_core.pneumatics.regulator import RegulatorModel
from soro_hardware.finding import Finding
from soro_hardware.hil.measured import T63
from soro_hardware.hil.paced import CycleSample

# A reading has moved if it is beyond so many standard deviations of its noise, twice in a row.
NOISE_STD = 4.0
# Last part of the previous step, from which level and noise are taken.
BEFORE_PART = 0.4
# Most cycles of a step in a driver that limits the slew.
SLEWED_CYCLES = 8
# Largest deviation from the platform's model without a warning: lag, relative; dead time [s].
LAG_PART, DEAD_S = 0.25, 0.01


class LatencyConfig(Strict):
    """Steps of the measurement."""

    low_pa: float = Field(5e3, ge=2e3, le=500e3, description="set point before a step up [Pa gauge]")
    step_pa: float = Field(4e3, ge=1e3, le=20e3, description="height of a step [Pa]")
    repeat: int = Field(10, ge=2, le=200, description="steps up, and as many down, of each chamber")
    hold_s: float = Field(0.5, ge=0.1, le=20, description="time between steps")


@dataclass(frozen=True)
class Times:
    """Median, 99th percentile and maximum of times [s]."""

    p50_s: float
    p99_s: float
    max_s: float


@dataclass(frozen=True)
class ChamberLatency:
    """Latency of one chamber.

    Attributes
    ----------
    name : str
        Name of the chamber.
    steps : int
        Number of evaluated steps.
    waited : Times
        Times from a command to the first set point sent for it.
    moved : Times
        Times from the set point sent to the return of the first reading beyond the noise.
    t63_up_s, t63_down_s : float
        Median time to 63 % of a step.
    dead_s, lag_s, gain : float
        First-order lag with dead time fitted to all steps up; `dead_s` is the time from the set point sent
        to the return of the readings, which includes bus and device.
    time_s, change : ndarray (n,)
        All fresh readings of the steps up: time since the set point [s], and change as a part of the step.
    """

    name: str
    steps: int
    waited: Times
    moved: Times
    t63_up_s: float
    t63_down_s: float
    dead_s: float
    lag_s: float
    gain: float
    time_s: Array
    change: Array


@dataclass(frozen=True)
class Latency:
    """Latencies: rate of the cycle [Hz], exchange of all cycles, and each chamber."""

    cycle_hz: float
    exchange: Times
    chambers: tuple[ChamberLatency, ...]


def evaluate(
    config: LatencyConfig, names: Sequence[str], cycle_hz: float, runs: Sequence[Sequence[CycleSample]]
) -> Latency:
    """Return the latencies from all steps.

    Parameters
    ----------
    config : LatencyConfig
        Steps.
    names : sequence of str
        Names of the chambers.
    cycle_hz : float
        Rate of the cycle [Hz].
    runs : sequence of sequence of CycleSample
        Samples of each chamber.
    """
    took = [sample.took_s for samples in runs for sample in samples if sample.fresh.any()]
    chambers = tuple(
        _chamber(config, name, chamber, samples)
        for chamber, (name, samples) in enumerate(zip(names, runs, strict=True))
    )
    return Latency(cycle_hz, _times(took), chambers)


def compare(latency: Latency, response: RegulatorModel, update_hz: float) -> list[Finding]:
    """Compare measured lags and dead times with the platform's model, which the limiter's monitors use.

    Parameters
    ----------
    latency : Latency
        Measured latencies.
    response : RegulatorModel
    update_hz : float
        Rate of exchanges of a chamber [Hz]; set points and readings may each wait for one exchange.

    Returns
    -------
    list of Finding
        One finding for each chamber.
    """
    findings = []
    period_s = 1.0 / update_hz
    for chamber in latency.chambers:
        found = f"dead time {chamber.dead_s * 1e3:.1f} ms, lag {chamber.lag_s * 1e3:.1f} ms"
        known = f"{response.delay_s * 1e3:.1f} and {response.tau_s * 1e3:.1f} ms"
        off = abs(chamber.lag_s - response.tau_s) > LAG_PART * response.tau_s
        # Set points and readings may each wait for an exchange on the bus.
        off |= not -DEAD_S < chamber.dead_s - response.delay_s < DEAD_S + 2 * period_s
        advice = "put delay_s and tau_s under regulator in the platform file: the monitors use them"
        text = f"{found}; platform: {known}"
        name = f"{chamber.name}: response"
        findings.append(Finding(name, "warn", text, advice) if off else Finding(name, "ok", text))
    return findings


def _chamber(
    config: LatencyConfig, name: str, chamber: int, samples: Sequence[CycleSample]
) -> ChamberLatency:
    t = np.array([sample.t_s for sample in samples])
    in_hand = t + np.array([sample.took_s for sample in samples])
    wanted = np.array([sample.wanted_pa[chamber] for sample in samples])
    given = np.flatnonzero(wanted[1:] != wanted[:-1]) + 1
    sent = np.array([sample.sent_pa[chamber] for sample in samples])
    fresh = np.array([sample.fresh[chamber] for sample in samples])
    reading = np.array([sample.reading_pa[chamber] for sample in samples])
    waited: list[float] = []
    moved: list[float] = []
    t63: dict[int, list[float]] = {1: [], -1: []}
    times, changes = [], []
    # Devices round set points, hence the tolerance; steps from and to zero are excluded.
    where = (np.abs(sent - config.low_pa - config.step_pa) < 0.1 * config.step_pa).astype(int)
    where -= np.abs(sent - config.low_pa) < 0.1 * config.step_pa
    steps = itertools.dropwhile(lambda step: step[1] < 0, _steps(where))
    for at, sign in steps:
        inside = fresh & (t >= t[at]) & (t < t[at] + config.hold_s)
        before = fresh & (t < t[at]) & (t >= t[at] - BEFORE_PART * config.hold_s)
        if before.sum() < 2 or inside.sum() < 3:
            continue
        level, noise = reading[before].mean(), reading[before].std()
        since, change = in_hand[inside] - t[at], sign * (reading[inside] - level)
        waited.append(float(t[at] - t[given[given <= at][-1]]))
        # The first reading of a step precedes the effect of its set point, and is part of the noise.
        moved.append(_first(since, change, max(NOISE_STD * noise, 0.05 * config.step_pa)))
        late = since >= (1 - BEFORE_PART) * config.hold_s
        t63[sign].append(_first(since, change, T63 * float(change[late].mean())) if late.any() else np.nan)
        if sign > 0:
            times.append(since)
            changes.append(change / config.step_pa)
    all_times = np.concatenate(times) if times else np.zeros(0)
    all_changes = np.concatenate(changes) if changes else np.zeros(0)
    dead, lag, gain = _fit(all_times, all_changes)
    up, down = (float(np.nanmedian(t63[sign])) if t63[sign] else float("nan") for sign in (1, -1))
    found = _times(waited), _times(moved), up, down, dead, lag, gain, all_times, all_changes
    return ChamberLatency(name, len(moved), *found)


def _steps(where: NDArray[np.int_]) -> Iterator[tuple[int, int]]:
    """Yield the index and the direction (up 1, down -1) of steps; `where` is 1 for high, -1 for low, else 0.

    Some devices take several cycles for a step.
    """
    left = np.flatnonzero((where[:-1] != 0) & (where[1:] != where[:-1])) + 1
    for at in left:
        length = int(np.argmax(where[at:] != 0))
        if where[at + length] == -where[at - 1] and length <= SLEWED_CYCLES:
            yield int(at), int(where[at + length])


def _first(t: Array, values: Array, above: float) -> float:
    """Return the time of the first of two consecutive values above a threshold, else nan."""
    both = np.flatnonzero((values[:-1] >= above) & (values[1:] >= above))
    return float(t[both[0]]) if both.size else float("nan")


def _fit(t: Array, change: Array) -> tuple[float, float, float]:
    """Return dead time [s], lag [s] and gain of the best first-order lag with dead time."""
    if t.size < 4:
        return float("nan"), float("nan"), float("nan")

    def residual(x: Array) -> Array:
        return response(t, *x) - change

    span = float(t.max())
    best = min(
        (
            least_squares(residual, [dead, lag, 1.0], bounds=([0.0, 1e-4, 0.1], [span, span, 3.0]))
            for dead in (0.01 * span, 0.1 * span)
            for lag in (0.05 * span, 0.2 * span)
        ),
        key=lambda found: found.cost,
    )
    return float(best.x[0]), float(best.x[1]), float(best.x[2])


def response(t: Array, dead_s: float, lag_s: float, gain: float) -> Array:
    """Return the response of a first-order lag with dead time to a unit step at 0.

    Parameters
    ----------
    t : ndarray (n,)
        Times [s].
    dead_s, lag_s : float
        Dead time and time constant [s].
    gain : float
        Final value.

    Returns
    -------
    ndarray (n,)
    """
    return follow(np.zeros_like(t), gain, np.maximum(t - dead_s, 0.0), lag_s)


def _times(values: Sequence[float]) -> Times:
    known = np.array([value for value in values if np.isfinite(value)])
    if not known.size:
        return Times(np.nan, np.nan, np.nan)
    return Times(float(np.percentile(known, 50)), float(np.percentile(known, 99)), float(known.max()))
