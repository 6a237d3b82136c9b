"""Latency of the loop: from a set point sent to readings exchanged, to the first that moves, to 63 %.

Small steps up and down, one chamber at a time, each within one cycle; all of them laid over one another give
dead time and lag by a fit that is finer than the cycle.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.optimize import least_squares

from soro_core import safety
from soro_core.config import Strict
from soro_core.errors import ConfigError, HardwareError
from soro_core.hardware.finding import Finding
from soro_core.hardware.platform import PlatformBase
from soro_core.hardware.port import Array
from soro_core.hil.measured import T63
from soro_core.hil.paced import PacedRegulator, Sample, small_limits
from soro_core.pneumatics.regulator import RegulatorModel

# The limiter's steepest slew: what a step within one cycle may be at most.
STEEPEST_PA_S = 2e6
# A reading has moved beyond its noise by so many standard deviations, twice in a row.
NOISE_STD = 4.0
# Part of the step before it of which the level and the noise are taken.
BEFORE_PART = 0.4
# Cycles that a driver with a slew of its own may take for a step.
SLEWED_CYCLES = 8
# How far off the platform's model may be before the report says so.
LAG_PART, DEAD_S = 0.25, 0.01


class LatencyConfig(Strict):
    """Which steps."""

    low_pa: float = Field(5e3, ge=2e3, le=500e3, description="set point that steps begin from [Pa gauge]")
    step_pa: float = Field(4e3, ge=1e3, le=20e3, description="height of a step [Pa]")
    repeat: int = Field(10, ge=2, le=200, description="steps up, and as many down, of each chamber")
    hold_s: float = Field(0.5, ge=0.1, le=20, description="time between steps")


@dataclass(frozen=True)
class Times:
    """Seconds: half of all were shorter, 99 of 100 were, the longest."""

    p50_s: float
    p99_s: float
    max_s: float


@dataclass(frozen=True)
class ChamberLatency:
    """What the steps of one chamber say.

    Attributes
    ----------
    moved : Times
        From the set point sent to the first reading beyond the noise in hand.
    t63_up_s, t63_down_s : float
        Median time to 63 % of a step.
    dead_s, lag_s, gain : float
        Of the first order with dead time that fits all steps up: `dead_s` from the set point sent to the
        readings in hand, so with all that bus and device add.
    time_s, change : ndarray
        All fresh readings of the steps up, over the time since their set point, as parts of the step.
    """

    name: str
    steps: int
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
    """Exchanges of all cycles, and each chamber."""

    cycle_hz: float
    exchange: Times
    chambers: tuple[ChamberLatency, ...]


def latency_limits(platform: PlatformBase, config: LatencyConfig) -> safety.Limits:
    """Limits just above the steps, which let each of them happen within one cycle.

    Raises
    ------
    ConfigError
        If that is steeper than the limiter allows at all, or beyond the platform's range.
    """
    most_pa = config.low_pa + config.step_pa
    if most_pa > platform.range.maximum_pa:
        top = f"low_pa and step_pa together up to the platform's {platform.range.maximum_pa:g} Pa"
        raise ConfigError("latency", "step_pa", config.step_pa, top)
    slew_pa_s = 1.01 * config.step_pa * platform.cycle_hz
    if slew_pa_s > STEEPEST_PA_S:
        at_most = STEEPEST_PA_S / platform.cycle_hz / 1.01
        raise ConfigError("latency", "step_pa", config.step_pa, f"at most {at_most:.0f} Pa: one cycle's slew")
    return small_limits(platform, most_pa, slew_pa_s, slew_pa_s)


def measure(
    config: LatencyConfig, guarded: PacedRegulator, stopped: Callable[[], bool] = lambda: False
) -> list[list[Sample]]:
    """Make the steps; returns the samples of each chamber.

    Raises
    ------
    HardwareError
        When the limiter vents, or `stopped` says so; the chambers are vented then.
    """
    n = guarded.n_chambers
    cycles = max(round(config.hold_s / guarded.period_s), 1)
    found = []
    for chamber in range(n):
        samples: list[Sample] = []
        # From above, so that valves with play begin all steps up alike; the first way down is none of them.
        high = config.low_pa + config.step_pa
        for level in (high, high, *(config.low_pa, high) * config.repeat, config.low_pa, 0.0):
            wanted = np.zeros(n)
            wanted[chamber] = level
            for _ in range(cycles):
                if stopped():
                    guarded.vent("interrupted")
                samples.append(guarded.cycle(wanted))
                if samples[-1].cause is not None:
                    raise HardwareError(f"vented: {samples[-1].cause}")
        found.append(samples)
    return found


def evaluate(
    config: LatencyConfig, names: Sequence[str], cycle_hz: float, runs: Sequence[Sequence[Sample]]
) -> Latency:
    """Lay all steps of each chamber over one another."""
    took = [sample.took_s for samples in runs for sample in samples if sample.fresh.any()]
    chambers = tuple(
        _chamber(config, name, chamber, samples)
        for chamber, (name, samples) in enumerate(zip(names, runs, strict=True))
    )
    return Latency(cycle_hz, _times(took), chambers)


def compare(latency: Latency, response: RegulatorModel, update_hz: float) -> list[Finding]:
    """What was measured against the platform's model, which the monitors of the limiter believe.

    Parameters
    ----------
    update_hz : float
        How often a chamber is served; on a slow line its model has an update of delay more.
    """
    findings = []
    period_s = 1.0 / update_hz
    for chamber in latency.chambers:
        found = f"dead time {chamber.dead_s * 1e3:.1f} ms, lag {chamber.lag_s * 1e3:.1f} ms"
        known = f"{response.delay_s * 1e3:.1f} and {response.tau_s * 1e3:.1f} ms"
        off = abs(chamber.lag_s - response.tau_s) > LAG_PART * response.tau_s
        # Set points and readings may wait an update each for the bus.
        off |= not -DEAD_S < chamber.dead_s - response.delay_s < DEAD_S + 2 * period_s
        advice = "put delay_s and tau_s into emulation.regulator of the platform: the monitors use them"
        text = f"{found}; platform: {known}"
        name = f"{chamber.name}: response"
        findings.append(Finding(name, "warn", text, advice) if off else Finding(name, "ok", text))
    return findings


def _chamber(config: LatencyConfig, name: str, chamber: int, samples: Sequence[Sample]) -> ChamberLatency:
    t = np.array([sample.t_s for sample in samples])
    in_hand = t + np.array([sample.took_s for sample in samples])
    sent = np.array([sample.sent_pa[chamber] for sample in samples])
    fresh = np.array([sample.fresh[chamber] for sample in samples])
    reading = np.array([sample.reading_pa[chamber] for sample in samples])
    moved: list[float] = []
    t63: dict[int, list[float]] = {1: [], -1: []}
    times, changes = [], []
    # A device rounds what it is sent; steps from zero, and to it, are none of these.
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
        # The first reading of a step was taken before its set point could act: noise as well.
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
    return ChamberLatency(name, len(moved), _times(moved), up, down, dead, lag, gain, all_times, all_changes)


def _steps(where: NDArray[np.int_]) -> Iterator[tuple[int, int]]:
    """Where steps begin, and whether up (1) or down (-1), from where set points are: high 1, low -1, else 0.

    Some devices take a few cycles to go from one to the other.
    """
    left = np.flatnonzero((where[:-1] != 0) & (where[1:] != where[:-1])) + 1
    for at in left:
        came = int(np.argmax(where[at:] != 0))
        if where[at + came] == -where[at - 1] and came <= SLEWED_CYCLES:
            yield int(at), int(where[at + came])


def _first(t: Array, values: Array, above: float) -> float:
    """Time of the first of two values in a row above a threshold."""
    both = np.flatnonzero((values[:-1] >= above) & (values[1:] >= above))
    return float(t[both[0]]) if both.size else float("nan")


def _fit(t: Array, change: Array) -> tuple[float, float, float]:
    """Dead time, lag and gain of the first order that fits best."""
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
    """Answer of the first order with dead time to a unit step at 0."""
    return gain * (1.0 - np.exp(-np.maximum(t - dead_s, 0.0) / lag_s))


def _times(values: Sequence[float]) -> Times:
    known = np.array([value for value in values if np.isfinite(value)])
    if not known.size:
        return Times(np.nan, np.nan, np.nan)
    return Times(float(np.percentile(known, 50)), float(np.percentile(known, 99)), float(known.max()))
