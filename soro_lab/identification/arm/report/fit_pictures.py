"""Pictures of a fit: laws, correlations, profiles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from soro_lab.reporting.drawing import COLOURS, MEASURED, PREDICTED, WIDTH, Image, style, svg

_COLUMNS = 4  # of the profiles
_HIGHEST = 10.0  # rise that is shown
# A correlation above this is written into its cell, as long as there are not more numbers than this.
_STRONG, _READABLE = 0.5, 24


def laws_picture(laws: Sequence[Mapping[str, Any]], accept: float) -> Image:
    """Return the held-out error of each set of laws, one standard error of its difference to the best.

    Parameters
    ----------
    laws : sequence of mapping
        As report.json has them.
    accept : float
        Largest error allowed, in ranges moved.
    """
    with mpl.rc_context(style()):
        figure = Figure(figsize=(WIDTH, 0.34 * len(laws) + 0.9), layout="constrained")
        axes = figure.subplots()
        at = np.arange(len(laws))
        sizes = [100.0 * law["error"] for law in laws]
        colours = [PREDICTED if law["chosen"] else "#b8c4d0" for law in laws]
        spread = [100.0 * law["standard_error"] for law in laws]
        axes.barh(
            at,
            sizes,
            0.62,
            color=colours,
            xerr=spread,
            error_kw={"ecolor": MEASURED, "lw": 1.0, "capsize": 2},
        )
        axes.set_yticks(at, [law["name"] + ("  (chosen)" if law["chosen"] else "") for law in laws])
        axes.invert_yaxis()
        axes.set_xlabel("RMS error on what was held out, % of the range moved")
        if 100.0 * accept < 1.3 * max(sizes):
            axes.axvline(100.0 * accept, color=MEASURED, ls=":", lw=1.0)
            axes.text(100.0 * accept, -0.6, " allowed", fontsize=8, va="bottom")
        axes.grid(axis="y", visible=False)
        for y, size, spread_ in zip(at, sizes, spread, strict=True):
            axes.text(size + spread_, float(y), f"  {size:.3g}", va="center", fontsize=8)
        axes.set_xlim(0.0, 1.12 * max(a + b for a, b in zip(sizes, spread, strict=True)) or 1.0)
        return svg(figure)


def correlation_picture(correlation: Mapping[str, Any]) -> Image:
    """Return the correlations of all numbers as a map."""
    names, matrix = list(correlation["names"]), np.array(correlation["matrix"])
    size = float(np.clip(0.34 * len(names) + 2.2, 3.4, WIDTH))
    with mpl.rc_context(style()):
        figure = Figure(figsize=(size + 0.6, size), layout="constrained")
        axes = figure.subplots()
        axes.grid(False)
        image = axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
        small = 7.5 if len(names) <= _READABLE else 5.0
        short = [name.removeprefix("frame/") for name in names]
        axes.set_xticks(range(len(names)), short, rotation=90, fontsize=small)
        axes.set_yticks(range(len(names)), short, fontsize=small)
        if len(names) <= _READABLE:
            for i, j in zip(*np.nonzero(np.abs(matrix) > _STRONG), strict=True):
                if i != j:
                    colour = "white" if abs(matrix[i, j]) > 0.75 else "black"
                    text = f"{matrix[i, j]:.2f}".replace("0.", ".")
                    axes.text(float(j), float(i), text, ha="center", va="center", fontsize=5.5, color=colour)
        figure.colorbar(image, ax=axes, shrink=0.7, label="correlation")
        return svg(figure)


def profiles_picture(profiles: Sequence[Mapping[str, Any]]) -> Image:
    """Return the profile of each number beside the parabola of its deviation."""
    rows = -(-len(profiles) // _COLUMNS)
    k = np.linspace(-2.4, 2.4, 97)
    with mpl.rc_context(style()):
        figure = Figure(figsize=(WIDTH, 1.65 * rows + 0.3), layout="constrained")
        every = figure.subplots(rows, _COLUMNS, squeeze=False, sharex=True, sharey=True).ravel()
        for axes, each in zip(every, profiles, strict=False):
            axes.plot(k, k**2, color="0.6", lw=0.9, ls="--", label="parabola of the deviation")
            colour = PREDICTED if each["simulated"] else COLOURS[0]
            points = [*each["points"], {"at": 0.0, "rise": 0.0, "rise_of_data": 0.0}]
            points = sorted(points, key=lambda p: p["at"])
            at = [p["at"] for p in points]
            axes.plot(at, [p["rise"] for p in points], color=colour, marker="o", ms=3)
            axes.plot(at, [p["rise_of_data"] for p in points], color=colour, lw=0.7, ls=":")
            axes.set_title(each["name"].removeprefix("frame/"), fontsize=7.5)
            axes.set_xlim(-2.4, 2.4)
            axes.set_ylim(-0.6, _HIGHEST)
            axes.set_xticks([-2, -1, 0, 1, 2])
        for number, axes in enumerate(every):
            axes.set_visible(number < len(profiles))
            if number < len(profiles) and number + _COLUMNS >= len(profiles):
                axes.tick_params(labelbottom=True)
        figure.supxlabel("deviations from the solution", fontsize=8.5)
        figure.supylabel("rise of the cost (1: the parabola at one deviation)", fontsize=8.5)
        return svg(figure)
