"""Pictures of a report: of a fit (laws, correlations, profiles) and of its recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from soro_core.arrays import Array
from soro_lab.identification.arm.report.traces import ShapeTrace
from soro_lab.reporting.drawing import COLOURS, HELD_OUT, MEASURED, PREDICTED, WIDTH, Image, png, style, svg

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


# Inches: of one column of a shape, of the pressures, of what is left over.
_ROW, _PRESSURE, _LEFT = 0.95, 1.15, 1.15
_BEYOND = 3.0
# Expected errors up to which a histogram goes, and its bins.
_FAR, _BINS = 6.0, 60


def run_picture(trace: ShapeTrace) -> Image:
    """Return the picture of one shape of one run: each column, what is left over, and the pressures below."""
    heights = [_ROW] * sum(len(p.labels) for p in trace.panels) + [_LEFT, _PRESSURE]
    with mpl.rc_context(style()):
        figure = Figure(figsize=(WIDTH, sum(heights) + 0.6), layout="constrained")
        every = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        rows = iter(every)
        t = trace.stream.t
        for panel in trace.panels:
            for k, label in enumerate(panel.labels):
                axes = next(rows)
                _lines(axes, t, panel.measured[:, k], color=MEASURED, lw=1.4, label="measured")
                _lines(axes, t, panel.predicted[:, k], color=PREDICTED, lw=1.0, label="predicted")
                axes.set_ylabel(f"{label}, {panel.unit}")
                if k == 0:
                    axes.set_title(panel.title)
        left = next(rows)
        _left_over(left, trace)
        pressures = next(rows)
        recording = trace.recording
        inside = (recording.pressure.t >= t[0]) & (recording.pressure.t <= t[-1])
        columns = zip(recording.chambers, recording.pressure.values[inside].T, strict=True)
        for k, (name, column) in enumerate(columns):
            colour = COLOURS[k % len(COLOURS)]
            pressures.plot(recording.pressure.t[inside], 1e-3 * column, lw=0.9, color=colour, label=name)
        pressures.set_ylabel("kPa")
        pressures.set_title("pressures")
        pressures.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)
        pressures.set_xlabel("time, s")
        for axes in every:
            for start, end in trace.shaded:
                axes.axvspan(max(start, t[0]), min(end, t[-1]), color=HELD_OUT, lw=0, zorder=0)
        every[0].set_xlim(t[0], t[-1])
        figure.align_ylabels()
        handles, labels = every[0].get_legend_handles_labels()
        if trace.shaded:
            handles.append(mpl.patches.Patch(color=HELD_OUT))
            labels.append("held out of the fit")
        every[0].legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
        return png(figure)


def histogram(traces: Sequence[ShapeTrace]) -> Image:
    """Return how what is left over is distributed, in expected errors, beside the normal distribution."""
    shapes = list(dict.fromkeys(trace.shape for trace in traces))
    edges = np.linspace(-_FAR, _FAR, _BINS + 1)
    x = np.linspace(-_FAR, _FAR, 241)
    with mpl.rc_context(style()):
        figure = Figure(figsize=(WIDTH, 2.2 * ((len(shapes) + 1) // 2) + 0.2), layout="constrained")
        every = np.atleast_1d(figure.subplots((len(shapes) + 1) // 2, 2, squeeze=False)).ravel()
        for axes, shape in zip(every, shapes, strict=False):
            rows = np.concatenate([(t.differences / t.expected).ravel() for t in traces if t.shape == shape])
            own = np.clip(rows, -_FAR, _FAR)
            axes.hist(own, edges, density=True, color=COLOURS[0], alpha=0.55, label="left over")
            axes.plot(x, np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi), color=MEASURED, label="normal")
            axes.set_title(shape)
            axes.set_xlabel(f"measured minus predicted, in expected errors (ends: beyond {_FAR:g})")
            axes.set_ylabel("density")
            axes.legend(loc="upper right")
        for axes in every[len(shapes) :]:
            axes.set_visible(False)
        return svg(figure)


def _left_over(axes: Any, trace: ShapeTrace) -> None:
    t, rows = trace.stream.t, trace.differences / trace.expected
    size = np.abs(rows).max(axis=1)
    sizes = rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)]
    axes.axhline(_BEYOND, color="0.6", lw=0.7, ls="--")
    axes.axhline(-_BEYOND, color="0.6", lw=0.7, ls="--")
    _lines(axes, t, sizes, color=COLOURS[0], lw=0.7)
    off = size > _BEYOND
    axes.plot(t[off], sizes[off], ls="", marker=".", ms=2.5, color=PREDICTED)
    axes.set_ylabel("exp. errors")
    axes.set_title("largest difference of each sample, in expected errors; dashed: three")


def _lines(axes: Any, t: Array, values: Array, **how: Any) -> None:
    """Draw a line that ends at a gap of the samples."""
    gap = np.flatnonzero(np.diff(t) > 5.0 * np.median(np.diff(t))) if len(t) > 2 else np.zeros(0, int)
    axes.plot(np.insert(t, gap + 1, np.nan), np.insert(values, gap + 1, np.nan), **how)
