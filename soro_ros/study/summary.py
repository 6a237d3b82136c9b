"""What the rows of a study say: shares of verdicts, and figures with confidence intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy import stats

from soro_core.arrays import Array
from soro_ros.study.variations import is_number

Rows: TypeAlias = Sequence[Mapping[str, Any]]
LEVEL = 0.95
WORDS = ("good", "poor", "lost", "vented", "refused")
ERROR = "tip_error_last_rms_m"
# Figures of the summary: name, factor and unit.
SHOWN = {
    ERROR: ("tip error RMS of the last seconds", 1e3, "mm"),
    "tip_error_last_max_m": ("tip error max of the last seconds", 1e3, "mm"),
    "estimator_error_last_rms_m": ("estimator's tip error RMS", 1e3, "mm"),
    "settling_s": ("settling time", 1.0, "s"),
    "pressure_max_pa": ("highest measured pressure", 1e-3, "kPa"),
}
STATISTICS: dict[str, Callable[..., Any]] = {
    "mean": np.mean,
    "median": np.median,
    "95 % below": lambda x, axis: np.quantile(x, 0.95, axis=axis),
}
_RESAMPLES, _SEED, _FEWEST = 2000, 1, 3


@dataclass(frozen=True)
class ConfidenceInterval:
    """A number, and the ends of its interval at `LEVEL`; NaN where runs are too few for one."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        ends = f" ({self.low:.4g} to {self.high:.4g})" if np.isfinite(self.low) else ""
        return f"{self.value:.4g}{ends}"


def share(count: int, of: int, factor: float = 1.0) -> ConfidenceInterval:
    """Return a share of runs, with the interval of Wilson.

    Parameters
    ----------
    count, of : int
        Number of the runs, and of all.
    factor : float
        100 for per cent.
    """
    ends = stats.binomtest(count, of).proportion_ci(LEVEL, method="wilson")
    return ConfidenceInterval(*(factor * float(x) for x in (count / of, ends.low, ends.high)))


def bootstrapped(values: Array, statistic: Callable[..., Any]) -> ConfidenceInterval:
    """Return a statistic of values (n,), with the percentiles of a bootstrap, the same each time."""
    value = float(statistic(values, axis=0))
    if len(values) < _FEWEST or np.ptp(values) == 0.0:
        ends = [np.nan if len(values) < _FEWEST else value] * 2
    else:
        rng, options = np.random.default_rng(_SEED), {"method": "percentile", "confidence_level": LEVEL}
        found = stats.bootstrap(
            (values,), statistic, n_resamples=_RESAMPLES, batch=100, random_state=rng, **options
        )
        ends = list(found.confidence_interval)
    return ConfidenceInterval(value, *map(float, ends))


def figure(rows: Rows, name: str) -> Array:
    """Return the values of a figure that are known, in the unit of `SHOWN`."""
    return np.array([row[name] for row in rows if row[name] is not None], dtype=float) * SHOWN[name][1]


def summary_of(rows: Rows, keys: Sequence[str]) -> dict[str, Any]:
    """Return the summary of rows as plain values; `keys` are those that vary."""
    count = {word: sum(row["verdict"] == word for row in rows) for word in WORDS}
    figures = {
        name: {"unit": SHOWN[name][2], "runs": len(values)}
        | {kind: vars(bootstrapped(values, of)) for kind, of in STATISTICS.items()}
        for name in SHOWN
        if len(values := figure(rows, name))
    }
    return {
        "runs": len(rows),
        "level": LEVEL,
        "verdicts": {word: vars(share(n, len(rows))) for word, n in count.items() if n},
        "figures": figures,
        "rank_correlation_with_tip_error": correlations(rows, keys),
    }


def correlations(rows: Rows, keys: Sequence[str]) -> dict[str, float]:
    """Return Spearman's rank correlation of each key of numbers with the tip error."""
    both = {key: pairs(rows, key) for key in keys}
    several = {key: xy for key, xy in both.items() if len(xy) >= _FEWEST and np.ptp(xy, axis=0).all()}
    return {key: float(stats.spearmanr(xy).statistic) for key, xy in several.items()}


def pairs(rows: Rows, key: str) -> Array:
    """Return the values of a key and the tip errors [mm] of the runs that have both as numbers, (n, 2)."""
    both = [(row[key], 1e3 * row[ERROR]) for row in rows if row[ERROR] is not None and is_number(row[key])]
    return np.array(both, dtype=float).reshape(-1, 2)
