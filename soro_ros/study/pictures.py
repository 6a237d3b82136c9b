"""The picture of a study: how tip errors are distributed, verdicts, and errors over keys of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from soro_lab.reporting.drawing import COLOURS
from soro_ros.study.summary import WORDS, bootstrapped, correlations, figure, pairs, share

# Most keys that are drawn: those that the error depends on most.
_MOST = 4


def draw(rows: Sequence[Mapping[str, Any]], keys: Sequence[str], path: Path) -> None:
    """Draw the rows of a study.

    Parameters
    ----------
    rows : sequence of mapping
    keys : sequence of str
        Those that vary.
    path : Path
        Picture to write.
    """
    by_rank = correlations(rows, keys)
    shown = sorted(by_rank, key=lambda key: -abs(by_rank[key]))[:_MOST]
    with mpl.rc_context({"font.size": 8.5, "axes.titlesize": 9, "axes.titlelocation": "left"}):
        drawn = Figure(figsize=(9.0, 3.2 * (1 + (len(shown) + 1) // 2)), layout="constrained")
        axes = drawn.subplots(1 + (len(shown) + 1) // 2, 2, squeeze=False)
        _draw_errors(axes[0, 0], rows)
        _draw_verdicts(axes[0, 1], rows)
        for place, key in zip(axes[1:].flat, shown, strict=False):
            x, y = pairs(rows, key)
            place.plot(x, y, ".", ms=4, color=COLOURS[0], alpha=0.6)
            place.set_title(f"rank correlation {by_rank[key]:.2f}")
            place.set_xlabel(key)
            place.set_ylabel("tip error RMS, mm")
        for place in axes[1:].flat[len(shown) :]:
            place.set_visible(False)
        drawn.savefig(path, dpi=150)


def _draw_errors(axes: Any, rows: Sequence[Mapping[str, Any]]) -> None:
    errors = np.sort(figure(rows, "tip_error_last_rms_m"))
    axes.set_title(f"tip error of {len(errors)} runs")
    axes.set_xlabel("tip error RMS of the last seconds, mm")
    axes.set_ylabel("share of runs below")
    if not len(errors):
        return
    axes.step(errors, np.arange(1, len(errors) + 1) / len(errors), where="post", color=COLOURS[0])
    middle = bootstrapped(errors, np.median)
    axes.axvline(middle.value, color=COLOURS[1], label=f"median {middle} mm")
    if np.isfinite(middle.low):
        axes.axvspan(middle.low, middle.high, color=COLOURS[1], alpha=0.2, lw=0)
    axes.legend(frameon=False)


def _draw_verdicts(axes: Any, rows: Sequence[Mapping[str, Any]]) -> None:
    for place, word in enumerate(WORDS):
        count = sum(row["verdict"] == word for row in rows)
        found = share(count, len(rows))
        off = [[max(found.value - found.low, 0.0)], [max(found.high - found.value, 0.0)]]
        axes.barh(place, found.value, color=COLOURS[2])
        axes.errorbar(found.value, place, xerr=off, color="0.2", capsize=3)
    axes.set_yticks(range(len(WORDS)), WORDS)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("share of runs, with its interval of 95 %")
    axes.set_title("verdicts")
