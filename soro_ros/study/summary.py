"""What the rows of a study say: shares of verdicts, and figures with confidence intervals."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from soro_core.arrays import Array

LEVEL = 0.95
WORDS = ("good", "poor", "lost", "vented", "refused")
# Figures of the summary, with their factor and unit.
SHOWN = {
    "tip_error_last_rms_m": ("tip error RMS of the last seconds", 1e3, "mm"),
    "tip_error_last_max_m": ("tip error max of the last seconds", 1e3, "mm"),
    "estimator_error_last_rms_m": ("estimator's tip error RMS", 1e3, "mm"),
    "settling_s": ("settling time", 1.0, "s"),
    "pressure_max_pa": ("highest measured pressure", 1e-3, "kPa"),
}
_STATISTICS: dict[str, Callable[..., Any]] = {
    "mean": np.mean,
    "median": np.median,
    "95 % below": lambda x, axis: np.quantile(x, 0.95, axis=axis),
}
_RESAMPLES, _SEED, _FEWEST = 2000, 1, 3


@dataclass(frozen=True)
class Interval95:
    """A number, and the ends of its confidence interval at `LEVEL`; NaN where runs are too few for one."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        if not np.isfinite(self.low):
            return f"{self.value:.4g}"
        return f"{self.value:.4g} ({self.low:.4g} to {self.high:.4g})"


def share(count: int, of: int) -> Interval95:
    """Return a share of runs, with the interval of Wilson."""
    ends = stats.binomtest(count, of).proportion_ci(LEVEL, method="wilson")
    return Interval95(count / of, float(ends.low), float(ends.high))


def bootstrapped(values: Array, statistic: Callable[..., Any]) -> Interval95:
    """Return a statistic of values (n,), with the percentiles of a bootstrap, the same each time."""
    value = float(statistic(values, axis=0))
    if len(values) < _FEWEST or np.ptp(values) == 0.0:
        return Interval95(value, np.nan if len(values) < _FEWEST else value, value)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)
        found = stats.bootstrap(
            (values,),
            statistic,
            n_resamples=_RESAMPLES,
            batch=100,
            confidence_level=LEVEL,
            method="percentile",
            random_state=np.random.default_rng(_SEED),
        ).confidence_interval
    return Interval95(value, float(found.low), float(found.high))


def figure(rows: Sequence[Mapping[str, Any]], name: str) -> Array:
    """Return the values of a figure that are known, in the unit of `SHOWN`."""
    values = np.array([row[name] for row in rows if row[name] is not None], dtype=float)
    known: Array = values[np.isfinite(values)] * SHOWN[name][1]
    return known


def summary_of(rows: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> dict[str, Any]:
    """Return the summary of rows as plain values.

    Parameters
    ----------
    rows : sequence of mapping
    keys : sequence of str
        Those that vary.
    """
    words = Counter(row["verdict"] for row in rows)
    figures = {}
    for name, (_, _, unit) in SHOWN.items():
        values = figure(rows, name)
        if len(values):
            found = {kind: vars(bootstrapped(values, of)) for kind, of in _STATISTICS.items()}
            figures[name] = {"unit": unit, "runs": len(values), **found}
    return {
        "runs": len(rows),
        "level": LEVEL,
        "verdicts": {word: vars(share(words[word], len(rows))) for word in WORDS if words[word]},
        "figures": figures,
        "rank_correlation_with_tip_error": correlations(rows, keys),
    }


def correlations(rows: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> dict[str, float]:
    """Return Spearman's rank correlation of each key of numbers with the tip error."""
    found = {}
    for key in keys:
        x, y = pairs(rows, key)
        if len(x) >= _FEWEST and np.ptp(x) > 0.0 and np.ptp(y) > 0.0:
            found[key] = float(stats.spearmanr(x, y).statistic)
    return found


def pairs(rows: Sequence[Mapping[str, Any]], key: str) -> tuple[Array, Array]:
    """Return values of a key and tip errors [mm] of the runs that have both as numbers, (n,) each."""
    name = "tip_error_last_rms_m"
    both = [(row[key], row[name]) for row in rows if row[name] is not None and np.isfinite(row[name])]
    numbers = [pair for pair in both if isinstance(pair[0], int | float) and not isinstance(pair[0], bool)]
    x, y = np.array(numbers, dtype=float).reshape(-1, 2).T
    return x, y * SHOWN[name][1]
