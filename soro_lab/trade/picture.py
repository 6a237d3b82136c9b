"""The picture of a study: error against cost, both on logarithmic axes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from soro_lab.trade.results import CandidateResult, Study

_FLOOR = 1e-6  # % of the length: nothing is shown below
_STYLES = {"exact": "o", "mde": "^"}
_COLUMNS = 2  # of the legend
_HEIGHT, _LINE = 4.9, 0.15  # of the plot, and of a line of the legend below it [inches]


def draw(study: Study, path: Path) -> bool:
    """Write the picture as PNG; return False if there is nothing to show."""
    figure = picture(study)
    if figure is not None:
        figure.savefig(path, dpi=120)
    return figure is not None


def picture(study: Study) -> Figure | None:
    """Return the picture; None if no row has both error and cost."""
    rows = [row for row in study.rows if row.complete]
    if not rows:
        return None
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    by_tick = not study.requirement.error

    def cost(row: CandidateResult) -> float:
        return row.tick_us if by_tick else 1e3 * row.cpu

    def line(shown: list[CandidateResult], style: str, **more: Any) -> Line2D:
        return axes.plot([cost(r) for r in shown], [max(r.tip, _FLOOR) for r in shown], style, **more)[0]

    colours = _colours(list(dict.fromkeys(row.candidate.space for row in rows)))
    for row in rows:
        marker, colour = _STYLES[row.candidate.model.method], colours[row.candidate.space]
        line([row], marker, color=colour, alpha=0.75, markersize=5)
    keys = [Line2D([], [], ls="", marker="s", color=c, label=space) for space, c in colours.items()]
    methods = {row.candidate.model.method for row in rows}
    keys += [Line2D([], [], ls="", marker=_STYLES[m], color="0.3", label=m) for m in sorted(methods)]
    keys.append(line(sorted(study.front, key=cost), "k-", lw=1.2, label="front"))
    own, unknown = study.reference.own.tip, study.reference.unknown
    text = f"own error of the reference, {own:.2g} %" + (", its basis apart" if unknown else "")
    keys.append(axes.axhline(max(own, _FLOOR), color="0.6", ls=":", label=text))
    requirement = study.requirement
    if by_tick:
        text = f"requirement: {requirement.tick_us:g} us"
        keys.append(axes.axvline(requirement.tick_us, color="C3", ls="--", label=text))
    else:
        text = f"requirement: {requirement.error_percent:g} %"
        keys.append(axes.axhline(requirement.error_percent, color="C3", ls="--", label=text))
    if study.choice is not None:
        keys.append(line([study.choice], "o", mfc="none", mec="C3", ms=13, mew=2, label="chosen"))
    axes.set_xlabel("longest tick, us of CPU" if by_tick else "CPU time, ms a simulated second")
    axes.set_ylabel("RMS error of the tip, % of the length")
    axes.set_title(f"{study.case.robot.name}: {len(rows)} of {study.combinations} combinations", fontsize=10)
    logarithmic(axes)
    figure.legend(handles=keys, loc="outside lower center", fontsize=7, ncols=_COLUMNS)
    figure.set_size_inches(7.5, _HEIGHT + _LINE * math.ceil(len(keys) / _COLUMNS))
    return figure


def logarithmic(axes: Axes) -> None:
    """Make both axes logarithmic, with a grid and readable labels."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis, set_limits in ((axes.xaxis, axes.set_xlim), (axes.yaxis, axes.set_ylim)):
        low, high = axis.get_view_interval()
        if high < 4 * low:  # the axis needs a label
            low, high = math.sqrt(low * high) / 2, math.sqrt(low * high) * 2
        set_limits(low, high)
        labelled = (1.0, 2.0, 5.0) if high < 300 * low else (1.0,)
        axis.set_major_locator(LogLocator(subs=labelled, numticks=9 if len(labelled) > 1 else 6))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="both", alpha=0.25)


def _colours(names: list[str]) -> dict[str, Any]:
    """Return a different colour for each name."""
    if len(names) <= 10:
        return {name: f"C{number}" for number, name in enumerate(names)}
    return {name: colormaps["turbo"](number / (len(names) - 1)) for number, name in enumerate(names)}
