"""What a recorded run shows of the cause of its error."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from soro_core.arrays import Array
from soro_lab.scene import Scene
from soro_ros.recordings import report
from soro_ros.recordings.causes import Bound, Evidence
from soro_ros.recordings.events import warnings_at
from soro_ros.recordings.recording import EMPTY, RunRecording, TopicSeries, has_stage
from soro_ros.recordings.wiring_of_run import wiring_answers

# Samples a second in which a swing is looked for; frequencies [Hz] below which it is the reference's motion.
_RATE_HZ, _SLOW_HZ = 100.0, 0.6
_HALF = round(0.5 * report.WINDOW_S * _RATE_HZ)  # of the samples
# Harmonics of the reference that its own error has.
_HARMONICS = 3.5
# Part of the squared error of a swing, and of a swing's first half that the second has at least.
_SWING_PART, _LASTS_PART = 0.5, 0.5
# An error falls if a span of time has less than this part of that of the span before.
_FALLS_PART = 0.75
# Time [s] of a span where the reference has no period.
_SPAN_S = 0.5 * report.WINDOW_S
# Mean difference [Pa] between set point and pressure that a regulator has at most; its play is 900 Pa.
_OFF_PA = 3e3
_REACH = "a smaller motion or load; soro reach shows what the pressures can hold"


def evidence_of(recording: RunRecording, scene: Scene, summary: report.Summary) -> Evidence:
    """Return what a recording shows in its last 5 s.

    Parameters
    ----------
    recording : RunRecording
    scene : Scene
    summary : Summary
        Its figures.
    """
    length, end_s = scene.loaded_robot.length, min(scene.duration_s, summary.duration_s)
    said = warnings_at(recording.said, end_s)
    t, error = report.tip_error(recording, scene.duration_s)
    last = t >= end_s - report.WINDOW_S
    good = scene.verdict.good_part
    ticks = summary.duration_s * scene.rate_hz
    command = _last(recording.command, end_s)
    at_bound, bounded = summary.saturated_last_part, command
    if summary.saturated_part > max(scene.verdict.at_bound_part, at_bound):
        at_bound, bounded = summary.saturated_part, report.within(recording.command, end_s)
    doubt = _last(recording.force_doubt, end_s)
    touching = has_stage(doubt, "contact")
    pushed = recording.estimated_force.at(doubt.t[touching]) if touching.any() else np.zeros((1, 3))
    return Evidence(
        error=summary.tip_error_last_rms_m / length,
        good=good,
        controller=said.get("controller", ""),
        estimator=said.get("estimator", ""),
        at_bound=at_bound,
        at_slew=_at_slew(command, scene),
        held=_held(bounded.value, scene),
        bound=binding_bound(bounded.value, scene),
        swing_hz=swing_hz(_last(_away(recording), end_s), _period(scene), good * length),
        pressure_off=_pressure_off(command, _last(recording.reading, end_s)),
        estimator_error=summary.estimator_error_last_rms_m / length,
        good_at_s=good_at_s(t, error, scene, good * length),
        free=float(np.mean(error[last] < 0.5 * good * length)) if last.any() else 0.0,
        late=summary.overruns / ticks if scene.mode == "real_time" and ticks else 0.0,
        touching=float(touching.mean()) if touching.size else 0.0,
        pushed_n=float(np.linalg.norm(pushed, axis=1).max()),
        learns=scene.controller.adapt,
        answers=wiring_answers(recording, scene),
    )


def binding_bound(command_pa: Array, scene: Scene) -> Bound:
    """Return the bound at which most set points (n, n_u) [Pa gauge] are, and who states it."""
    low, high = report.pressure_bounds(scene)
    if np.sum(command_pa >= high - 1.0) >= np.sum(command_pa <= low + 1.0):
        return next(_stated(scene, "maximum_pa", 1, high))
    return next(_stated(scene, "minimum_pa", 0, low))


def _held(command_pa: Array, scene: Scene) -> float:
    """Return the largest part of the time for which one chamber is at one bound; set points (n, n_u) [Pa]."""
    low, high = report.pressure_bounds(scene)
    ends = (command_pa >= high - 1.0, command_pa <= low + 1.0)
    return max((float(end.mean(axis=0).max()) for end in ends if end.size), default=0.0)


def _stated(scene: Scene, key: str, end: int, bound_pa: float) -> Iterator[Bound]:
    """Yield who states a bound: raised elsewhere, it would stay as long as one of the first does."""
    robot, platform = scene.loaded_robot, scene.loaded_platform
    most = f"{1e-3 * bound_pa:g} kPa"
    wider = "if the arm bears more" if end else "if the valves can draw"
    rows: list[tuple[str, float | None, str]] = [
        (f"pressure_range_pa of {robot.name}", robot.pressure_range_pa[end], _REACH),
        (
            f"range of {Path(scene.platform).stem}",
            None if platform is None else getattr(platform.range, key),
            f"{_REACH}; or other valves",
        ),
        (f"limits.{key}", getattr(scene.limits, key), f"{wider}, state another limits.{key} with its trips"),
        (
            f"controller.pressures.{key}",
            getattr(scene.controller.pressures, key),
            f"{wider}, state another controller.pressures.{key}",
        ),
    ]
    for name, stated_pa, step in rows:
        if stated_pa is not None and abs(stated_pa - bound_pa) <= 1.0:
            yield Bound(f"{name}, {most},", step)
    yield Bound(most, _REACH)


def swing_hz(away: TopicSeries, period_s: float, good_m: float) -> float:
    """Return the frequency at which the tip swings about its reference [Hz]; NaN if it does not.

    A swing is faster than the reference, has most of the squared error, and lasts.

    Parameters
    ----------
    away : TopicSeries
        Vectors (n, 3) from the reference to the tip over the last 5 s [m].
    period_s : float
        Period of the reference [s]; 0 without one.
    good_m : float
        Error of a good run [m].
    """
    if away.t.size < 2:
        return math.nan
    error = away.at(away.t[-1] - np.arange(2 * _HALF)[::-1] / _RATE_HZ)
    varying = error - error.mean(axis=0)
    along = varying @ np.linalg.svd(varying, full_matrices=False)[2][0]
    hz, waves = np.fft.rfftfreq(2 * _HALF, 1.0 / _RATE_HZ), np.fft.rfft(along)
    waves[hz < max(_SLOW_HZ, _HARMONICS / (period_s or math.inf))] = 0.0
    fast = np.fft.irfft(waves, 2 * _HALF)
    first, second = np.split(fast**2, 2)
    square = float(np.mean(fast**2))
    is_swing = (
        square > _SWING_PART * float(np.mean(np.sum(error**2, axis=1)))
        and square > (0.5 * good_m) ** 2
        and second.mean() > _LASTS_PART**2 * first.mean()
    )
    return float(hz[np.argmax(np.abs(waves))]) if is_swing else math.nan


def good_at_s(t: Array, error: Array, scene: Scene, good_m: float) -> float:
    """Return the time [s] at which an error that still falls will be good; NaN if it does not fall.

    Parameters
    ----------
    t, error : ndarray (n,)
        Times [s] and errors [m].
    scene : Scene
    good_m : float
        Error of a good run [m].
    """
    span_s = _period(scene) or _SPAN_S
    end_s = float(t[-1]) if t.size else 0.0
    if end_s - 2.0 * span_s < scene.controller.reference.start_s:
        return math.nan
    before = error[(t >= end_s - 2.0 * span_s) & (t < end_s - span_s)]
    after = error[t >= end_s - span_s]
    was, now = (float(np.sqrt(np.mean(part**2))) for part in (before, after))
    if not 0.0 < now < _FALLS_PART * was:
        return math.nan
    spans = max(math.log(0.8 * good_m / now) / math.log(now / was), 0.0)
    return math.ceil(end_s + spans * span_s + report.WINDOW_S)


def _away(recording: RunRecording) -> TopicSeries:
    """Return the vectors (n, 3) from the reference to the tip [m]."""
    true, wanted = recording.true_tip, recording.wanted_tip
    if min(true.t.size, wanted.t.size) < 2:
        return EMPTY
    return TopicSeries(true.t, true.value - wanted.at(true.t))


def _period(scene: Scene) -> float:
    """Period of the reference [s]; 0 without one."""
    reference = scene.controller.reference
    return reference.period_s if reference.kind == "circle" else 0.0


def _last(series: TopicSeries, end_s: float) -> TopicSeries:
    """Return the last 5 s of a series."""
    found = report.within(series, end_s)
    last = found.t >= end_s - report.WINDOW_S
    return TopicSeries(found.t[last], found.value[last], found.names)


def _at_slew(command: TopicSeries, scene: Scene) -> float:
    """Part of the changes of set points at a limit of rate."""
    if command.t.size < 2:
        return 0.0
    rate = np.diff(command.value, axis=0) / np.maximum(np.diff(command.t), 1e-6)[:, None]
    pressures, _ = scene.controller_node().known_pressures(scene.loaded_platform)
    return float(np.mean((rate > 0.99 * pressures.rise_pa_s) | (rate < -0.99 * pressures.fall_pa_s)))


def _pressure_off(command: TopicSeries, reading: TopicSeries) -> str:
    """Name the chamber whose mean pressure is furthest from its mean set point, if that is too far."""
    if min(command.t.size, reading.t.size) < 2 or command.names != reading.names:
        return ""
    found = np.nanmean(reading.value - command.at(reading.t), axis=0)
    worst = int(np.nanargmax(np.abs(found)))
    if abs(found[worst]) <= _OFF_PA:
        return ""
    side = "above" if found[worst] > 0.0 else "below"
    return (
        f"the pressure of {command.names[worst]} is {1e-3 * abs(found[worst]):.1f} kPa {side} its set point"
    )
