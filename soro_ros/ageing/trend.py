"""Numbers of an arm over days: their trend, and when the arm must be identified again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from soro_ros.ageing.history import RunEntry

# The arm must be identified again from this multiple of the error of its model when new.
AGAIN = 1.3
# Runs that say what the error is when new.
NEW = 3
# A trend is told from none by so many deviations.
TOLD = 3.0
STIFFNESS = "stiffness over that of the file"


@dataclass(frozen=True)
class Trend:
    """One number over the runs of an arm.

    Attributes
    ----------
    name : str
    days : tuple of float
        Times of the runs after the first run of the arm.
    values, deviations : tuple of float
        In each of these runs.
    per_day, deviation : float
        Slope of the line through the values, each with the weight of its deviation, and its deviation; the
        scatter about the line counts where it is more. NaN below three runs or within one instant.
    """

    name: str
    days: tuple[float, ...]
    values: tuple[float, ...]
    deviations: tuple[float, ...]
    per_day: float
    deviation: float

    @property
    def is_told(self) -> bool:
        """Whether the number changes with time."""
        return abs(self.per_day) > TOLD * self.deviation


@dataclass(frozen=True)
class Ageing:
    """What the runs of an arm say of its age.

    Attributes
    ----------
    runs : tuple of RunEntry
        With one robot file, the newest last.
    days : tuple of float
        Times of the runs after the first one.
    new_m : float
        Error of the model when new [m]: the median of the first runs; NaN where none has one.
    since : RunEntry or None
        The run from which on the error is beyond `AGAIN` times that; None where the newest one is not.
    trends : tuple of Trend
        That of the stiffness first, then one for each learned number.
    """

    runs: tuple[RunEntry, ...]
    days: tuple[float, ...]
    new_m: float
    since: RunEntry | None
    trends: tuple[Trend, ...]


def ageing(runs: Sequence[RunEntry]) -> Ageing:
    """Return what runs with one robot file, at least one and the newest last, say of the age of their arm."""
    days = tuple((run.when - runs[0].when).total_seconds() / 86400.0 for run in runs)
    known = [run for run in runs if run.error is not None]
    errors = [run.error.rms_m for run in known if run.error is not None]
    new = float(np.median(errors[:NEW])) if errors else float("nan")
    since = None
    for run, error in zip(reversed(known), reversed(errors), strict=True):
        if not error > AGAIN * new:
            break
        since = run
    return Ageing(tuple(runs), days, new, since, (*_stiffness(runs, days), *_learned(runs, days)))


def _stiffness(runs: Sequence[RunEntry], days: Sequence[float]) -> list[Trend]:
    own = [
        (day, run.error.stiffness, run.error.deviation)
        for run, day in zip(runs, days, strict=True)
        if run.error is not None
    ]
    return [trend(STIFFNESS, own)] if own else []


def _learned(runs: Sequence[RunEntry], days: Sequence[float]) -> list[Trend]:
    names = dict.fromkeys(name for run in runs for name in run.learned)
    return [
        trend(
            name,
            [(day, *run.learned[name]) for run, day in zip(runs, days, strict=True) if name in run.learned],
        )
        for name in names
    ]


def trend(name: str, samples: Sequence[tuple[float, float, float]]) -> Trend:
    """Return the line through samples.

    Parameters
    ----------
    name : str
    samples : sequence of tuple of float
        Day, value and deviation of each run, at least one.
    """
    days, values, deviations = np.array(samples).T
    slope = deviation = float("nan")
    if len(days) > 2 and np.ptp(days) > 0.0:
        weight = 1.0 / np.maximum(deviations, 1e-9 + 1e-6 * np.abs(values)) ** 2
        away = days - np.average(days, weights=weight)
        spread = float(weight @ away**2)
        slope = float(weight @ (away * values) / spread)
        left = values - np.average(values, weights=weight) - slope * away
        scatter = float(weight @ left**2 / (len(days) - 2))
        deviation = float(np.sqrt(max(1.0, scatter) / spread))
    return Trend(name, tuple(days), tuple(values), tuple(deviations), slope, deviation)


def lines(found: Ageing) -> list[str]:
    """Return what a person reads: runs, error, stiffness, learned numbers that change, and what to do."""
    first, last = found.runs[0], found.runs[-1]
    count = f"{len(found.runs)} runs" if len(found.runs) > 1 else "1 run"
    text = [f"{count} with this robot file, {first.when:%Y-%m-%d %H:%M} to {last.when:%Y-%m-%d %H:%M}"]
    known = [run.error for run in found.runs if run.error is not None]
    if not known:
        return [*text, "error of the model: not known, no run has a bag of tip and pressures"]
    text.append(
        f"error of the model: {1e3 * found.new_m:.3g} mm when new, {1e3 * known[-1].rms_m:.3g} mm now,"
        f" {known[-1].rms_m / found.new_m:.2f} times"
    )
    for one in found.trends:
        if one.name == STIFFNESS or one.is_told:
            text.append(f"{one.name}: {one.values[-1]:.4g} ± {one.deviations[-1]:.2g}, {_slope(one)}")
    quiet = sum(not one.is_told for one in found.trends if one.name != STIFFNESS)
    if quiet:
        text.append(f"{quiet} learned numbers have no trend beyond {TOLD:g} deviations")
    if found.since is not None:
        text.append(
            f"identify again: since {found.since.folder.name} the error is above {AGAIN:g} times that when"
            " new"
        )
    return text


def _slope(one: Trend) -> str:
    if not np.isfinite(one.per_day):
        return "no trend yet: three runs tell one"
    word = "a trend" if one.is_told else "no trend"
    return f"{one.per_day:+.2g} ± {one.deviation:.2g} a day, {word}"
