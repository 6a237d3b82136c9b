"""The page of an arm over its runs, with pictures, and its numbers as report.json."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from soro_lab.reporting.drawing import MEASURED, PREDICTED, WIDTH, Image, style, svg
from soro_lab.reporting.html import Block, Bullets, Chapter, Page, Picture, Table, Words, number, write
from soro_ros.ageing.trend import AGAIN, NEW, STIFFNESS, Ageing, Trend, lines


def write_page(arm: str, found: Ageing, folder: Path) -> Path:
    """Write index.html, report.json and the folder pictures; return the page.

    Parameters
    ----------
    arm : str
        Its name.
    found : Ageing
        What its runs say.
    folder : Path
        Made where it does not exist.
    """
    content, text = _content(arm, found), lines(found)
    verdict = text[-1] if found.since is not None else "no need to identify again"
    page = Page(
        f"{arm} over its runs",
        f"{text[0]}. All numbers of this page: report.json.",
        verdict,
        found.since is None,
        [Bullets(text[1:])],
        [
            Chapter("model", "Error of the model and stiffness", [*_model(found)]),
            Chapter("numbers", "Numbers and their trends", [*_numbers(content, found)]),
            Chapter("runs", "Runs", [_runs(content)]),
        ],
    )
    return write(page, content, folder)


def _content(arm: str, found: Ageing) -> dict[str, Any]:
    return {
        "arm": arm,
        "error_when_new_m": _finite(found.new_m),
        "identify_again_since": None if found.since is None else found.since.folder.name,
        "runs": [
            {
                "run": run.folder.name,
                "day": day,
                "verdict": run.word,
                "error_m": None if run.error is None else run.error.rms_m,
                "stiffness": None if run.error is None else run.error.stiffness,
                "stiffness_deviation": None if run.error is None else run.error.deviation,
            }
            for run, day in zip(found.runs, found.days, strict=True)
        ],
        "trends": [
            {
                "name": one.name,
                "value": one.values[-1],
                "value_deviation": one.deviations[-1],
                "per_day": _finite(one.per_day),
                "per_day_deviation": _finite(one.deviation),
            }
            for one in found.trends
        ],
    }


def _model(found: Ageing) -> Iterator[Block]:
    yield Words(
        "Distance of the tips of model and arm under the measured pressures, root mean square. Dashed:"
        f" {AGAIN:g} times that when new, the median of the first {NEW} runs."
    )
    yield Picture(model_picture(found), "error of the model and stiffness of the arm over days")


def _numbers(content: dict[str, Any], found: Ageing) -> Iterator[Block]:
    rows = []
    for k, one in enumerate(content["trends"]):
        cells = [
            number(one[key], f"trends.{k}.{key}", digits=digits)
            for key, digits in (
                ("value", 4),
                ("value_deviation", 2),
                ("per_day", 2),
                ("per_day_deviation", 2),
            )
        ]
        rows.append([one["name"], *cells, "yes" if found.trends[k].is_told else ""])
    yield Table(["number", "#last value", "#± ", "#a day", "#± ", "trend"], rows)
    learned = [one for one in found.trends if one.name != STIFFNESS]
    if learned:
        yield Picture(learned_picture(learned), "learned numbers over days, with their deviations")


def _runs(content: dict[str, Any]) -> Table:
    rows = [
        [
            run["run"],
            run["verdict"],
            number(run["error_m"], f"runs.{k}.error_m", 1e3),
            number(run["stiffness"], f"runs.{k}.stiffness", digits=4),
            number(run["stiffness_deviation"], f"runs.{k}.stiffness_deviation", digits=2),
        ]
        for k, run in enumerate(content["runs"])
    ]
    return Table(["run", "verdict", "#error of the model, mm", "#stiffness", "#± "], rows)


def model_picture(found: Ageing) -> Image:
    """Return error and stiffness over days."""
    with mpl.rc_context(style()):
        figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
        left, right = figure.subplots(1, 2)
        own = [
            (day, 1e3 * run.error.rms_m) for run, day in zip(found.runs, found.days, strict=True) if run.error
        ]
        left.plot(*np.array(own).reshape(-1, 2).T, "o", ms=3, color=MEASURED)
        left.axhline(1e3 * AGAIN * found.new_m, ls="--", color=PREDICTED)
        left.set_ylim(bottom=0.0)
        left.set_title("error of the model [mm] over days")
        for one in found.trends:
            if one.name == STIFFNESS:
                _draw(right, one)
        right.set_title(f"{STIFFNESS}, over days")
        return svg(figure)


def learned_picture(learned: list[Trend]) -> Image:
    """Return a small panel for each number."""
    columns = 4
    rows = -(-len(learned) // columns)
    with mpl.rc_context(style()):
        figure = Figure(figsize=(WIDTH, 1.5 * rows), layout="constrained")
        for k, one in enumerate(learned):
            axes = figure.add_subplot(rows, columns, k + 1)
            _draw(axes, one)
            axes.set_title(one.name, fontsize=6)
        return svg(figure)


def _draw(axes: Any, one: Trend) -> None:
    axes.errorbar(one.days, one.values, one.deviations, fmt="o", ms=3, lw=0.8, color=MEASURED)
    if one.is_told:
        days = np.array([min(one.days), max(one.days)])
        weight = 1.0 / np.maximum(one.deviations, 1e-12) ** 2
        middle, at = (float(np.average(x, weights=weight)) for x in (one.values, one.days))
        axes.plot(days, middle + one.per_day * (days - at), color=PREDICTED)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
