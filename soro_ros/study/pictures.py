"""The picture of a study: how tip errors are distributed, verdicts, and errors over keys of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from soro_lab.reporting.drawing import COLOURS
from soro_ros.study.summary import ERROR, WORDS, Rows, bootstrapped, correlations, figure, pairs, share

# Most keys that are drawn: those that the error depends on most.
_MOST = 4


def draw(rows: Rows, keys: Sequence[str], path: Path) -> None:
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
    lines = 1 + (len(shown) + 1) // 2
    drawn = Figure(figsize=(9.0, 3.2 * lines), layout="constrained")
    axes = drawn.subplots(lines, 2, squeeze=False).flat
    of_errors, of_verdicts = next(axes), next(axes)
    if len(errors := np.sort(figure(rows, ERROR))):
        of_errors.step(errors, np.arange(1, len(errors) + 1) / len(errors), where="post", color=COLOURS[0])
        middle = bootstrapped(errors, np.median)
        of_errors.axvline(middle.value, color=COLOURS[1], label=f"median {middle} mm")
        if np.isfinite(middle.low):
            of_errors.axvspan(middle.low, middle.high, color=COLOURS[1], alpha=0.2, lw=0)
        of_errors.legend(frameon=False)
    of_errors.set(xlabel="tip error RMS of the last seconds, mm", ylabel=f"share of {len(errors)} runs below")
    for place, word in enumerate(WORDS):
        found = share(sum(row["verdict"] == word for row in rows), len(rows))
        of_verdicts.barh(place, found.value, color=COLOURS[2])
        of_verdicts.plot([found.low, found.high], [place, place], color="0.2", marker="|")
    of_verdicts.set_yticks(range(len(WORDS)), WORDS)
    of_verdicts.invert_yaxis()
    of_verdicts.set(xlim=(0.0, 1.0), xlabel="share of runs, with its interval of 95 %")
    for place, key in zip(axes, shown, strict=False):
        place.plot(*pairs(rows, key).T, ".", ms=4, color=COLOURS[0], alpha=0.6)
        place.set(xlabel=key, ylabel="tip error RMS, mm", title=f"rank correlation {by_rank[key]:.2f}")
    if len(shown) % 2:
        drawn.axes[-1].set_visible(False)
    drawn.savefig(path, dpi=150)
